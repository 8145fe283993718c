"""Human motion to humanoid robots by distance geometry.

    import robot_retarget as rr

    result = rr.retarget("clip.bvh", "op3")
    report = rr.simulate(result)
    report.trajectory.save("out.npz")

The public names below are loaded when they are first used: importing the package is quick.
"""

import importlib
from typing import TYPE_CHECKING, Any

from robot_retarget.base.version import VERSION

if TYPE_CHECKING:
    from robot_retarget.base.errors import RobotRetargetError as RobotRetargetError
    from robot_retarget.edit.sequence import sequence as sequence
    from robot_retarget.edit.sequence import splice as splice
    from robot_retarget.formats import export as export
    from robot_retarget.formats import load_trajectory as load_trajectory
    from robot_retarget.graph.describe import RobotGraph as RobotGraph
    from robot_retarget.graph.describe import describe as describe
    from robot_retarget.graph.graph import Graph as Graph
    from robot_retarget.human.match import Match as Match
    from robot_retarget.human.match import match as match
    from robot_retarget.human.motion import Motion as Motion
    from robot_retarget.human.read import read_motion as read_motion
    from robot_retarget.human.readers.bvh import write_bvh as write_bvh
    from robot_retarget.human.skeleton import Skeleton as Skeleton
    from robot_retarget.judge.report import Report as Report
    from robot_retarget.judge.rollout import simulate as simulate
    from robot_retarget.papers import interaction_distance as interaction_distance
    from robot_retarget.robot import Robot as Robot
    from robot_retarget.robot import freeze as freeze
    from robot_retarget.robot import load_robot as load_robot
    from robot_retarget.scene import Scene as Scene
    from robot_retarget.scene import read_scene as read_scene
    from robot_retarget.scores.score import Score as Score
    from robot_retarget.scores.score import score as score
    from robot_retarget.solver.pipeline import Result as Result
    from robot_retarget.solver.pipeline import retarget as retarget
    from robot_retarget.solver.pipeline import solve as solve
    from robot_retarget.solver.pipeline import transfer as transfer
    from robot_retarget.solver.solution import Solution as Solution
    from robot_retarget.solver.stream import Stream as Stream
    from robot_retarget.solver.stream import stream as stream
    from robot_retarget.tools.view.web.viewer import view as view
    from robot_retarget.trajectory import Trajectory as Trajectory

__version__ = VERSION

_HOME = {
    "describe": "graph.describe",
    "Graph": "graph.graph",
    "RobotGraph": "graph.describe",
    "interaction_distance": "graph.interaction",
    "RobotRetargetError": "base.errors",
    "export": "formats",
    "Motion": "human.motion",
    "Skeleton": "human.skeleton",
    "read_motion": "human.read",
    "write_bvh": "human.readers.bvh",
    "Match": "human.match",
    "match": "human.match",
    "Solution": "solver.solution",
    "Stream": "solver.stream",
    "stream": "solver.stream",
    "Result": "solver.pipeline",
    "retarget": "solver.pipeline",
    "solve": "solver.pipeline",
    "transfer": "solver.pipeline",
    "Robot": "robot",
    "freeze": "robot",
    "load_robot": "robot",
    "Scene": "scene",
    "read_scene": "scene",
    "Score": "scores.score",
    "score": "scores.score",
    "sequence": "edit.sequence",
    "splice": "edit.sequence",
    "Report": "judge.report",
    "simulate": "judge.rollout",
    "Trajectory": "trajectory",
    "load_trajectory": "formats",
    "view": "tools.view.web.viewer",
}


def __getattr__(name: str) -> Any:
    """Load a public function or class from its module on first use."""
    if name not in _HOME:
        raise AttributeError(f"robot_retarget has no {name!r}; it has {', '.join(sorted(_HOME))}")
    globals()[name] = value = getattr(importlib.import_module(f"robot_retarget.{_HOME[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted(_HOME)
