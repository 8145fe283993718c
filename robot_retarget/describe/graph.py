"""The graph of a retargeting: G = (V × T, E, {δ, π}), from human to robot, to be seen, weighed and added to.

V are keypoints, sole corners, segments, joints and places of the matched bodies, T the frames of the motion. Edges stand in
tracks, one a kind: who is joined is said once, what is wished frame by frame.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget import dgp
from robot_retarget.arrays import Floats
from robot_retarget.describe.added import added_edge, with_added
from robot_retarget.describe.expansion import expanded
from robot_retarget.describe.kinds import KINDS, Kind
from robot_retarget.describe.kinds.kind import Renewable, Scene
from robot_retarget.describe.kinds.own import End, Own
from robot_retarget.describe.limits import limit_tracks
from robot_retarget.describe.path import pelvis_path
from robot_retarget.describe.track import HARD, Track
from robot_retarget.describe.weights import Weights
from robot_retarget.errors import GraphError, UsageError, known
from robot_retarget.human.features import HumanFeatures, features_of
from robot_retarget.human.match import Match, match
from robot_retarget.motion import Motion, read_motion
from robot_retarget.robot import Robot, load_robot

MOST_FPS = 30.0
"""Motions of a higher rate are described at this one unless told otherwise, as reference motions are by custom [1/s]."""
PLAUSIBLE_FPS = (5.0, 120.0)
"""Rates that may be asked for besides the motion's own [1/s]: below, limbs swing unseen between frames; above, frames are
interpolated ones, which playback makes by itself."""
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
    """As it is described: cut and resampled."""
    robot: Robot
    match: Match
    human: HumanFeatures
    tracks: tuple[Track, ...]
    """Edges that are minimised; hard ones have the priority `track.HARD`."""
    pelvis: Floats
    """(T, 3) where the pelvis should be [m]; starts are made from it."""
    weights: Weights
    mapped: bool = False
    """Whether a map file said which joint is which."""

    def __len__(self) -> int:
        return len(self.human)

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.human.fps

    @cached_property
    def limits(self) -> tuple[Track, ...]:
        """Edges that hold exactly: the floor under soles, links apart, joint ranges and speeds."""
        return limit_tracks(self.robot, self.match, len(self), self.fps)

    @property
    def kinds(self) -> dict[str, Track]:
        """All tracks by the name of their kind."""
        return {track.name: track for track in (*self.tracks, *self.limits)}

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(track)} {name}" for name, track in self.kinds.items())
        return f"<Graph {self.robot.name} × {len(self)} frames at {self.fps:g}/s; edges a frame: {counts}>"

    def between(self, a: str, b: str) -> dict[str, Track]:
        """The edges that join two ends, by kind.

        Raises:
            GraphError: nothing is called so.
        """
        for end in (a, b):
            self._require_end(end)
        found = {}
        for name, track in self.kinds.items():
            if (joined := track.joins(a, b)).any():
                found[name] = track.subset(joined)
        return found

    def table(self, frames: ArrayLike | None = None) -> np.ndarray:
        """The expansion over V × T as a structured array: kind, a, b, axis, frame, lower, upper, priority, hard.

        Args:
            frames: some of them only; an edge without priority at a frame is absent there.
        """
        chosen = np.arange(len(self)) if frames is None else np.atleast_1d(np.asarray(frames, dtype=int))
        return np.concatenate([_rows(track, chosen) for track in self.kinds.values()])

    def expanded(self) -> "dgp.Graph":
        """The papers' graph of free points (`describe.expansion`): the edges between keypoints and places, and the bones."""
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
        """The graph with an edge of one's own, E⁺.

        Args:
            a: a keypoint, a point `(body, (x, y, z))` [m] of the robot, or a place `(x, y, z)` in the world [m].
            b: the other end.
            at: the distance, or its lower and upper bound [m]; the upper may be ∞.
            frames: the first and the last; all by default. The priority rises before and falls after (`added.FADE`).
            priority: π over the squared leg; `added.SOFT` by default.
            hard: held within a millimetre; a frame where that fails is reported (`Solution.unmet`).

        Raises:
            GraphError: an unknown end, an empty or unreachable interval, frames outside the clip, or two hard edges of
                the same ends and frames that contradict each other.
        """
        edge = added_edge(self.match, self.robot, len(self), (a, b), at, frames, priority, hard)
        own = next((track for track in self.tracks if isinstance(track.kind, Own)), None)
        grown = with_added(own, edge, len(self), self.fps, self.match.robot_leg)
        return replace(self, tracks=(*(track for track in self.tracks if track is not own), grown))

    def with_priority(self, what: str | tuple[str, str], factor: float) -> "Graph":
        """The graph with a kind, or the edges between two ends, weighed by a factor.

        Raises:
            GraphError: nothing is called so, or a factor below 0.
        """
        if not 0 <= factor < np.inf:
            raise GraphError(f"a priority is weighed by a factor of 0 or more, got {factor}")
        return replace(self, tracks=tuple(t.weighed(factor, self._chosen(t, what)) for t in self._checked(what)))

    def without(self, what: str | tuple[str, str]) -> "Graph":
        """The graph less a kind, or less the edges between two ends; limits stay.

        Raises:
            GraphError: nothing is called so.
        """
        kept = [_less(track, self._chosen(track, what)) for track in self._checked(what)]
        return replace(self, tracks=tuple(track for track in kept if len(track)))

    def frames(self, first: int, last: int) -> "Graph":
        """The graph of frames `first` … `last` − 1."""
        return replace(self.at(slice(first, last)), motion=self.motion.frames(first, last))

    def at(self, frames: slice | np.ndarray) -> "Graph":
        """The edges at some frames, of the same motion."""
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

    def _checked(self, what: str | tuple[str, str]) -> tuple[Track, ...]:
        if isinstance(what, str):
            if what not in {track.name for track in self.tracks}:
                raise GraphError(f"no kind {what!r} that can be weighed; {known([t.name for t in self.tracks])}")
        else:
            for end in what:
                self._require_end(end)
        return self.tracks

    @staticmethod
    def _chosen(track: Track, what: str | tuple[str, str]) -> np.ndarray:
        if isinstance(what, str):
            return np.full(len(track), track.name == what)
        return track.joins(*what)


