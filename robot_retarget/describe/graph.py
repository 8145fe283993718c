"""The graph of a retargeting, G = (V × T, E, {δ, π}), from human to robot.

V are keypoints, sole corners, segments, joints and places of the matched bodies, T the frames of the motion. A track
holds the edges of one kind: their ends once, their intervals and priorities frame by frame. The solver minimises and
enforces only the tracks of a graph.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget import dgp
from robot_retarget.arrays import Floats
from robot_retarget.describe.added import added_edge, with_added
from robot_retarget.describe.expansion import expanded
from robot_retarget.describe.kinds import KINDS
from robot_retarget.describe.kinds.kind import MotionKind, RetargetContext, TwoPassKind, frame_costs
from robot_retarget.describe.kinds.own import End, Own
from robot_retarget.describe.path import pelvis_path
from robot_retarget.describe.weights import Weights
from robot_retarget.dgp.role import FRAME, Role
from robot_retarget.dgp.track import HARD, Track
from robot_retarget.errors import GraphError, UsageError, known
from robot_retarget.human.features import HumanFeatures, features_of
from robot_retarget.human.match import Match, match
from robot_retarget.motion import Motion, read_motion
from robot_retarget.robot import Robot, load_robot

MOST_FPS = 30.0
"""Default upper limit of the rate of a described motion, a common rate of reference motions [1/s]."""
PLAUSIBLE_FPS = (5.0, 120.0)
"""Accepted rates in addition to the motion's own [1/s]: below, limb swings fall between frames; above, frames are
interpolated, as playback does anyway."""
ROW = np.dtype(
    [
        ("kind", "U16"),
        ("a", "U48"),
        ("b", "U48"),
        ("axis", "U8"),
        ("frame", np.int64),
        ("lower", np.float64),
        ("upper", np.float64),
        ("priority", np.float64),
        ("hard", np.bool_),
    ]
)


@dataclass(frozen=True, eq=False)
class Graph:
    """The edges of one motion on one robot."""

    motion: Motion
    """The described motion: cut and resampled."""
    robot: Robot
    match: Match
    human: HumanFeatures
    tracks: tuple[Track, ...]
    """One per kind; hard edges have the priority `track.HARD`, limits ∞."""
    pelvis: Floats
    """(T, 3) target positions of the pelvis [m]; the solver's starts use them."""
    weights: Weights
    mapped: bool = False
    """Whether a map file assigned the joints."""

    def __len__(self) -> int:
        return len(self.human)

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.human.fps

    @property
    def kinds(self) -> dict[str, Track]:
        """All tracks by the name of their kind."""
        return {track.name: track for track in self.tracks}

    @property
    def costs(self) -> list[Track]:
        """The tracks of symbolic costs of one frame, in the order of compiled measures."""
        return frame_costs(self.tracks)

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(track)} {name}" for name, track in self.kinds.items())
        return f"<Graph {self.robot.name} × {len(self)} frames at {self.fps:g}/s; edges a frame: {counts}>"

    def between(self, a: str, b: str) -> dict[str, Track]:
        """Return the edges that join two ends, by kind.

        Raises:
            GraphError: an end is unknown.
        """
        for end in (a, b):
            self._require_end(end)
        found = {}
        for name, track in self.kinds.items():
            if (joined := track.joins(a, b)).any():
                found[name] = track.subset(joined)
        return found

    def table(self, frames: ArrayLike | None = None) -> np.ndarray:
        """Return the expansion over V × T as a structured array: kind, a, b, axis, frame, lower, upper, priority, hard.

        Args:
            frames: the frames to include; an edge without priority at a frame is absent there.
        """
        chosen = np.arange(len(self)) if frames is None else np.atleast_1d(np.asarray(frames, dtype=int))
        return np.concatenate([_rows(track, chosen) for track in self.kinds.values()])

    def expanded(self) -> "dgp.Graph":
        """Return the papers' graph of free points (`describe.expansion`): edges of keypoints and places, and bones."""
        return expanded(self)

    def with_edge(
        self,
        a: End,
        b: End,
        at: float | tuple[float, float],
        *,
        frames: tuple[int, int] | None = None,
        priority: float | None = None,
        hard: bool = False,
    ) -> "Graph":
        """Return the graph with an additional edge of the user, E⁺.

        Args:
            a: a keypoint, a point `(body, (x, y, z))` [m] of the robot, or a place `(x, y, z)` in the world [m].
            b: the other end.
            at: the distance, or its lower and upper bound [m]; the upper may be ∞.
            frames: the first and the last; all by default. The priority rises before and falls after (`added.FADE`).
            priority: π over the squared leg; `added.SOFT` by default.
            hard: held within a millimetre; a frame in which that fails is reported (`Solution.unmet`).

        Raises:
            GraphError: an unknown end, an empty or unreachable interval, frames outside the clip, or two hard edges of
                the same ends and frames that contradict each other.
        """
        edge = added_edge(self.match, self.robot, len(self), (a, b), at, frames, priority, hard)
        own = next((track for track in self.tracks if isinstance(track.kind, Own)), None)
        grown = with_added(own, edge, len(self), self.fps, self.match.robot_leg)
        return replace(self, tracks=(*(track for track in self.tracks if track is not own), grown))

    def with_priority(self, what: str | tuple[str, str], factor: float) -> "Graph":
        """Return the graph with the priority of a kind, or of the edges between two ends, multiplied by a factor.

        Raises:
            GraphError: an unknown kind or end, a factor below 0, or a limit, which has no priority.
        """
        if not 0 <= factor < np.inf:
            raise GraphError(f"a priority is multiplied by a factor of 0 or more, got {factor}")
        refusal = f"{what} is a limit, which has no priority; `with_bounds` moves it"
        return self._changed(what, lambda track, edges: track.weighed(factor, edges), _is_cost, refusal)

    def with_bounds(
        self,
        what: str | tuple[str, str],
        lower: float | None = None,
        upper: float | None = None,
        *,
        factor: float = 1.0,
    ) -> "Graph":
        """Return the graph with other bounds of a limit or of added edges: margins, speed shares, narrower ranges.

        Args:
            what: a kind, or two ends.
            lower: in the unit of the kind, in place of the present bound.
            upper: the same for the upper bound.
            factor: multiplies both bounds afterwards, e.g. .8 for four fifths of all joint speeds.

        Raises:
            GraphError: an unknown kind or end, targets that follow the human's motion, a bound beyond the robot's own, or
                an empty interval.
        """
        refusal = f"the targets of {what} follow the human's motion; `with_priority` weighs them"
        return self._changed(what, lambda t, edges: _rebounded(t, edges, lower, upper, factor), _has_bounds, refusal)

    def without(self, what: str | tuple[str, str]) -> "Graph":
        """Return the graph without a kind, or without the edges between two ends.

        Raises:
            GraphError: an unknown kind or end, or joint ranges, which protect the robot.
        """
        refusal = f"{what} protects the robot; narrow it with `with_bounds`, or load the robot with wider limits"
        left = self._changed(what, _less, _can_be_dropped, refusal)
        return replace(left, tracks=tuple(track for track in left.tracks if len(track)))

    def frames(self, first: int, last: int) -> "Graph":
        """Return the graph of frames `first` … `last` − 1."""
        return replace(self.at(slice(first, last)), motion=self.motion.frames(first, last))

    def at(self, frames: slice | np.ndarray) -> "Graph":
        """Return the edges at some frames, of the same motion."""
        return replace(
            self,
            human=self.human.at(frames),
            pelvis=self.pelvis[frames],
            tracks=tuple(track.at(frames) for track in self.tracks),
        )

    @cached_property
    def ends(self) -> tuple[str, ...]:
        """The names of all ends."""
        return tuple(dict.fromkeys(end for t in self.kinds.values() for pair in t.ends for end in pair))

    def _require_end(self, end: str) -> None:
        if end not in self.ends:
            raise GraphError(f"nothing in the graph is called {end!r}; {known(self.ends)}")

    def _changed(
        self,
        what: str | tuple[str, str],
        change: Callable[[Track, np.ndarray], Track],
        applies: Callable[[Track], bool],
        refusal: str,
    ) -> "Graph":
        """Return the graph with the named edges changed, in the tracks to which the change applies.

        Raises:
            GraphError: an unknown kind or end, or the change applies to no track.
        """
        if isinstance(what, str) and what not in self.kinds:
            raise GraphError(f"no kind {what!r}; {known(self.kinds)}")
        for end in () if isinstance(what, str) else what:
            self._require_end(end)
        tracks, changed = [], False
        for track in self.tracks:
            edges = np.full(len(track), track.name == what) if isinstance(what, str) else track.joins(*what)
            chosen = bool(edges.any()) and applies(track)
            changed |= chosen
            tracks.append(change(track, edges) if chosen else track)
        if not changed:
            raise GraphError(refusal)
        return replace(self, tracks=tuple(tracks))


