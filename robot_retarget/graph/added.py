"""Edges that a user adds, E⁺: their checks, and the track that holds them. The root that a touch-up holds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Floats, path_to_root
from robot_retarget.base.errors import GraphError, known
from robot_retarget.graph.kind import AXES, Kind, exact
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import HARD, Track, merged
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot

# Own edges, E⁺: distances that a user sets between two points over some frames.

End = str | tuple[str, ArrayLike] | ArrayLike
"""A keypoint, a point (3,) [m] in the frame of a body, or a place (3,) in the world [m]."""


@dataclass(frozen=True, eq=False)
class OwnKind(Kind):
    """Distances between ends that the user names."""

    ends: tuple[tuple[End, End], ...] = ()
    name: str = "own"
    follows_human = False
    by_user = True

    def of(self, edges: np.ndarray) -> "OwnKind":
        """Return some of the edges."""
        return replace(self, ends=tuple(self.ends[k] for k in edges))

    def with_edges(self, other: "OwnKind") -> "OwnKind":
        """Return the edges of both."""
        return replace(self, ends=(*self.ends, *other.ends))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """The distance of each pair of ends [m]."""
        apart = ca.horzcat(*(self._place(a, body) - self._place(b, body) for a, b in self.ends))
        return ca.sqrt(ca.sum1(apart**2).T + 1e-12)

    @staticmethod
    def _place(end: End, body: SymbolicRobot) -> ca.SX:
        if isinstance(end, str):
            return body.keypoint(end)
        if isinstance(end, tuple) and isinstance(end[0], str):
            return body.point(body.robot.model.body(end[0]).id, np.asarray(end[1], dtype=float))
        return ca.SX(np.asarray(end, dtype=float))


# The root of a body that is held. Held hinges have a range of one angle.

FIRM = 100 * HARD
"""π of the root, over the squared leg [-]: a hard edge that ends half a leg out of reach turns it by 0.1°."""


@dataclass(frozen=True, eq=False)
class HeldKind(Kind):
    """The root: its origin, and points at a leg's length along its axes."""

    name: str = "held"
    follows_human = False

    def track(self, frames: int, leg: float) -> Track:
        """Return the coordinates of these points, absent (π = 0) until the root is held.

        Args:
            frames: number of frames |T|.
            leg: length of the robot's leg [m].
        """
        ends = [(f"root point {k}", "its place") for k in range(len(_SPREAD)) for _ in AXES]
        return exact(self, ends, np.zeros((frames, len(ends))), 0.0, leg, axes=AXES * len(_SPREAD))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Where the points are [m]."""
        return ca.vertcat(*(body.point(body.robot.root_body, body.match.robot_leg * each) for each in _SPREAD))


_SPREAD = np.vstack([np.zeros(3), np.eye(3)])


FADE = 0.2
"""The priority of an added edge rises from 0 before its frames, and falls to 0 after them, within this time [s]. The
OP3 that waves, a hand at its head for half a second, has a jerk of 155 rad/s³ with half and 131 with double (151)."""
SOFT_PRIORITY = 100.0
"""Default priority of a soft edge, over the squared leg [-]: the hand of a wave, drawn to 0.05 m from the head of the
OP3, comes to 0.135 m in the mean with half and to 0.116 m with this; its limbs are off by 26.9 and 29.4°."""


@dataclass(frozen=True, eq=False)
class AddedEdge:
    """One checked edge between two ends."""

    ends: tuple[End, End]
    lower: float
    upper: float
    """The interval of the distance [m]."""
    frames: tuple[int, int]
    """First and last."""
    priority: float

    @property
    def names(self) -> tuple[str, str]:
        """Of both ends."""
        return end_name(self.ends[0]), end_name(self.ends[1])

    @property
    def name(self) -> str:
        """`l_hand – head`."""
        return " – ".join(self.names)

    def profile(self, frames: int, fps: float) -> Floats:
        """(T,) the priority over time: full within the edge's frames, quadratic in time over `FADE` around them.

        Args:
            frames: number of frames |T|.
            fps: frames per second.
        """
        time = np.arange(frames)
        away = np.maximum(np.maximum(self.frames[0] - time, time - self.frames[1]), 0)
        return self.priority * np.square(np.clip(1 - away / (FADE * fps + 1), 0.0, 1.0))


def added_edge(
    match: Match,
    robot: Robot,
    length: int,
    ends: tuple[End, End],
    at: float | tuple[float, float],
    frames: tuple[int, int] | None,
    priority: float | None,
    hard: bool,
) -> AddedEdge:
    """Check an edge against the robot and a graph of `length` frames.

    Args:
        length: number of frames of the graph.
        ends: keypoints, points of bodies or places [m].
        at: the distance, or its lower and upper bound [m].
        frames: first and last; None takes all.
        priority: π over the squared leg; None takes `SOFT_PRIORITY`.
        hard: whether the edge has the priority `HARD`.

    Raises:
        GraphError: an unknown end, an end joined to itself, an empty or unreachable interval, frames outside the clip, or
            a priority that is not positive.
    """
    ends = checked_end(match, robot, ends[0]), checked_end(match, robot, ends[1])
    name = f"{end_name(ends[0])} – {end_name(ends[1])}"
    if end_name(ends[0]) == end_name(ends[1]):
        raise GraphError(f"edge {name} joins an end to itself")
    if priority is not None and not 0 < priority < np.inf:
        raise GraphError(f"edge {name}: a priority is a number above 0, got {priority}")
    if hard and priority is not None:
        raise GraphError(f"edge {name}: a hard edge has no priority; give one or the other")
    lower, upper = _interval(name, at)
    _require_reach(match, robot, ends, lower)
    chosen = HARD if hard else SOFT_PRIORITY if priority is None else priority
    return AddedEdge(ends, lower, upper, _span(name, frames, length), chosen)


def with_added(tracks: Sequence[Track], edge: AddedEdge, fps: float, leg: float) -> tuple[Track, ...]:
    """The tracks of a graph with one more added edge; one of the same ends, interval and hardness takes up its frames.

    Args:
        tracks: of a graph.
        edge: the new one.
        fps: frames per second.
        leg: length of the robot's leg [m].

    Raises:
        GraphError: two hard edges of the same ends contradict each other in the same frames.
    """
    frames = len(tracks[0].lower)
    profile = edge.profile(frames, fps)
    alone = Track(
        OwnKind((edge.ends,)),
        (edge.names,),
        np.full((frames, 1), edge.lower),
        np.full((frames, 1), edge.upper),
        profile[:, None],
        np.full(1, leg),
    )
    others = tuple(track for track in tracks if track.name != alone.name)
    before = [track for track in tracks if track.name == alone.name]
    return (*others, _joined(before[0], alone, edge) if before else alone)


def _joined(track: Track, alone: Track, edge: AddedEdge) -> Track:
    """Return the track of the added edges extended by one edge; `alone` is the track of that edge."""
    _refuse_contradiction(track, edge)
    for k in np.flatnonzero(track.joins(*edge.names)):
        same = (track.lower[0, k], track.upper[0, k]) == (edge.lower, edge.upper)
        if same and (track.priority[:, k].max() >= HARD) == (edge.priority >= HARD):
            return replace(track, priority=_raised(track.priority, int(k), alone.priority[:, 0]))
    return merged(track, alone)


def checked_end(match: Match, robot: Robot, end: End) -> End:
    """An end that the robot has, its coordinates as an array.

    Args:
        end: a keypoint, a point of a body or a place [m].

    Raises:
        GraphError: an unknown keypoint or body, or a point without three finite coordinates.
    """
    if isinstance(end, str):
        if end not in match.keypoints:
            raise GraphError(f"no keypoint {end!r}; {known(match.keypoints)}")
        return end
    if isinstance(end, tuple) and len(end) == 2 and isinstance(end[0], str):
        names = [robot.model.body(b).name for b in range(robot.model.nbody)]
        if end[0] not in names:
            raise GraphError(f"{robot.name} has no body {end[0]!r}; {known(names)}")
        return end[0], _place(end[1])
    return _place(np.asarray(end))


def end_name(end: End) -> str:
    """Return an end in words: a keypoint, `body@(x, y, z)` or `(x, y, z)`."""
    if isinstance(end, str):
        return end
    body = end[0] if isinstance(end, tuple) and isinstance(end[0], str) else None
    place = np.asarray(end if body is None else end[1], dtype=float)  # type: ignore[index]
    words = "(" + ", ".join(f"{c:g}" for c in place) + ")"
    return words if body is None else f"{body}@{words}"


def reach_between(match: Match, robot: Robot, ends: tuple[End, End]) -> float:
    """An upper bound of the distance between two ends in any configuration [m]; ∞ where one end is a place in the world.

    The bound is the length of the chain of link origins that joins both ends.

    Args:
        ends: checked ends.
    """
    points = [_carrier(match, robot, end) for end in ends]
    if any(point is None for point in points):
        return np.inf
    (first, one), (second, other) = (point for point in points if point is not None)
    paths = [path_to_root(robot.model.body_parentid, body) for body in (first, second)]
    links = set(paths[0]) ^ set(paths[1])
    model = robot.model
    chain = sum(float(np.linalg.norm(model.body_pos[body])) + 2 * _anchor(robot, body) for body in links)
    return one + other + chain


def body_of(match: Match, robot: Robot, end: End) -> int | None:
    """Return the body that carries a checked end; None of a place in the world."""
    point = _carrier(match, robot, end)
    return None if point is None else point[0]


def _carrier(match: Match, robot: Robot, end: End) -> tuple[int, float] | None:
    """The body that carries an end and the end's distance from the body's origin [m]; None of a place in the world."""
    if isinstance(end, str):
        site = match.anatomy.sites[end]
        return site.body, float(np.linalg.norm(site.offset))
    if isinstance(end, tuple) and isinstance(end[0], str):
        return robot.model.body(end[0]).id, float(np.linalg.norm(np.asarray(end[1], dtype=float)))
    return None


def _anchor(robot: Robot, body: int) -> float:
    """The largest distance of a body's joint anchors from its origin [m]."""
    first = int(robot.model.body_jntadr[body])
    anchors = (
        robot.model.jnt_pos[first : first + int(robot.model.body_jntnum[body])] if first >= 0 else np.zeros((0, 3))
    )
    return float(np.linalg.norm(anchors, axis=1).max(initial=0.0))


