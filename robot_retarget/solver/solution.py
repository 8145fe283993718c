"""The result of a solver: the trajectory, the quality of each frame and each edge, and hard edges that it misses."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.graph import EdgeError
from robot_retarget.graph.track import HARD, Status, Track
from robot_retarget.robot.kinematics import integrate
from robot_retarget.robot.model import AT_SPEED_BOUND
from robot_retarget.scores.physics import JUMP
from robot_retarget.solver.limits import JointBounds, Targets, targets_of
from robot_retarget.solver.problem import Problem
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.trajectory import Trajectory


@dataclass(frozen=True)
class UnmetEdge:
    """A hard edge and the frames at which it misses its interval."""

    kind: str
    name: str
    frames: tuple[int, ...]
    """The frames that miss it."""
    frame: int
    """The frame of the largest miss."""
    measured: float
    """The measure there [m]."""
    lower: float
    upper: float
    """The interval there [m]."""
    reasons: tuple[str, ...]
    """Limits that are active there; may be empty."""
    by_user: bool = False
    """Whether a user added the edge."""

    def later(self, frames: int) -> "UnmetEdge":
        """Return the finding of a part of a clip that begins a number of frames later."""
        return replace(self, frames=tuple(t + frames for t in self.frames), frame=self.frame + frames)

    @property
    def sentence(self) -> str:
        """Return the finding as a sentence."""
        asked = f"{self.lower:.3g} … {self.upper:.3g} m"
        if self.lower == self.upper or np.isinf(self.upper):
            asked = f"{self.lower:.3g} m" + (" or more" if self.lower < self.upper else "")
        elif np.isinf(self.lower):
            asked = f"{self.upper:.3g} m or less"
        first, last, count = self.frames[0], self.frames[-1], len(self.frames)
        when = f"frame {first}" if count == 1 else f"{count} frames of {first} … {last}"
        why = "; ".join(self.reasons) or "other edges oppose it"
        return f"hard edge {self.name}: {self.measured:.3f} m at frame {self.frame} instead of {asked}, unmet in {when}: {why}"


def unmet_of_user(unmet: Iterable[UnmetEdge]) -> list[str]:
    """Return a sentence for each edge of a user among the unmet ones."""
    return list(dict.fromkeys(edge.sentence for edge in unmet if edge.by_user))


@dataclass(frozen=True, eq=False)
class Solution:
    """A trajectory with its quality: the end of each frame, the cost of each edge, and the place of that cost."""

    trajectory: Trajectory
    graph: RobotGraph
    status: tuple[Status, ...]
    cost: Floats
    """(T,) the minimised cost at the returned configurations: Σ over kinds of `stress`."""
    stress: Mapping[str, Floats]
    """Per kind (T,) its part of the cost."""
    measured: Mapping[str, Floats]
    """Per kind with edges (T, E) the measures [m] or [rad]."""
    iterations: Ints
    """(T,) steps of the quadratic program."""
    timings: dict[str, float] = field(default_factory=dict)
    """Seconds spent, by stage."""
    work: Mapping[str, float] = field(default_factory=dict)
    """Per frame, how often it was linearised and its links measured, its quadratic programs, and its share of factorised bands."""
    native: bool = False
    """Whether machine code evaluated the problem, not CasADi's virtual machine; the results are the same."""
    unmet: tuple[UnmetEdge, ...] = ()
    """The hard edges that miss their interval, with the limits that prevent it."""

    def errors(self, kind: str) -> Floats:
        """Return (T, E) signed errors (d − y)/scale of a kind's edges [-]."""
        return self.graph.kinds[kind].errors(self.measured[kind])

    def __repr__(self) -> str:
        return f"<Solution {self.trajectory!r}: {self.ended}, cost {self.cost.mean():.4g} a frame>"

    @property
    def ended(self) -> str:
        """How the frames ended, with their numbers, in one line."""
        counted = Counter(status.name.replace("_", " ").lower() for status in self.status)
        return ", ".join(f"{n} {name}" for name, n in counted.items())

    @property
    def unfinished(self) -> float:
        """Share of the frames that the solver left before convergence."""
        return sum(one in (Status.OUT_OF_ITERATIONS, Status.BLOCKED) for one in self.status) / len(self.status)

    @property
    def posture_error(self) -> Floats:
        """Return (T,) the mean of |d − δ|/τ over the posture edges."""
        return np.abs(self.errors("posture")).mean(axis=1) if "posture" in self.measured else np.zeros(len(self.cost))

    def largest_step(self) -> float:
        """Return the largest change of one hinge between two frames [rad]; it shows a jump."""
        hinges = self.trajectory.angles
        return float(np.abs(np.diff(hinges, axis=0)).max(initial=0.0))

    def jumps(self) -> list[tuple[str, int, float]]:
        """Return changes of a hinge faster than `JUMP`, largest first: joint, the frame at its end, step [rad]."""
        names = self.trajectory.joint_names
        steps = np.diff(self.trajectory.angles, axis=0)
        frames, joints = np.nonzero(np.abs(steps) > JUMP / self.trajectory.fps)
        order = np.argsort(-np.abs(steps[frames, joints]))
        return [(names[joints[k]], int(frames[k]) + 1, float(steps[frames[k], joints[k]])) for k in order]

    def costliest(self, count: int = 8) -> list[EdgeError]:
        """Return the edges with the largest cost over the clip, each at its worst frame."""
        return self.graph.costliest(self.measured, count)

    def edge_stress(self, kind: str) -> Floats:
        """(T, E) π ϱ(e) of a kind's edges."""
        return self.graph.kinds[kind].stress(self.measured[kind])


