"""Kinds of edges: targets from the human's motion, a measure on the robot, a role, and the frames that an edge joins.

A kind is one file with one small class, and one line in `kinds/__init__.py`. The solver reads kinds through the
protocols below. `Symbolic` kinds write their measure in CasADi, `Numeric` kinds evaluate it. Bounds and temporal kinds
need neither, because their measures are joint angles and differences of configurations.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import casadi as ca

from robot_retarget.arrays import Floats, Ints
from robot_retarget.graph.role import FRAME as FRAME
from robot_retarget.graph.role import Role as Role
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import EdgeKind, Track, exact
from robot_retarget.graph.weights import Weights
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot

AXES = ("x", "y", "z")
SHORTEST = 1e-6
"""A bone or path up to this length counts as none: its ends coincide on the robot [m]."""


@dataclass(frozen=True, eq=False)
class RetargetContext:
    """The inputs of a kind's targets."""

    human: HumanFeatures
    match: Match
    robot: Robot
    weights: Weights

    @property
    def leg(self) -> float:
        """Length of the robot's leg [m], the scale of position errors."""
        return self.match.robot_leg


@runtime_checkable
class MotionKind(EdgeKind, Protocol):
    """A kind of edge with targets from a human motion."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Ends, intervals and priorities over time; None where the bodies have no such edges."""
        ...


@runtime_checkable
class Symbolic(Protocol):
    """A kind with a measure of one frame that CasADi differentiates; a cost or an inequality."""

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """(E,) values of the edges, an expression of the robot's points, axes and joints.

        Args:
            track: E edges of the kind over T frames.
            body: symbols of the robot.
        """
        ...


@runtime_checkable
class Grounded(Protocol):
    """An inequality that raising the root restores: points over the floor."""

    def depth(self, track: Track, values: Floats) -> float:
        """Return the depth of the lowest point under the floor, from the values (E,) of the edges [m].

        Args:
            track: E edges of the kind over T frames.
            values: (E,) heights [m].
        """
        ...


@dataclass(frozen=True, eq=False)
class Past:
    """The frame before."""

    qpos: Floats
    """(nq,)."""
    seconds: float
    """Time since the frame before [s]."""


@dataclass(frozen=True, eq=False)
class ContactRows:
    """Rows of the inequalities near their bound at a configuration."""

    slope: Floats
    """(R, nv) slopes of the distances."""
    deficit: Floats
    """(R,) lower bound minus distance [m]."""


@dataclass(frozen=True, eq=False)
class MeasureRows:
    """Values of some edges and their Jacobian by the tangent vector."""

    values: Floats
    """(R,)."""
    slope: Floats
    """(R, nv)."""
    edges: Sequence[int]
    """(R,) columns of the track; an edge may have several rows, or no row."""


class Evaluator(Protocol):
    """The measure of a `Numeric` cost."""

    def __call__(self, qpos: Floats, past: Past | None, contacts: ContactRows | None) -> MeasureRows | None:
        """Evaluate the edges.

        Args:
            qpos: (nq,) the configuration.
            past: the frame before, for a stencil (−1, 0); None at the first frame.
            contacts: inequality rows at the configuration, None without such kinds.

        Returns:
            The rows with a cost, None without any.
        """
        ...


@runtime_checkable
class Projecting(Protocol):
    """An evaluator whose edges are closed exactly at the end of a descent."""

    def projected(self, qpos: Floats) -> Floats:
        """Return the nearby configuration (nq,) that meets the edges."""
        ...


@runtime_checkable
class Numeric(Protocol):
    """A cost whose measure CasADi cannot express."""

    def evaluator(self, track: Track, robot: Robot) -> Evaluator:
        """Return the measure of a track's edges.

        Args:
            track: E edges of the kind over T frames.
            robot: the robot.
        """
        ...


class Proximity(Protocol):
    """Distances of surfaces near each other: the measure of an inequality that one slack relaxes."""

    most: int
    """Maximum number of rows."""
    rest: Floats
    """Per pair of geoms the distance that they may keep [m]."""

    def near(self, qpos: Floats) -> tuple[Floats, Floats, Floats]:
        """Return distances (C,) [m], slopes (C, nv) and the distance that each pair may keep (C,) [m]."""
        ...

    def found(self, qpos: Floats) -> tuple[Floats, Ints, Floats]:
        """Return distances (C,) [m], geoms (C, 2) and slopes (C, nv)."""
        ...

    def clearance_deficit(self, distance: Floats, rest: Floats) -> Floats:
        """Return (C,) lower bound minus distance [m].

        Args:
            distance: (C,) [m].
            rest: (C,) the distance that each pair may keep [m].
        """
        ...

    def foremost(self, distance: Floats, rest: Floats) -> Ints:
        """Return indices of the `most` distances with the least room to their bound.

        Args:
            distance: (C,) [m].
            rest: (C,) the distance that each pair may keep [m].
        """
        ...

    def depth(self, qpos: Floats) -> float:
        """Return the depth of the deepest overlap [m]."""
        ...

    def floor_penetration(self, qpos: Floats) -> float:
        """Return the depth of the lowest surface under the floor [m]."""
        ...


