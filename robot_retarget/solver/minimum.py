"""The minimum of a whole clip: Gauss–Newton steps that move all frames at once.

    minimise  Σ_t f_t(q_t) + Σ κ ‖Δ²q − b‖² + Σ λ ‖Δ³q‖²   within ranges and joint speeds, links apart, soles over the floor

Every step linearises all frames and minimises the whole clip's convex model (`clip_step`). Damping belongs to
frames: one difficult frame slows down its neighbours only. Inequalities are penalties on the way; the end meets them exactly.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation

from robot_retarget.base.arrays import Bools, Floats, Ints, smoothstep
from robot_retarget.base.progress import Count
from robot_retarget.graph.track import Status
from robot_retarget.robot.kinematics import SweptConfiguration, difference, integrate, swept_configurations
from robot_retarget.solver.banded import BandedSystem, FrameCoupling
from robot_retarget.solver.clip_model import LEAST, ClipModel, ClipProblem
from robot_retarget.solver.clip_step import ABSENT, PRICE, Room, StepProgram, StepRows
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.near_links import NearLinks
from robot_retarget.solver.quadratic import Quadratic, diagonal

# In brackets: the change of the cost [%] with half and with double of a number, the range over two clips on the G1 and two on the OP3.

ROUNDS = 3
"""Rounds in which links that pass through each other between frames are kept apart there, measured on clips that need them: links
that clear one may meet another ..."""
APART_STEPS = 4
"""... and steps of each [-]; half and double change the cost of four claps on the OP3 by less than 0.1 %."""
STARTING = 0.3
"""Gap with which a step's program starts, over the cost: programs that start near their end move in tiny steps [-] (-0.1 … 0.1;
0) ..."""
GAINED = 10.0
"""... and over the gain of the step before, if that is more [-] (-0.1 … 0.3; 0 … 0.1)."""
FLOOR_PRICE = 0.1
"""Price of a sole under the floor over that of links in each other [-]: the root is raised at the end (-0.1 … 0.4; -0.1 … 0.1)."""
EARLIER = 3
"""Measurements of links that a frame keeps besides its last. Twelve clips on the OP3 and the G1 take 61, 54 and 52 linearisations and
54, 52 and 55 factorisations a frame with 1, with this and with 6, at the same cost within 0.2 % ..."""
DISTINCT = 0.1
"""... and the share by which a slope differs at least from those of the present rows, to have a row of its own [-]: equal rows slow
the program down. A clap on the OP3 takes 97, 45 and 30 factorisations a frame with half, with this and with double, two clips on the
G1 take 44, 50 and 49, of which double costs 0.2 % more."""
TOUCHING_TRUST = 0.1
"""Trust region of a frame whose links lack their margin [rad]; twice this for the root [rad, m]: a hand of .05 m at the end of an arm of
.5 m does not pass another one in a step. With .2, claps end 10 % dearer and on either side of their mirror image."""
EASIER = 4.0
"""Factor by which a frame's damping grows or shrinks in a step at most [-]; [Nielsen1999] has 3 for the latter ..."""
STIFFER = 0.1
"""... and its additional growth [1/rad²] (-0.1 … 0.1; 0 … 0.2)."""
SHORTER = 0.4
"""Share of a step that is kept where it raised the cost [-] (0 … 0.1; 0 … 0.3) ..."""
BESIDE = 0.2
"""... and time to the frames that keep all of it [s] (-0.1 … 0.4; -0.1 … 0)."""


