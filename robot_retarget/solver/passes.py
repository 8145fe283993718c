"""The passes over a clip: frames that step towards a smooth path, and the path through the frames, in turns."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.base.progress import Count
from robot_retarget.graph.track import SECOND_DIFFERENCE, THIRD_DIFFERENCE, Status, Track
from robot_retarget.robot.kinematics import SweptConfiguration, difference, integrate, swept_configurations
from robot_retarget.solver.descent import Box, Descent, FrameSolution
from robot_retarget.solver.limits import Differences, JointBounds, Targets, targets_of
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.quadratic import Proximal
from robot_retarget.solver.smooth import smooth_offsets, within_speeds
from robot_retarget.solver.solution import UNMET
from robot_retarget.solver.sqp import FrameSolver

ROUNDS = 3
"""Rounds in which frames with interpenetrating links are solved again: a frame that clears one link may meet
another."""

SOFTEST = 1.0
"""Stiffness that every direction has at least [1/rad², 1/m²]: with 3, twelve passes of seven clips cost 0.4 to 1.3 % more."""
SOFT = 0.2
"""Share of the frames that are softer than `stiffness` says [-]: with .5, eight passes of a dance cost 1.9 % more on the G1."""


@dataclass(frozen=True, eq=False)
class ClipProblem:
    """The targets of consecutive frames of a graph; the first `fixed` of them are known."""

    solver: FrameSolver
    all_targets: Targets
    smoothing: Smoothing
    smooth: Differences
    """Second differences over T frames ..."""
    jerk: Differences
    """... and third ones."""
    bounds: JointBounds
    """(T, n) of the hinges."""
    fps: float
    fixed: int = 0

    def __len__(self) -> int:
        return len(self.all_targets)

    def box(self, qpos: Floats, frames: Ints) -> Box:
        """Return the angles that the hinges reach at frames (N,) from the frames before and after, at qpos (T, nq)."""
        bounds, box = self.bounds, Box(self.bounds.lower[frames], self.bounds.upper[frames])
        angles, ends = qpos[:, self.solver.robot.qpos_index], (0, len(qpos) - 1)
        near = []
        for shift in (-1, 1):
            other = (frames + shift).clip(*ends)
            reach = bounds.speed[np.maximum(frames, other)] / self.fps  # a frame's speed is that from the frame before
            near.append((angles[other], np.where((other == frames)[:, None], np.inf, reach)))
        return box.around(near)


def clip_of(
    solver: FrameSolver, tracks: Sequence[Track], smoothing: Smoothing, fps: float, fixed: int = 0
) -> ClipProblem:
    """Assemble a clip from tracks.

    Args:
        solver: solves single frames.
        tracks: targets and temporal costs of T frames.
        smoothing: options of the passes.
        fps: frames per second [1/s].
        fixed: number of first frames that are known.
    """
    targets, limits = targets_of(tracks), solver.problem.limits
    smooth, jerk = (limits.differences(targets, stencil) for stencil in (SECOND_DIFFERENCE, THIRD_DIFFERENCE))
    return ClipProblem(solver, targets, smoothing, smooth, jerk, limits.bounds(targets), fps, fixed)


class Passes:
    """The passes over a clip: frames drawn to a smooth path, and the smooth path through the frames, in turns.

    The alternating direction method of multipliers solves  Σ f_t(q_t) + Σ κ ‖s_{t−1} − 2 s_t + s_{t+1} − b_t‖²  subject to
    q_t = s_t: every pass moves each frame by one step against ρ‖q_t ⊖ s_t + y_t‖², then the path s, then the
    multipliers y. Path and multipliers see q_t
    over-relaxed, s_t ⊕ α (q_t ⊖ s_t) [Boyd2011, 3.4.3]. The path moves the sooner the weaker ρ is, and the last pass draws the
    frames to it with a ρ `Smoothing.closing` times as large. Even frames step together, then odd ones, so that the neighbours
    of a stepping frame do not move. After these passes, only frames that still move step (`Smoothing.extra`). The result
    consists of the frames, not of the path, because the frames satisfy all limits.
    """

    def __init__(self, clip: ClipProblem, start: Floats):
        """Begin at configurations (T, nq), slowed down to the joint speeds; no step exceeds them relative to a neighbour.

        The first `fixed` frames stay unchanged.
        """
        robot, self.qpos = clip.solver.robot, start.copy()
        hinges = robot.qpos_index
        self.qpos[:, hinges] = within_speeds(start[:, hinges], clip.bounds.speed[1:] / clip.fps, clip.fixed)
        self.path, self.dual = self.qpos.copy(), np.zeros((len(start), robot.model.nv))
        halves = (np.arange(clip.fixed + k, len(start), 2) for k in (0, 1))
        self.halves = [half for half in halves if half.size]
        self.clip, self.taken = clip, 0
        self.interpenetrating: set[int] | None = None  # not looked for yet
        begin, targets = clip.solver.begin, clip.all_targets
        self.descents = [begin(self.qpos[half], targets.at(half), clip.box(self.qpos, half)) for half in self.halves]
        for descent in self.descents:
            descent.tolerance = clip.smoothing.tolerance
        self.rho = clip.smoothing.proximal * stiffness(np.concatenate([each.base.normal for each in self.descents]))
        self.moving = [np.ones(len(half), dtype=bool) for half in self.halves]

    def renew(self, clip: ClipProblem) -> None:
        """Go on with other targets, from the present frames, path and multipliers."""
        changed = clip.all_targets.differ(self.clip.all_targets)
        self.clip, self.interpenetrating = clip, None
        for half, descent in zip(self.halves, self.descents, strict=True):
            descent.targets = clip.all_targets.at(half)
            clip.solver.renew(descent, np.flatnonzero(changed[half]))

    def take(self, most: int, count: Count) -> None:
        """Take passes until this number is taken, or until no frame moves."""
        for number in range(self.taken, most):
            going = self._step(number)
            self.taken = number + 1
            if number < self.clip.smoothing.passes:
                count.advance(len(self.clip) - self.clip.fixed)
            if not going:
                break

    def finish(self, count: Count) -> list[FrameSolution]:
        """Take the remaining passes, and return the frames with hard edges met, links apart and soles over the floor.

        Args:
            count: receives one step per frame and pass.
        """
        clip, smoothing = self.clip, self.clip.smoothing
        self.take(smoothing.passes + smoothing.extra, count)
        proximal = Proximal(self.path, -self.dual, self.rho)
        poses = _separated(clip, _hard_edges_met(clip, self.poses(), proximal), proximal)
        depth = clip.solver.depths_under_floor(_qpos(poses), clip.all_targets)
        return [clip.solver.raised(pose, float(deep)) for pose, deep in zip(poses, depth, strict=True)]

    def _step(self, number: int) -> bool:
        """Take one pass; return whether frames still move."""
        clip, smoothing = self.clip, self.clip.smoothing
        if number >= smoothing.collision_check and self.interpenetrating is None:
            self.interpenetrating = _interpenetrating(clip, self.qpos)
        if number + 1 == smoothing.passes:
            self.rho, self.dual = smoothing.closing * self.rho, self.dual / smoothing.closing
        self._smooth()
        for half, descent, moving in zip(self.halves, self.descents, self.moving, strict=True):
            active = np.flatnonzero(moving) if number >= smoothing.passes else np.arange(len(half))
            if active.size:
                self._step_half(half, descent, moving, active)
        return any(moving.any() for moving in self.moving) or number + 1 < smoothing.passes

    def _smooth(self) -> None:
        """Move the path and the multipliers."""
        clip, robot = self.clip, self.clip.solver.robot
        away = clip.smoothing.relaxation * difference(robot, self.path, self.qpos)
        relaxed = integrate(robot, self.path, away)  # beyond the path: s ⊕ α (q ⊖ s)
        drawn = integrate(robot, relaxed, self.dual)
        speed = difference(robot, drawn[:-1], drawn[1:])
        offsets = smooth_offsets(
            speed, clip.smooth.weight / self.rho, clip.fixed, clip.smooth.bend, clip.jerk.weight / self.rho
        )
        self.path = integrate(robot, drawn, offsets)
        self.dual += difference(robot, self.path, relaxed)

    def _step_half(self, half: Ints, descent: Descent, moving: Bools, active: Ints) -> None:
        """Step some of the even or odd frames."""
        clip, solver = self.clip, self.clip.solver
        descent.box = clip.box(self.qpos, half)
        descent.proximal = Proximal(self.path[half], -self.dual[half], self.rho)
        if self.interpenetrating:
            descent.between = [_between(clip, self.qpos, t, self.interpenetrating) for t in half.tolist()]
            solver.renew(descent, np.flatnonzero([bool(ways) for ways in descent.between]))
        before = descent.qpos.copy()
        solver.step_frames(descent, active)
        self.qpos[half] = descent.qpos
        moved = np.abs(difference(solver.robot, before, descent.qpos)).max(axis=1)
        tried = (descent.regions.refused > 0) & (descent.regions.refused < solver.options.refusals)
        moving[:] = (tried | (moved >= clip.smoothing.converged)) & (descent.status == Status.OUT_OF_ITERATIONS)

    def poses(self) -> list[FrameSolution]:
        """Return the frames."""
        poses = [FrameSolution(q, Status.CONVERGED, 0.0, 0) for q in self.qpos]
        for half, descent, moving in zip(self.halves, self.descents, self.moving, strict=True):
            descent.status[~moving & (descent.status == Status.OUT_OF_ITERATIONS)] = Status.CONVERGED
            for t, pose in zip(half.tolist(), self.clip.solver.ended(descent), strict=True):
                poses[t] = pose
        return poses


def stiffness(normal: Floats) -> Floats:
    """Return (nv,) the stiffness of a frame's costs in each direction while all others give way: `SOFT` of the frames are softer.

    Args:
        normal: (N, nv, nv) curvatures of the frames.
    """
    inverse = np.linalg.inv(normal + SOFTEST * np.eye(normal.shape[-1]))
    return np.quantile(1 / np.diagonal(inverse, axis1=1, axis2=2), SOFT, axis=0)


def _qpos(poses: Sequence[FrameSolution]) -> Floats:
    return np.array([pose.qpos for pose in poses])


def _between(
    clip: ClipProblem, qpos: Floats, t: int, interpenetrating: Collection[int]
) -> tuple[SweptConfiguration, ...]:
    """Where links are kept apart between a frame and its neighbours: after the frames in `interpenetrating`."""
    neighbours = (qpos[k] for k in (t - 1, t + 1) if min(k, t) in interpenetrating)
    return tuple(way for q in neighbours for way in swept_configurations(clip.solver.robot, q, qpos[t]))


def _interpenetrating(clip: ClipProblem, qpos: Floats, moved: Ints | None = None) -> set[int]:
    """Return the frames t with links inside each other between t and t + 1; only those at frames that moved, if given."""
    first, last, solver = max(clip.fixed - 1, 0), len(qpos) - 1, clip.solver
    asked = np.arange(first, last) if moved is None else np.unique(np.clip([moved - 1, moved], first, last - 1))
    deep = solver.depths_between(qpos[asked], qpos[asked + 1]) > solver.options.overlap
    return set(asked[deep].tolist())


def _hard_edges_met(clip: ClipProblem, poses: list[FrameSolution], proximal: Proximal) -> list[FrameSolution]:
    """Return the poses; those that miss a hard edge are solved to the end, because one step per pass may be too few.

    Rounds go on at frames that miss less than before, and at their neighbours: other costs hold the rest.
    """
    before = np.full(len(poses), np.inf)
    for _ in range(ROUNDS):
        missed = clip.solver.problem.missed(_qpos(poses), clip.all_targets)
        falls = missed < before
        near = falls | np.append(falls[1:], False) | np.append(False, falls[:-1])
        missing = np.flatnonzero((missed > UNMET / 2) & near)
        missing, before = missing[missing >= clip.fixed], missed
        if not missing.size:
            break
        poses = _solved_again(clip, poses, missing, proximal)
    return poses


def _solved_again(
    clip: ClipProblem,
    poses: list[FrameSolution],
    frames: Ints,
    proximal: Proximal,
    interpenetrating: Collection[int] = (),
) -> list[FrameSolution]:
    """Return the poses with some frames solved to the end: even frames together, then odd ones."""
    poses, solver = list(poses), clip.solver
    for half in (frames[frames % 2 == 0], frames[frames % 2 == 1]):
        if not half.size:
            continue
        qpos = _qpos(poses)
        ways = [_between(clip, qpos, t, interpenetrating) for t in half.tolist()]
        found = solver.solve_frames(
            qpos[half],
            clip.all_targets.at(half),
            proximal=proximal.at(half),
            box=clip.box(qpos, half),
            between=ways if any(ways) else None,
        )
        for t, pose in zip(half.tolist(), found, strict=True):
            if not interpenetrating or solver.depth(pose.qpos) <= solver.depth(poses[t].qpos):
                poses[t] = pose
    return poses


def _separated(clip: ClipProblem, poses: list[FrameSolution], proximal: Proximal) -> list[FrameSolution]:
    """Return the poses with links apart, at frames and between them, if such poses are found.

    If links interpenetrate between two frames, both are solved again with separation rows on the way between them, and taken
    if their links overlap less. A frame whose links still interpenetrate moves back towards
    the frame before, and the frames after it catch up at the largest speeds, through links where no way is clear.
    """
    frames = None
    for _ in range(ROUNDS):
        between = _interpenetrating(clip, _qpos(poses), frames)
        frames = np.array(sorted({t for k in between for t in (k, k + 1) if t >= clip.fixed}), dtype=int)
        if not frames.size:
            break
        poses = _solved_again(clip, poses, frames, proximal, between)
    return _caught_up(clip, poses)


def _caught_up(clip: ClipProblem, poses: list[FrameSolution]) -> list[FrameSolution]:
    """Return the poses with overlapping frames moved back towards the frame before, and the frames after them within the joint speeds."""
    solver, robot, reach, behind = clip.solver, clip.solver.robot, clip.bounds.speed / clip.fps, False
    overlapping = solver.costs.overlap(_qpos(poses)) > solver.options.overlap
    for t in range(max(clip.fixed, 1), len(poses)):
        before, late = poses[t - 1].qpos, poses[t]
        way = difference(robot, before, late.qpos)
        share = float((reach[t] / np.maximum(np.abs(way[robot.dof_index]), reach[t])).min())
        behind = overlapping[t] or (behind and share < 1 - 1e-9)
        if behind:
            late = replace(late, qpos=integrate(robot, before, share * way))
            clear = solver.backtrack_to_clearance(before, late)
            poses[t] = late if (clear.qpos == before).all() and not overlapping[t] else clear
    return poses