def _is_cost(track: Track) -> bool:
    return track.role is Role.COST


def _has_bounds(track: Track) -> bool:
    return track.role is not Role.COST or isinstance(track.kind, Own)


def _can_be_dropped(track: Track) -> bool:
    return (track.role, track.stencil) != (Role.BOUND, FRAME)


def describe(
    motion: Motion | str | Path,
    robot: Robot | str | Path,
    *,
    fps: float | None = None,
    overrides: str | Path | None = None,
    weights: Weights | None = None,
    favour: str = "balanced",
    kinds: Iterable[MotionKind] = KINDS,
) -> Graph:
    """Build the graph of a human motion on a robot.

    Args:
        motion: a motion, or a file that `read_motion` reads.
        robot: a robot, or a name or model file that `load_robot` loads.
        fps: frames per second; None takes the motion's own, `MOST_FPS` at most.
        overrides: a TOML file that replaces lines of the keypoint map (`match.match`).
        weights: how much each kind of edge counts.
        favour: `directions` of limbs, `distances` between parts, or `balanced` (`Weights.favouring`).
        kinds: the kinds of edges that describe the motion.

    Raises:
        MatchError: the motion is not human, or the robot no humanoid.
        UsageError: fps out of range, or an unknown word to favour.
    """
    weighed = (weights or Weights()).favouring(favour)
    motion = at_rate(motion if isinstance(motion, Motion) else read_motion(motion), fps)
    robot = robot if isinstance(robot, Robot) else load_robot(robot)
    matched = match(motion, robot, overrides)
    graph = graph_of(motion, robot, matched, weighed, kinds)
    return replace(graph, mapped=overrides is not None)


