"""Human motion to humanoid robots by distance geometry.

    import robot_retarget as rr

    result = rr.retarget("clip.bvh", "op3")
    report = rr.simulate(result)
    report.trajectory.save("out.npz")

The public names below are loaded when they are first used: importing the package is quick.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robot_retarget.errors import RobotRetargetError as RobotRetargetError
    from robot_retarget.formats import export as export
    from robot_retarget.formats import load_trajectory as load_trajectory
    from robot_retarget.graph.describe import RobotGraph as RobotGraph
    from robot_retarget.graph.describe import describe as describe
    from robot_retarget.graph.graph import Graph as Graph
    from robot_retarget.human.match import Match as Match
    from robot_retarget.human.match import match as match
    from robot_retarget.motion import Motion as Motion
    from robot_retarget.motion import Skeleton as Skeleton
    from robot_retarget.motion import read_motion as read_motion
    from robot_retarget.motion import write_bvh as write_bvh
    from robot_retarget.papers import interaction_distance as interaction_distance
    from robot_retarget.pipeline import retarget as retarget
    from robot_retarget.pipeline import solve as solve
    from robot_retarget.pipeline import transfer as transfer
    from robot_retarget.result import Result as Result
    from robot_retarget.robot import Robot as Robot
    from robot_retarget.robot import freeze as freeze
    from robot_retarget.robot import load_robot as load_robot
    from robot_retarget.scene import Scene as Scene
    from robot_retarget.scene import read_scene as read_scene
    from robot_retarget.score.score import Score as Score
    from robot_retarget.score.score import score as score
    from robot_retarget.sequence.build import sequence as sequence
    from robot_retarget.sequence.build import splice as splice
    from robot_retarget.simulate.report import Report as Report
    from robot_retarget.simulate.rollout import simulate as simulate
    from robot_retarget.solve.live.stream import Stream as Stream
    from robot_retarget.solve.live.stream import stream as stream
    from robot_retarget.solve.solution import Solution as Solution
    from robot_retarget.trajectory import Trajectory as Trajectory
    from robot_retarget.view.web.page import view as view

__version__ = "0.2.0"

_HOME = {
    "describe": "graph.describe",
    "Graph": "graph.graph",
    "RobotGraph": "graph.describe",
    "interaction_distance": "graph.interaction",
    "RobotRetargetError": "errors",
    "export": "formats",
    "Motion": "motion",
    "Skeleton": "motion",
    "read_motion": "motion",
    "write_bvh": "motion",
    "Match": "human.match",
    "match": "human.match",
    "Solution": "solve.solution",
    "Stream": "solve.live.stream",
    "stream": "solve.live.stream",
    "Result": "result",
    "retarget": "pipeline",
    "solve": "pipeline",
    "transfer": "pipeline",
    "Robot": "robot",
    "freeze": "robot",
    "load_robot": "robot",
    "Scene": "scene",
    "read_scene": "scene",
    "Score": "score.score",
    "score": "score.score",
    "sequence": "sequence.build",
    "splice": "sequence.build",
    "Report": "simulate.report",
    "simulate": "simulate.rollout",
    "Trajectory": "trajectory",
    "load_trajectory": "formats",
    "view": "view.web.page",
}
_FOLDERS = ("score", "sequence", "simulate", "solve", "view")
"""Folders that have the name of a public function."""


def public(name: str) -> Any:
    """Load a public function or class from its module on first use."""
    value = getattr(importlib.import_module(f"robot_retarget.{_HOME[name]}"), name)
    if name in _FOLDERS:
        value.__name__ = f"robot_retarget.{name}"  # `import … as` finds a module of the folder by this name
    return value


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"robot_retarget has no {name!r}; it has {', '.join(sorted(_HOME))}")
    globals()[name] = value = public(name)
    return value


def __dir__() -> list[str]:
    return sorted(_HOME)


class _Package(ModuleType):
    """The package as a module: `rr.solve` is the function, `from robot_retarget.solve import …` the folder.

    So are `import robot_retarget.solve.compiled as compiled` and its like.

    Python sets a folder as an attribute of its package when it first imports it. Properties of the module's class take
    precedence and ignore that.
    """


def _function(name: str) -> property:
    return property(lambda _: public(name), lambda _, folder: None)


for _name in _FOLDERS:
    setattr(_Package, _name, _function(_name))
sys.modules[__name__].__class__ = _Package
