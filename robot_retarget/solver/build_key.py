"""The key of a build: a hash of everything that determines the functions of a problem."""

import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

from robot_retarget.graph.track import Track
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot

PACKAGE = Path(__file__).parents[1]
SOURCES = ("graph", "robot", "solver/problem.py", "solver/stencils.py")
"""The code that builds functions."""


def build_key(robot: Robot, match: Match, tracks: Sequence[Track]) -> str | None:
    """Return the key of the functions of tracks; None if a kind has code from outside the package.

    Measures depend on the robot's side of the match alone: the human is in the targets.
    """
    if not all(type(track.kind).__module__.startswith("robot_retarget.") for track in tracks):
        return None
    body = match.anatomy, match.keypoints, match.parents, match.robot_bones, match.rest, match.ankle_height
    with np.printoptions(override_repr=_exactly):
        text = repr((body, [_determining(track) for track in tracks]))
    made_by = _code(), ca.CasadiMeta.version(), _kinematics(robot), text
    return hashlib.sha256("\n".join(made_by).encode()).hexdigest()


def _exactly(array: np.ndarray) -> str:
    """Return the text of an array: all its bits, in a hundredth of the time that digits take."""
    return f"{array.dtype}{array.shape}{array.tobytes().hex()}"


def _determining(track: Track) -> tuple[object, ...]:
    """Return what determines the functions of a track; its targets are their parameters."""
    kind = type(track.kind).__qualname__, vars(track.kind)
    return kind, track.ends, track.axes, track.scale, track.huber_delta, track.exact


def _kinematics(robot: Robot) -> str:
    """Return a hash of bodies, joints and limits: meshes do not change functions, and they are large."""
    names = [name for name in sorted(dir(robot.model)) if name.startswith(("body_", "jnt_", "dof_", "qpos0"))]
    parts = [np.asarray(getattr(robot.model, name)) for name in names]
    return hashlib.sha256(b"".join(part.tobytes() for part in (*parts, robot.lower, robot.upper))).hexdigest()


@cache
def _code() -> str:
    """Return a hash of the code that builds functions."""
    files = [file for source in SOURCES for file in sorted((PACKAGE / source).rglob("*.py")) or [PACKAGE / source]]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