@runtime_checkable
class Nearby(Protocol):
    """An inequality between surfaces, evaluated numerically for pairs near each other."""

    def proximity(self, track: Track, robot: Robot, match: Match, reach: float) -> Proximity:
        """Return the distances of a track's pairs nearer than `reach` [m].

        Args:
            track: E edges of the kind over T frames.
            robot: the robot.
            match: the matched bodies.
            reach: pairs farther apart have no rows [m].
        """
        ...


class InstantTargets(Protocol):
    """Targets of edges at T frames: values and π, each (T, E) or broadcast to it."""

    @property
    def ends(self) -> Sequence[tuple[str, str]]:
        """(E,) names of both ends."""
        ...

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats | float]:
        """Return the targets for a human of T frames."""
        ...


@runtime_checkable
class CausalKind(Protocol):
    """A kind whose targets at a frame depend on the human of that frame alone: a stream evaluates it frame by frame."""

    def edges(self, context: RetargetContext) -> InstantTargets | None:
        """The part that is constant over time; None where the bodies have no such edges."""
        ...


def coordinates(
    kind: MotionKind, edges: InstantTargets | None, human: HumanFeatures, scale: float = 1.0
) -> Track | None:
    """Return the track of edges with the components of vectors as targets, or None without edges.

    Args:
        kind: of the edges.
        edges: the constant part of the targets, or None.
        human: features of T frames.
        scale: makes errors dimensionless [m].
    """
    if edges is None:
        return None
    target, priority = edges.targets(human)
    return exact(kind, edges.ends, target, priority, scale, axes=AXES * (len(edges.ends) // len(AXES)))


@dataclass(frozen=True, eq=False)
class PlaybackTargets:
    """K frames of a balanced playback, which starts and ends in a stand."""

    share: Floats
    """(K, 1) share of the human's motion, 0 in the stands."""
    soles: Floats
    """(K, F · 4 · 3) places of the sole corners [m]."""
    grip: Floats
    """(K, F · 4 · 3) π of these."""
    standing: float
    """π of joints at their standing angles [1/rad²]."""
    upright: float
    """π of the pelvis in a stand."""
    height: float
    """π of the height of the pelvis, over the squared leg."""


@runtime_checkable
class PlaybackKind(Protocol):
    """A cost with separate targets in a balanced playback; other costs fade out towards the stands."""

    def played(self, track: Track, stand: Floats, playback: PlaybackTargets) -> Track:
        """Return the targets of a track at the K frames of a playback.

        Args:
            stand: (K, E) values in the stand before or after each frame.
        """
        ...


@runtime_checkable
class StandKind(Protocol):
    """A cost that shapes a balanced stand; other costs are absent there."""

    def stood(self, track: Track, measured: Floats, playback: PlaybackTargets) -> Track:
        """Return the targets of one frame, from the values (1, E) in the standing pose.

        Args:
            track: E edges of the kind over T frames.
            measured: (1, E) measures in the standing pose.
            playback: the K frames, and the priorities of a stand.
        """
        ...


@runtime_checkable
class TwoPassKind(Protocol):
    """A kind whose targets depend on the robot's own path: they are updated once, after the coarse path."""

    def coarse(self, track: Track) -> Track:
        """Return the targets for the coarse path."""
        ...

    def renewed(self, track: Track, measured: Floats, fixed: int = 0) -> Track:
        """Return the targets from the measures (T, E) on the coarse path; its first frames are `fixed`.

        Args:
            track: E edges of the kind over T frames.
            measured: (T, E) measures on the coarse path.
            fixed: number of frames at the start that keep their targets.
        """
        ...


def frame_costs(tracks: Iterable[Track]) -> list[Track]:
    """Return the tracks of symbolic costs of one frame, which are compiled together."""
    return [t for t in tracks if t.role is Role.COST and t.stencil == FRAME and isinstance(t.kind, Symbolic)]