UNMET = 1e-3
"""A hard edge that misses its interval by more is reported [m]: `HARD` gives way by 5e-5 of a leg, 0.04 mm on the
G1."""
PROBE = 1e-5
"""Step of the finite differences of a measure [rad]: that of least error of a central difference, the cube root of the
rounding of 2e-16."""
STATIONARY = 0.01
"""A measure with smaller slopes by all joints does not change [m/rad]."""
AT_BOUND = AT_SPEED_BOUND
"""A joint is at its bound within this [rad], a speed within this share of its limit [-], links within this of their margin [m]."""
MATTERS = 0.1
"""A joint is named whose slope is at least this share of the largest [-]."""


def unmet_edges(
    solver: FrameSolver,
    graph: RobotGraph,
    measured: Mapping[str, Floats],
    qpos: Floats,
    stood: Sequence[Track] = (),
) -> tuple[UnmetEdge, ...]:
    """The hard edges and symbolic inequalities that miss their interval by more than `UNMET`, the largest miss first.

    Args:
        measured: per kind (T, E) values of the edges [m].
        qpos: (T, nq) the solution.
        stood: the tracks with no foot freed: a freed foot misses the place where it would stand.
    """
    plans = {track.name: track for track in stood}
    problem, found = solver.problem, []
    below = problem.inequalities.values(qpos)
    values = {**measured, **{name: below[:, own] for name, own in problem.inequalities.columns.items()}}
    for track in (graph.kinds[name] for name in values):
        value, plan = values[track.name], plans.get(track.name, track)
        hard, freed = track.present & (plan.priority >= HARD), track.priority < HARD
        lower, upper = np.where(freed, plan.lower, track.lower), np.where(freed, plan.upper, track.upper)
        miss = np.where(hard, np.abs(value - np.clip(value, lower, upper)), 0.0)
        for edge in np.flatnonzero(miss.max(axis=0, initial=0.0) > UNMET):
            worst, frames = int(miss[:, edge].argmax()), np.flatnonzero(miss[:, edge] > UNMET)
            interval = float(lower[worst, edge]), float(upper[worst, edge])
            reached = float(value[worst, edge])
            error = reached - float(np.clip(reached, *interval))
            reasons = reasons_against(solver, graph, qpos, (track, int(edge)), worst, error)
            name, missed = track.edge_name(int(edge)), tuple(frames.tolist())
            unmet = UnmetEdge(track.name, name, missed, worst, reached, *interval, reasons, track.kind.by_user)
            found.append((float(miss[worst, edge]), unmet))
    return tuple(unmet for _, unmet in sorted(found, key=lambda each: -each[0]))


def reasons_against(
    solver: FrameSolver, graph: RobotGraph, qpos: Floats, edge: tuple[Track, int], t: int, error: float
) -> tuple[str, ...]:
    """Return the limits that keep an edge from its interval at a frame; none if other edges do.

    Args:
        qpos: (T, nq) the solution.
        edge: its track and its column there.
        t: the frame.
        error: its measure minus the nearest end of the interval.
    """
    targets = targets_of(graph.tracks)
    bounds, away = solver.problem.limits.bounds(targets), -np.sign(error) * _slope(solver, qpos, t, *edge)
    return tuple(_reasons(solver, graph.fps, bounds, targets.at(t), qpos, t, away))


