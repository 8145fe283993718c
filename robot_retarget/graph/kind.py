"""Kinds of edges: targets from the human's motion, a measure on the robot, a role, and the frames that an edge joins.

A kind is one small class on `Kind`, and one line in `kinds/__init__.py` or an entry point of the group
`robot_retarget.kinds`. Solver, stream, balance and reports know kinds by this class only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.graph.placed_scene import PlacedScene, placed_scene
from robot_retarget.graph.rows import ClipRows as ClipRows
from robot_retarget.graph.rows import MeasureRows as MeasureRows
from robot_retarget.graph.rows import RowState as RowState
from robot_retarget.graph.track import FRAME as FRAME
from robot_retarget.graph.track import Form, Role, Track
from robot_retarget.graph.track import exact as exact
from robot_retarget.graph.weights import Weights
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.scene.scene import Scene

if TYPE_CHECKING:
    import casadi as ca

    from robot_retarget.graph.symbolic_robot import SymbolicRobot


# What kinds read


@dataclass(frozen=True, eq=False)
class RetargetContext:
    """The inputs of a kind's targets."""

    human: HumanFeatures
    match: Match
    robot: Robot
    weights: Weights

    @cached_property
    def scene(self) -> PlacedScene | None:
        """The bodies around, in the robot's world; None without a scene."""
        return placed_scene(self.human, self.match)

    @property
    def leg(self) -> float:
        """Length of the robot's leg [m], the scale of position errors."""
        return self.match.robot_leg


@dataclass(frozen=True, eq=False)
class StreamFrame(RetargetContext):
    """The inputs of a kind's targets at one frame of a stream; `human` has this frame alone."""

    calibration: RetargetContext
    """The frames that calibrated the performer."""
    corners: Floats
    """(F, 4, 3) corners of the robot's soles at the frame before [m]."""
    seconds: float
    """Time since the frame before [s]."""

    @cached_property
    def scene(self) -> PlacedScene | None:
        """The bodies around at this frame, placed as those of the calibration; None without a scene."""
        known, around = self.calibration.scene, self.human.around
        return None if known is None or around is None else known.moved(around.scene)


# What balance changes in targets


@dataclass(frozen=True, eq=False)
class Grounding:
    """A motion without free fall: a playback keeps a foot on the ground, and flights have the human's height, scaled."""

    height: Floats
    """(T,) target height of the pelvis without free fall [m]."""
    excess: Floats
    """(T,) of free fall over it [m]."""
    fps: float
    """Frames per second [1/s]."""

    def lowered(self, track: Track) -> Track:
        """Return the targets of places without free fall."""
        down = np.outer(self.excess, [axis == "z" for axis in track.axes])
        return replace(track, lower=track.lower - down, upper=track.upper - down)


@dataclass(frozen=True, eq=False)
class PlaybackFrames:
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
    trunk: float
    """Factor of π of the upward directions of pelvis and chest outside the stands."""


# Kinds

AXES = ("x", "y", "z")
NO_LENGTH = 1e-6
"""A bone or path up to this length counts as none [m]: its ends coincide on the robot, but for rounding."""
Measures = Mapping[str, Floats]
"""(T, E) measured values of edges by the name of their kind, of the kinds that have a measure."""
FrameTargets = tuple[Floats | float, ...]
"""Lower bounds, upper bounds and π of the edges at one frame, each (E,) or broadcast to it, and the data (D,) of the kind if any."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameEdges:
    """The part of a kind's targets that is constant over time."""

    ends: Sequence[tuple[str, str]]
    """(E,) names of both ends."""
    scale: Floats | float = 1.0
    """(E,) or a scalar, in the unit of the measure."""
    axes: Sequence[str] = ()
    """(E,) axes of coordinates; empty for distances."""
    huber_delta: float = np.inf
    """Huber scale of the errors [-]."""

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats | float]:
        """Return values and π, each (T, E) or broadcast to it, of a human of T frames."""
        raise NotImplementedError