def describe(
    motion: Motion | str | Path,
    robot: Robot | str | Path,
    *,
    fps: float | None = None,
    overrides: str | Path | None = None,
    weights: Weights | None = None,
    favour: str = "balanced",
    kinds: Iterable[Kind] = KINDS,
) -> Graph:
    """Build the graph of a human motion on a robot.

    Args:
        motion: a motion, or a file that `read_motion` reads.
        robot: a robot, or a name or model file that `load_robot` loads.
        fps: frames per second; None takes the motion's own, `MOST_FPS` at most.
        overrides: a TOML file that replaces lines of the keypoint map (`match.match`).
        weights: how much each kind of edge counts.
        favour: `directions` of limbs, `distances` between parts, or `balanced` (`Weights.favouring`).
        kinds: what the motion is described by.

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
    """The motion at the rate asked for, else at its own or `MOST_FPS`, whichever is less.

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


def graph_of(motion: Motion, robot: Robot, matched: Match, weights: Weights, kinds: Iterable[Kind] = KINDS) -> Graph:
    """The graph of matched bodies."""
    scene = Scene(features_of(motion, matched), matched, robot, weights)
    return _built(motion, scene, kinds)


def graph_from(graph: Graph, human: HumanFeatures, kinds: Iterable[Kind] = KINDS) -> Graph:
    """The same bodies with another human; edges that were added stay."""
    built = _built(graph.motion, Scene(human, graph.match, graph.robot, graph.weights), kinds)
    added = tuple(track for track in graph.tracks if track.name not in {kind.name for kind in kinds})
    return replace(built, tracks=(*built.tracks, *added))


def _built(motion: Motion, scene: Scene, kinds: Iterable[Kind]) -> Graph:
    tracks = tuple(track for kind in kinds if (track := kind.wish(scene)) is not None)
    path = pelvis_path(scene.human, scene.match)
    return Graph(motion, scene.robot, scene.match, scene.human, tracks, path, scene.weights)


def _less(track: Track, edges: np.ndarray) -> Track:
    """A track without some edges; those of a kind that is renewed as a whole stay, with π = 0."""
    whole = isinstance(track.kind, Renewable) and not edges.all()
    return track.weighed(0.0, edges) if whole else track.subset(~edges)


def _rows(track: Track, frames: np.ndarray) -> np.ndarray:
    """The expansion of one track."""
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