class ClipMinimum:
    """Steps towards the minimum of a clip."""

    qpos: Floats
    """(T, nq) the path."""

    def __init__(self, clip: ClipProblem, start: Floats, near: NearLinks | None = None):
        """Begin at configurations (T, nq), brought within ranges and joint speeds; the first `fixed` stay unchanged.

        Args:
            near: distances of links that are known, of the first frames that move.
        """
        self.clip, self.qpos, count = clip, clip.limited(start), len(clip) - clip.fixed
        self.damping = np.full(count, clip.solver.options.damping)
        self.moved = np.full(count, np.inf)
        self.through: frozenset[int] = frozenset()
        """The frames after which links would pass through each other."""
        self.taken = 0
        self._couple()
        self.model = self._linearised(self.qpos, near)
        self.gained = self.model.total

    def renew(self, clip: ClipProblem) -> None:
        """Go on with other targets, from the present path."""
        changed = clip.all_targets.differ(self.clip.all_targets)[clip.fixed :]
        self.clip = clip
        self._couple()
        self._relinearize(self.model.frames, self.qpos, changed)
        before = self.model.total
        self.model = self._assembled(self.qpos, self.model.frames)
        self.gained = max(self.gained, self.model.total - before)

    def take(self, steps: int, count: Count) -> bool:
        """Take a number of steps at most; return whether the minimum is reached: two steps in a row gain too little."""
        counts, near = True, self.model.frames.near
        if near.before is None:
            near.keep(EARLIER)
        for _ in range(steps):
            step, promised = self._minimised()
            if promised < self._least:
                return True
            before, counts = counts, self._accept(step) >= self._least
            if not (before or counts):
                return True
            self.taken += 1
            count.advance(len(self.damping))
        return False

    def step(self) -> None:
        """Take one step without a check of the cost: the real-time iteration of [Diehl2005], from a path near the minimum."""
        step, _ = self._minimised()
        self.qpos = self._moved(step)

    @property
    def _least(self) -> float:
        """The gain of a step that counts."""
        return self.clip.smoothing.gain * self.model.typical

    def _couple(self) -> None:
        clip, directions = self.clip, self.clip.solver.robot.model.nv
        self.coupling = FrameCoupling(clip.differences, len(clip), directions).after(clip.fixed)
        self._system = BandedSystem(len(clip) - clip.fixed, directions, len(self.coupling.diagonals) - 1)

    def _accept(self, step: Floats) -> float:
        """Take a step (M, nv) if it lowers the cost, shortened around frames whose cost rises; return its gain."""
        model, rose, path = self.model, np.zeros(len(step), dtype=bool), self._moved(step)
        frames = self._frames(path, np.arange(len(step)), model.frames.near)
        for left in reversed(range(self.clip.smoothing.tries)):
            trial = self._assembled(path, frames)
            rise = trial.cost - model.cost
            if trial.total < model.total:
                self._adapt(np.where(rose, np.inf, model.surprise(step, trial.own)))
                self.gained, self.qpos, self.model = model.total - trial.total, path, trial
                self.moved = np.abs(step).max(axis=1)
                return self.gained
            worst = (rise > 0) & (rise >= np.maximum(rise, 0.0).mean())
            rose |= worst
            if not (left and worst.any()):
                break
            shares = _shares(worst, self.clip.fps)
            step = step * shares[:, None]
            path = self._moved(step)
            self._relinearize(frames, path, shares < 1)
        self._adapt(np.where(rose, np.inf, 0.5))
        return 0.0

    def _moved(self, step: Floats) -> Floats:
        """Return the path (T, nq) after a step (M, nv)."""
        path, first = self.qpos.copy(), self.clip.fixed
        path[first:] = integrate(self.clip.solver.robot, path[first:], step)
        return path

    def _adapt(self, surprise: Floats) -> None:
        """Damp the next step at frames whose costs differ from the model's, and free the others [Nielsen1999]."""
        factor = np.clip(1 - (1 - 2 * surprise) ** 3, 1 / EASIER, EASIER)
        self.damping = np.maximum(factor * self.damping + STIFFER * np.maximum(factor - 1, 0), LEAST)

    def _minimised(self) -> tuple[Floats, float]:
        """Return the step (M, nv) that minimises the model within trust regions, and its gain."""
        model = self.model
        normal = np.array(model.frames.normal, order="C")
        diagonal(normal)[:] += self.damping[:, None]
        program = StepProgram(model.gradient, normal, self.coupling, self._with_earlier(model), self._room(model))
        gap, least = max(STARTING * model.typical, GAINED * self.gained), self._least
        step, gained, factors = program.minimised(self._system, gap, least)
        self.clip.solver.costs.work["factorised"] += factors * len(step)
        return step, gained

    def _room(self, model: ClipModel) -> Room:
        clip, robot, first = self.clip, self.clip.solver.robot, self.clip.fixed
        overlapping = (model.rows.links & (model.rows.lower > 0.0)).any(axis=1, keepdims=True)
        radius = np.where(overlapping, TOUCHING_TRUST, clip.solver.options.trust_region)
        upper = np.tile(2 * radius, robot.model.nv)
        lower, angles = -upper, self.qpos[first:, robot.qpos_index]
        lower[:, robot.dof_index] = (clip.bounds.lower[first:] - angles).clip(-radius, radius)
        upper[:, robot.dof_index] = (clip.bounds.upper[first:] - angles).clip(-radius, radius)
        reach = clip.reach[first:].copy()
        if not first:
            reach[0] = ABSENT
        return Room(lower, upper, -reach - model.changes, reach - model.changes, robot.dof_index)

    def _linearised(self, path: Floats, near: NearLinks | None) -> ClipModel:
        """Return the model at a path (T, nq); distances of links measured nearby are extrapolated."""
        return self._assembled(path, self._frames(path, np.arange(len(self.damping)), near))

    def _relinearize(self, models: Quadratic, path: Floats, changed: Bools) -> None:
        """Renew the models of the moving frames (M,) that have changed; with them those whose ways to a changed frame have rows."""
        frames = np.flatnonzero(binary_dilation(changed) if self.through else changed)
        if frames.size:
            models.put(frames, self._frames(path, frames, models.near), np.ones(len(frames), dtype=bool))

    def _frames(self, path: Floats, frames: Ints, near: NearLinks | None) -> Quadratic:
        """Return the models of some of the moving frames."""
        clip, own = self.clip, self.clip.fixed + frames
        ways = [_between(clip, path, t, self.through) for t in own.tolist()] if self.through else None
        whole = near is not None and len(frames) == len(near)
        near = near if whole else near and near.of(frames[frames < len(near)])
        return clip.solver.costs.linearize(path[own], clip.all_targets.at(own), ways, near)

    def _assembled(self, path: Floats, frames: Quadratic) -> ClipModel:
        """Add differences and penalties to the models of single frames."""
        clip, solver, first = self.clip, self.clip.solver, self.clip.fixed
        speed = difference(solver.robot, path[:-1], path[1:])
        cost, gradient = np.zeros(len(clip)), np.zeros((len(clip), solver.robot.model.nv))
        for each in clip.differences:
            each.added(speed, cost, gradient)
        changes = np.zeros((len(clip), len(solver.hinges)))
        changes[1:] = speed[:, solver.hinges]
        rows = self._rows(frames)
        beyond = np.maximum(np.abs(changes) - clip.reach, 0.0)[first:]
        own = frames.cost - solver.options.overlap_cost * frames.clearance_deficit**2 + rows.penalties()
        total = own + cost[first:] + PRICE * (beyond**2).sum(axis=1)
        return ClipModel(total, own, gradient[first:] + frames.gradient, frames, rows, changes[first:])

    def _rows(self, frames: Quadratic, earlier: Sequence[tuple[Floats, Floats]] = ()) -> StepRows:
        """Return the rows of links and soles that a step can reach, and slopes (T, C, nv) and deficits (T, C) of earlier ones."""
        solver, hard = self.clip.solver, len(self.clip.solver.problem.inequalities)
        every = (frames.rows[..., :-1], frames.row_lower), *earlier
        slope, lower = (np.concatenate(part, axis=1) for part in zip(*every, strict=True))
        links = np.broadcast_to(np.arange(lower.shape[1]) >= hard, lower.shape)
        lower = lower - np.where(links, solver.options.tolerated * solver.leg, 0.0)
        lower = np.where(lower < -solver.options.reach * solver.leg, -ABSENT, lower)
        most = max(int((lower > -ABSENT).sum(axis=1).max(initial=0)), 1)
        place = np.arange(len(lower))[:, None], np.argsort(-lower, axis=1, kind="stable")[:, :most]
        shared = solver.options.overlap_cost / solver.leg**2
        price = np.where(links[place], shared, FLOOR_PRICE * shared)
        return StepRows(slope[place], lower[place], price, links[place], shared)

    def _with_earlier(self, model: ClipModel) -> StepRows:
        """Return the rows, and at damped frames those of links as measured nearby before, no deeper than they are now.

        A link that turns about an edge or a corner has other slopes on the other side: one linearisation alone leads back and forth.
        """
        damped, frames = self.damping > self.clip.solver.options.damping, model.frames
        if frames.near.before is None or not damped.any():
            return model.rows
        hard, parts = len(self.clip.solver.problem.inequalities), []
        now = frames.row_lower[:, hard:].max(axis=1, initial=0.0)[:, None]
        for near in frames.near.measurements():
            moved, deficit = near.extrapolated(self.clip.solver.robot, self.qpos[self.clip.fixed :])
            nearby = (damped & (moved <= TOUCHING_TRUST))[:, None]
            other = nearby & (_apart(near.slope, frames.rows[:, hard:, :-1]) > DISTINCT)
            parts.append((near.slope, np.where(other, np.minimum(deficit, now), -np.inf)))
        return self._rows(frames, parts)

    def finish(self, count: Count) -> list[FrameSolution]:
        """Take steps to the minimum; return the frames within all limits: links apart between frames too, soles over the floor."""
        most = self.clip.smoothing.steps
        ended = self.take(most, count)
        for _ in range(ROUNDS):
            if not self.keep_apart():
                break
            ended = self.take(APART_STEPS, count)
        return self._closed(ended)

    def keep_apart(self) -> bool:
        """Keep links apart between frames where they pass through each other; return whether more of them do."""
        more = _interpenetrating(self.clip, self.qpos) - self.through
        if more:
            self.through |= more
            self.model = self._linearised(self.qpos, None)
        return bool(more)

    def _closed(self, ended: bool) -> list[FrameSolution]:
        """Return the frames with closed chains, within all limits."""
        clip, solver, base = self.clip, self.clip.solver, self.model.frames
        converged = (self.moved < clip.smoothing.converged) | ended
        poses = [FrameSolution(q, Status.CONVERGED, 0.0, 0) for q in clip.limited(self.qpos)]
        ends = zip(range(clip.fixed, len(clip)), base.cost, converged, base.clearance_deficit, strict=True)
        for t, cost, done, lacking in ends:
            status = Status.CONVERGED if done else Status.OUT_OF_ITERATIONS
            pose = FrameSolution(poses[t].qpos, status, float(cost), self.taken, float(lacking))
            poses[t] = solver.closed(pose)
        poses = _caught_up(clip, poses)
        depth = solver.depths_under_floor(np.array([pose.qpos for pose in poses]), clip.all_targets)
        depth[: clip.fixed] = 0.0
        return [solver.raised(pose, float(deep)) for pose, deep in zip(poses, depth, strict=True)]


