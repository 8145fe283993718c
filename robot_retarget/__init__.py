"""Human motion to humanoid robots by distance geometry.

    import robot_retarget as rr

    motion = rr.read_motion("clip.bvh")
    robot = rr.load_robot("op3")
    result = rr.retarget(motion, robot)
    report = rr.simulate(result.trajectory, robot)
    result.trajectory.save("out.npz")

The public names below are loaded when they are first used: importing the package is quick.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robot_retarget.dgp import interaction_distance as interaction_distance
    from robot_retarget.errors import RobotRetargetError as RobotRetargetError
    from robot_retarget.motion import Motion as Motion
    from robot_retarget.motion import Skeleton as Skeleton
    from robot_retarget.motion import read_motion as read_motion
    from robot_retarget.motion import write_bvh as write_bvh
    from robot_retarget.retarget.match import Match as Match
    from robot_retarget.retarget.match import match as match
    from robot_retarget.retarget.solution import Solution as Solution
    from robot_retarget.retarget.transfer import Result as Result
    from robot_retarget.retarget.transfer import retarget as retarget
    from robot_retarget.robot import Robot as Robot
    from robot_retarget.robot import load_robot as load_robot
    from robot_retarget.simulate.report import Report as Report
    from robot_retarget.simulate.rollout import simulate as simulate
    from robot_retarget.trajectory import Trajectory as Trajectory
    from robot_retarget.trajectory import load_trajectory as load_trajectory

__version__ = "0.1.0"

_HOME = {
    "interaction_distance": "dgp",
    "RobotRetargetError": "errors",
    "Motion": "motion",
    "Skeleton": "motion",
    "read_motion": "motion",
    "write_bvh": "motion",
    "Match": "retarget.match",
    "match": "retarget.match",
    "Solution": "retarget.solution",
    "Result": "retarget.transfer",
    "retarget": "retarget.transfer",
    "Robot": "robot",
    "load_robot": "robot",
    "Report": "simulate.report",
    "simulate": "simulate.rollout",
    "Trajectory": "trajectory",
    "load_trajectory": "trajectory",
}

# Two functions are called like the folders they live in. Loading a folder binds its name here; it is done once, now,
# and undone, so that the name is free for the function.
for _folder in ("retarget", "simulate"):
    importlib.import_module(f"{__name__}.{_folder}")
    del globals()[_folder]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"robot_retarget has no {name!r}; it has {', '.join(sorted(_HOME))}")
    value = getattr(importlib.import_module(f"robot_retarget.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(_HOME)
