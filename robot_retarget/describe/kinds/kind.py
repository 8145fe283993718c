"""What a kind of edge is: a wish on the human, a measure on the robot.

A new kind is one file with a small class like those beside this one, and one line in `kinds/__init__.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import casadi as ca

from robot_retarget.arrays import Floats
from robot_retarget.describe.measured import Measured
from robot_retarget.describe.track import Track, exact
from robot_retarget.describe.weights import Weights
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot

AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Scene:
    """All that a wish may depend on."""

    human: HumanFeatures
    match: Match
    robot: Robot
    weights: Weights

    @property
    def leg(self) -> float:
        """The robot's leg [m], the length that errors of places are over."""
        return self.match.robot_leg


class Kind(Protocol):
    """One kind of edge."""

    @property
    def name(self) -> str:
        """As tables show it."""
        ...

    def wish(self, scene: Scene) -> Track | None:
        """What the human asks for over time: ends, intervals, π; None where the bodies have no such edges."""
        ...

    def measure(self, track: Track, body: Measured) -> ca.SX:
        """(E,) what the edges measure on the robot, an expression of its points, axes and joints."""
        ...


class Asking(Protocol):
    """What edges ask for at T frames: wished values and π, each (T, E) or broadcast to it."""

    @property
    def ends(self) -> Sequence[tuple[str, str]]:
        """(E,) names of both ends."""
        ...

    def asked(self, human: HumanFeatures) -> tuple[Floats, Floats | float]:
        """Of a human of T frames."""
        ...


@runtime_checkable
class Instant(Protocol):
    """A kind that asks at a frame for what the human of that frame alone tells: a stream asks it frame by frame."""

    def edges(self, scene: Scene) -> Asking | None:
        """What stays the same over time, found once; None where the bodies have no such edges."""
        ...


def coordinates(kind: Kind, edges: Asking | None, human: HumanFeatures, scale: float = 1.0) -> Track | None:
    """The track of edges that ask for x, y and z of one vector after the other; None where there are none."""
    if edges is None:
        return None
    wished, priority = edges.asked(human)
    return exact(kind, edges.ends, wished, priority, scale, axes=AXES * (len(edges.ends) // len(AXES)))


@runtime_checkable
class Renewable(Protocol):
    """A kind whose δ depends on where the robot goes by itself: it is renewed once, after the coarse path."""

    def coarse(self, track: Track) -> Track:
        """What is asked for while that is not known."""
        ...

    def renewed(self, track: Track, measured: Floats, fixed: int = 0) -> Track:
        """What is asked for when the edges measure (T, E) on the coarse path; its first frames are `fixed`."""
        ...