def _apart(slopes: Floats, others: Floats) -> Floats:
    """Return (T, E) how far slopes (T, E, nv) are from the nearest of others (T, C, nv), over their length."""
    length = (slopes**2).sum(axis=-1)
    nearest = ((others**2).sum(axis=-1)[:, None] - 2 * slopes @ others.swapaxes(1, 2)).min(axis=2, initial=0.0)
    return np.sqrt((1 + nearest / np.maximum(length, 1e-12)).clip(0.0))


def _shares(chosen: Bools, fps: float) -> Floats:
    """Return the share of a step that each frame takes: `SHORTER` at chosen frames, and all of it `BESIDE` away."""
    away = np.abs(np.arange(len(chosen))[:, None] - np.flatnonzero(chosen)).min(axis=1)
    return SHORTER + (1 - SHORTER) * smoothstep(np.minimum(away / (BESIDE * fps), 1.0))


def _between(clip: ClipProblem, qpos: Floats, t: int, through: Collection[int]) -> tuple[SweptConfiguration, ...]:
    """Where links are kept apart between a frame and its neighbours: after the frames in `through`."""
    neighbours = (qpos[k] for k in (t - 1, t + 1) if min(k, t) in through)
    return tuple(way for q in neighbours for way in swept_configurations(clip.solver.robot, q, qpos[t]))


def _interpenetrating(clip: ClipProblem, qpos: Floats) -> frozenset[int]:
    """Return the frames t with links inside each other between t and t + 1."""
    solver, asked = clip.solver, np.arange(max(clip.fixed - 1, 0), len(qpos) - 1)
    deep = solver.depths_between(qpos[asked], qpos[asked + 1]) > solver.options.overlap
    return frozenset(asked[deep].tolist())


def _caught_up(clip: ClipProblem, poses: list[FrameSolution]) -> list[FrameSolution]:
    """Return the poses with overlapping frames moved back towards the frame before, and the frames after them within the joint speeds."""
    solver, robot, reach, behind = clip.solver, clip.solver.robot, clip.reach, False
    overlapping = solver.costs.overlap(np.array([pose.qpos for pose in poses])) > solver.options.overlap
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