def at_rate(motion: Motion, fps: float | None) -> Motion:
    """Return the motion at the rate `fps`; without it, at its own rate or `MOST_FPS`, whichever is lower.

    Raises:
        UsageError: fps out of range.
    """
    if fps is None:
        return motion.resample(min(motion.fps, MOST_FPS))
    least, most = min(PLAUSIBLE_FPS[0], motion.fps), max(PLAUSIBLE_FPS[1], motion.fps)
    if not least <= fps <= most:
        raise UsageError(
            f"fps '{fps:g}' is outside {least:g} to {most:g} frames a second for a motion of {motion.fps:g}: with fewer, "
            "limbs swing unseen between frames; with more, all that is added is interpolated, as in playback"
        )
    resampled = motion.resample(fps)
    if fps <= motion.fps:
        return resampled
    told = f"At {fps:g} frames a second, those between the motion's own {motion.fps:g} are interpolated."
    return replace(resampled, notes=(*resampled.notes, told))


def graph_of(
    motion: Motion, robot: Robot, matched: Match, weights: Weights, kinds: Iterable[MotionKind] = KINDS
) -> Graph:
    """The graph of matched bodies."""
    context = RetargetContext(features_of(motion, matched), matched, robot, weights)
    return _built(motion, context, kinds)


def graph_from(graph: Graph, human: HumanFeatures) -> Graph:
    """The graph with the targets of another human of as many frames; limits, temporal costs and added edges stay."""
    context = RetargetContext(human, graph.match, graph.robot, graph.weights)
    costs = {track.name for track in graph.costs}
    tracks = tuple(_retargeted(track, context) if track.name in costs else track for track in graph.tracks)
    return replace(graph, human=human, tracks=tracks, pelvis=pelvis_path(human, graph.match))


def _retargeted(track: Track, context: RetargetContext) -> Track:
    """Return a track with the targets of another human; the same where its kind has none."""
    return (track.kind.targets(context) if isinstance(track.kind, MotionKind) else None) or track


def _built(motion: Motion, context: RetargetContext, kinds: Iterable[MotionKind]) -> Graph:
    tracks = tuple(track for kind in kinds if (track := kind.targets(context)) is not None)
    path = pelvis_path(context.human, context.match)
    return Graph(motion, context.robot, context.match, context.human, tracks, path, context.weights)


def _less(track: Track, edges: np.ndarray) -> Track:
    """A track without some edges; those of a kind that is renewed as a whole stay, with π = 0."""
    whole = isinstance(track.kind, TwoPassKind) and not edges.all()
    return track.weighed(0.0, edges) if whole else track.subset(~edges)


def _rebounded(track: Track, edges: np.ndarray, lower: float | None, upper: float | None, factor: float) -> Track:
    """Return a track with other intervals of some edges."""
    low, high = (
        factor * (own[:, edges] if bound is None else np.full_like(own[:, edges], bound))
        for own, bound in ((track.lower, lower), (track.upper, upper))
    )
    if (low > high).any() or not np.isfinite(factor):
        raise GraphError(f"{track.name}: the bounds leave no interval: {low.max():g} … {high.min():g}")
    if track.role is Role.BOUND and ((low < track.lower[:, edges]).any() or (high > track.upper[:, edges]).any()):
        raise GraphError(f"{track.name}: bounds can be narrowed only; the robot's limits file widens them")
    return track.bounded(low, high, edges)


def _rows(track: Track, frames: np.ndarray) -> np.ndarray:
    """Return the expansion of one track."""
    present = np.argwhere(track.priority[frames] > 0)
    t, edges = frames[present[:, 0]], present[:, 1]
    rows = np.empty(len(present), dtype=ROW)
    rows["kind"], rows["frame"] = track.name, t
    ends = np.array(track.ends).reshape(-1, 2)
    rows["a"], rows["b"] = ends[edges].T
    rows["axis"] = np.array(track.axes)[edges] if track.axes else ""
    for column in ("lower", "upper", "priority"):
        rows[column] = getattr(track, column)[t, edges]
    rows["hard"] = rows["priority"] >= HARD
    return rows