def _require_reach(match: Match, robot: Robot, ends: tuple[End, End], lower: float) -> None:
    most = reach_between(match, robot, ends)
    if lower > most:
        a, b = (end_name(end) for end in ends)
        raise GraphError(
            f"edge {a} – {b}: {lower:g} m is beyond the robot's reach; {robot.name} can hold them {most:.2f} m apart at most"
        )


def _interval(name: str, at: float | tuple[float, float]) -> tuple[float, float]:
    try:
        lower, upper = (float(at), float(at)) if np.isscalar(at) else map(float, at)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise GraphError(f"edge {name}: `at` is a distance [m] or a pair (lower, upper) [m], got {at!r}") from None
    if not 0 <= lower <= upper or np.isinf(lower):
        raise GraphError(
            f"edge {name} has the interval {lower:g} … {upper:g} m: the lower bound must be 0 or more, the upper no less"
        )
    return lower, upper


def _span(name: str, frames: tuple[int, int] | None, length: int) -> tuple[int, int]:
    first, last = (0, length - 1) if frames is None else frames
    if int(first) != first or int(last) != last:
        raise GraphError(f"edge {name}: frames are whole numbers, got {first:g} … {last:g}")
    if not 0 <= first <= last < length:
        raise GraphError(f"edge {name}: frames {first} … {last} are not within 0 … {length - 1}")
    return int(first), int(last)


def _refuse_contradiction(track: Track, edge: AddedEdge) -> None:
    if edge.priority < HARD:
        return
    first, last = edge.frames
    for k in np.flatnonzero(track.joins(*edge.names)):
        low, high = track.lower[first, k], track.upper[first, k]
        hard = (track.priority[first : last + 1, k] >= HARD).any()
        if hard and (edge.lower > high or edge.upper < low):
            raise GraphError(
                f"hard edges of {' – '.join(track.ends[k])} contradict each other: {low:g} … {high:g} m and "
                f"{edge.lower:g} … {edge.upper:g} m in the same frames"
            )


def _raised(values: Floats, column: int, at_least: Floats) -> Floats:
    """Return values (T, E) with one column raised to at least (T,)."""
    found = np.array(values)
    found[:, column] = np.maximum(found[:, column], at_least)
    return found


def _place(values: ArrayLike) -> Floats:
    place = np.asarray(values, dtype=float)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise GraphError(f"a point takes three finite coordinates [m], got {values!r}")
    return place