def _reasons(
    solver: FrameSolver, fps: float, bounds: JointBounds, targets: Targets, qpos: Floats, t: int, away: Floats
) -> Iterator[str]:
    """The limits that are active at a frame and oppose a motion of the hinges (n,) towards an interval."""
    robot, away = solver.robot, np.where(bounds.lower[t] < bounds.upper[t], away, 0.0)
    if np.abs(away).max(initial=0.0) < STATIONARY:
        yield "no joint brings it closer: the distance is at its extremum"
        return
    angles, reach = qpos[:, robot.qpos_index], bounds.speed / fps
    for k in np.argsort(-np.abs(away)):
        if np.abs(away[k]) < MATTERS * np.abs(away).max():
            break
        bound = (bounds.upper if away[k] > 0 else bounds.lower)[t, k]
        if (bound - angles[t, k]) * np.sign(away[k]) < AT_BOUND:
            yield f"{robot.joint_names[k]} is at its joint range ({np.degrees(bound):.0f}°)"
        elif _at_speed(angles, reach, t, int(k), float(np.sign(away[k]))):
            yield f"{robot.joint_names[k]} is at its speed limit ({bounds.speed[t, k]:.1f} rad/s)"
    yield from _links(solver, targets, qpos[t], away)
    yield from _floor(solver, targets, qpos[t], away)


def _slope(solver: FrameSolver, qpos: Floats, t: int, track: Track, edge: int) -> Floats:
    """(n,) how an edge's measure at a frame changes with the hinges, by central differences."""
    step = np.zeros((len(solver.hinges), solver.robot.model.nv))
    step[np.arange(len(step)), solver.hinges] = PROBE
    probes = integrate(solver.robot, np.tile(qpos[t], (2 * len(step), 1)), np.concatenate([step, -step]))
    ahead, behind = np.split(_measured(solver.problem, track.name, probes)[:, edge], 2)
    return (ahead - behind) / (2 * PROBE)


def _measured(problem: Problem, kind: str, probes: Floats) -> Floats:
    """Return the measures (N, E) of a kind at configurations (N, nq)."""
    if kind in problem.inequalities.columns:
        return problem.inequalities.values(probes)[:, problem.inequalities.columns[kind]]
    return problem.values(probes)[:, problem.columns[kind]]


def _at_speed(angles: Floats, reach: Floats, t: int, joint: int, sign: float) -> bool:
    """Whether a joint's speed limit to a neighbour frame keeps it from moving further in a direction."""
    neighbours = [
        (angles[k, joint], reach[own, joint]) for k, own in ((t - 1, t), (t + 1, t + 1)) if 0 <= k < len(angles)
    ]
    return any(sign * (angles[t, joint] - other) > (1 - 10 * AT_BOUND) * most for other, most in neighbours)


def _links(solver: FrameSolver, targets: Targets, q: Floats, away: Floats) -> Iterator[str]:
    """Pairs of links at their separation margin that a motion of the hinges (n,) brings nearer."""
    near = solver.costs.near(q, targets)
    if near is None:
        return
    opposing = (-near.deficit < AT_BOUND) & (near.slope[:, solver.hinges] @ away < 0)
    ends = [pair for track in solver.problem.tracks for pair in track.ends]
    for a, b in sorted({ends[edge] for edge in near.edges[opposing]}):
        yield f"{a} and {b} are at their separation"


def _floor(solver: FrameSolver, targets: Targets, q: Floats, away: Floats) -> Iterator[str]:
    """The lowest point on the floor, of those that a motion of the hinges (n,) lowers."""
    problem, (slopes, deficit) = solver.problem, solver.problem.inequalities.rows(q, targets)
    ends = [end for track in problem.tracks if track.name in problem.inequalities.columns for end in track.ends]
    opposing = (-deficit < AT_BOUND) & (slopes[:, solver.hinges] @ away < 0)
    for k in np.flatnonzero(opposing[: len(problem.inequalities.below)])[:1]:
        yield " is on the ".join(ends[problem.inequalities.below[k]])