class Kind:
    """A kind of edge. The defaults are those of a cost of one frame whose targets follow the human."""

    name: str
    """The name in tables and reports."""
    role: Role = Role.COST
    stencil: tuple[int, ...] = FRAME
    """The frames that an edge joins, relative to its own: (0,), or of joints (−1, 0), (−1, 0, 1) or (−2, −1, 0)."""
    form: Form = Form.SYMBOLIC
    follows_human: bool = True
    """Whether the targets depend on the human's motion: a stream computes them at every frame."""
    by_user: bool = False
    """Whether a user adds the edges: a command that misses a hard one of them fails."""
    whole: bool = False
    """Whether the edges belong together: single ones are dropped by π = 0."""
    raises_root: bool = False
    """Whether raising the root restores a symbolic inequality: a height over the floor."""
    most: int = 24
    """Largest number of rows of a numeric inequality in the solver [-]; those with the least room are kept. At
    `compiled.FEW` or fewer one program solves the frame. Half and double change the cost of a boxing OP3 by 3 and -2 %,
    and nothing in a dance of the G1."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Return ends, intervals and priorities over time; None for bodies without edges of the kind.

        The default has one value per edge and frame, `edges`.
        """
        edges = self.edges(context)
        if edges is None:
            return None
        target, priority = edges.targets(context.human)
        return exact(self, edges.ends, target, priority, edges.scale, axes=edges.axes, huber_delta=edges.huber_delta)

    def edges(self, context: RetargetContext) -> FrameEdges | None:
        """Return the part of the targets that is constant over time, where the rest depends on single frames."""
        return None

    def step(self, context: StreamFrame, memory: dict[str, Any]) -> FrameTargets | None:
        """Return the targets at one frame of a stream; None keeps those of the frame before.

        The default evaluates `edges`, or else `targets` of this one frame.

        Args:
            context: the frame.
            memory: the kind's state between frames; empty at the first.
        """
        if "edges" not in memory:
            memory["edges"] = self.edges(context.calibration)
        if memory["edges"] is None:
            track = self.targets(context)
            return None if track is None else (track.lower[0], track.upper[0], track.priority[0])
        target, priority = memory["edges"].targets(context.human)
        return target[0], target[0], priority[0] if isinstance(priority, np.ndarray) and priority.ndim > 1 else priority

    def measure(self, track: Track, body: "SymbolicRobot") -> "ca.SX":
        """Return (E,) values of the edges, an expression of the robot's points, axes and joints; CasADi differentiates it.

        Args:
            track: E edges of the kind over T frames.
            body: symbols of the robot.
        """
        raise NotImplementedError(f"{type(self).__name__} has no measure")

    def rows(self, track: Track, state: RowState) -> MeasureRows | None:
        """Return values and slopes of the edges that matter at a configuration; None without any.

        It is the measure of a kind of numeric form: a cost, or an inequality that one slack relaxes.
        """
        raise NotImplementedError(f"{type(self).__name__} has no rows")

    def clip_rows(self, track: Track, states: RowState) -> ClipRows:
        """Return the rows of a numeric inequality at many configurations: those of each, by default."""
        rows = [self.rows(track, states.at(frame)) for frame in range(len(states.qpos))]
        return ClipRows.of(rows, states.robot.model.nv)

    def projected(self, track: Track, state: RowState) -> Floats:
        """Return the nearby configuration (nq,) that meets the edges of a numeric cost; the same by default."""
        return state.qpos

    def overlap(self, track: Track, states: RowState) -> Floats:
        """Return how deep surfaces are inside each other (N,) [m], which a repair undoes; of a numeric inequality."""
        return np.zeros(len(states.qpos))

    def penetration(self, track: Track, states: RowState) -> Floats:
        """Return how deep surfaces are under the floor (N,) [m], which raising the root undoes; of a numeric inequality."""
        return np.zeros(len(states.qpos))

    def unbalanced(self, track: Track) -> Track:
        """Return the targets of a motion that no balance follows; the same by default, as in `grounded`, `coarse` and `solved`."""
        return track

    def grounded(self, track: Track, grounding: Grounding) -> Track:
        """Return the targets of a motion that balance follows, without free fall."""
        return track

    def coarse(self, track: Track) -> Track:
        """Return the targets while the coarse path is sought."""
        return track

    def solved(self, track: Track, measured: Measures, fixed: int = 0, unreached: Bools | None = None) -> Track:
        """Return the targets once a path is known.

        Args:
            track: E edges of the kind over T frames.
            measured: name → (T, E) values of the edges on the path, of kinds with a measure.
            fixed: number of frames at the start that keep their targets.
            unreached: (T,) frames at which no pose meets the hard edges together, once that is known.
        """
        return track

    def played(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the targets in a balanced playback; by default, symbolic costs fade out towards the stands.

        Args:
            track: E edges of the kind over K frames.
            measured: name → (K, E) values of the edges in the stands, of kinds with a measure.
            frames: of the playback.
        """
        return track.weighed(frames.share) if (track.role, self.form) == (Role.COST, Form.SYMBOLIC) else track

    def stood(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the targets in one frame of a balanced stand, as `played` by default; measured: in the standing pose."""
        return self.played(track, measured, frames)

    def for_robot(self) -> "Kind":
        """Return the kind for a performer that is a robot; the same by default."""
        return self

    def for_stream(self) -> "Kind":
        """Return the kind for a stream, whose later frames are unknown; the same by default."""
        return self

    def bodies(self, track: Track) -> Scene | None:
        """Return the bodies around the robot at the frames of a track, where the kind knows them."""
        return None

    def of(self, edges: np.ndarray) -> "Kind":
        """Return the kind of some of the edges, where it stores data per edge."""
        return self

    def with_edges(self, other: Any) -> "Kind":
        """Return the kind with the edges of both."""
        return self
