"""The whole clip at once: a coarse path through the candidates, then the smooth path all frames agree on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.phase import CoarsePhase, Phase, SolvedPhase
from robot_retarget.graph.role import SECOND_DIFFERENCE
from robot_retarget.graph.status import Status
from robot_retarget.graph.track import Track, concatenated
from robot_retarget.progress import Count
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.swept import SweptConfiguration, swept_configurations
from robot_retarget.solve.candidates import coarse_path
from robot_retarget.solve.limits import JointBounds
from robot_retarget.solve.options import Search, Smoothing
from robot_retarget.solve.problem import ClipTargets, Problem, targets_of
from robot_retarget.solve.quadratic import Proximal
from robot_retarget.solve.smooth import smooth_offsets
from robot_retarget.solve.speeds import within_speeds
from robot_retarget.solve.sqp import Box, FrameSolution, FrameSolver
from robot_retarget.solve.windows import ClipPiece

ROUNDS = 3
"""Rounds in which frames with interpenetrating links are solved again: a frame that clears one link may meet
another."""

COARSE = 4
"""The coarse path takes about as long as this number of passes; the progress counts it as such."""

LOOSE = 5e-4
"""A hard edge that misses its interval by more is solved again [m]."""


@dataclass(frozen=True, eq=False)
class ClipProblem:
    """The targets of consecutive frames of a graph; the first `fixed` of them are known."""

    solver: FrameSolver
    all_targets: ClipTargets
    smoothing: Smoothing
    smooth: Floats
    """(T, nv) π of squared second differences, per tangent direction."""
    inertia: Floats
    """(nv,) weight of the tangent directions against each other, 1 for hinges [-]."""
    bounds: JointBounds
    """(T, n) of the hinges."""
    fps: float
    fixed: int = 0

    def __len__(self) -> int:
        return len(self.all_targets)

    def box(self, poses: Sequence[FrameSolution], t: int) -> Box:
        """Return the angles that the hinges reach at a frame from the poses before and after it."""
        index, bounds = self.solver.robot.qpos_index, self.bounds
        near = [(t - 1, t), (t + 1, t + 1)]  # the speed of a frame is that from the frame before
        reach = [(poses[k].qpos[index], bounds.speed[own] / self.fps) for k, own in near if 0 <= k < len(poses)]
        return Box(bounds.lower[t], bounds.upper[t]).around(reach)


def clip_poses(
    solver: FrameSolver,
    graph: RobotGraph,
    search: Search,
    smoothing: Smoothing,
    count: Count,
    part: ClipPiece | None = None,
) -> tuple[list[FrameSolution], RobotGraph]:
    """Solve the windows in order. Returns poses and the graph with renewed tracks (`Kind.renewed`).

    Args:
        part: which windows, after which known frames; by default all windows of the graph.
    """
    known = part.known if part else ()
    poses = [FrameSolution(q, Status.CONVERGED, 0.0, 0) for q in known]
    asked: list[list[Track]] = []
    windows = part.windows if part else tuple(smoothing.windows.cut(len(graph), graph.fps))
    count.expect((smoothing.passes + COARSE) * sum(w.last - w.first - w.fixed for w in windows))
    for window in windows:
        own, before = graph.frames(window.first, window.last), [pose.qpos for pose in poses[window.first :]]
        coarse = coarse_path(solver, own, targets_of(coarse_tracks(own)), search, before)
        count.advance(COARSE * (len(own) - window.fixed))
        tracks = renewed_tracks(solver, own, coarse, window.fixed)
        clip = clip_of(solver, tracks, smoothing, graph.fps, window.fixed)
        kept = slice(window.fixed, window.final - window.first)
        poses += [replace(pose, model=None) for pose in clip_passes(clip, coarse, count)[kept]]
        asked.append([track.at(kept) for track in tracks])
    solved = graph if part is None else graph.at(slice(len(known), len(poses)))
    renewed = tuple(concatenated(parts) for parts in zip(*asked, strict=True))
    return poses[len(known) :], replace(solved, tracks=renewed)


def coarse_tracks(graph: RobotGraph) -> list[Track]:
    """Return the tracks of the coarse path."""
    return renewed(graph.tracks, {}, CoarsePhase())


def renewed_tracks(solver: FrameSolver, graph: RobotGraph, coarse: list[Floats], fixed: int = 0) -> list[Track]:
    """Return the tracks of a graph with targets that depend on the coarse path.

    Args:
        solver: measures the edges.
        graph: T frames.
        coarse: T configurations (nq,).
        fixed: number of first frames that stay unchanged.
    """
    return renewed(graph.tracks, measured_by(solver.problem, graph, np.array(coarse)), SolvedPhase(fixed))


def renewed(tracks: Sequence[Track], measured: Mapping[str, Floats], phase: Phase) -> list[Track]:
    """Return tracks with their targets in a phase of the solution.

    Args:
        tracks: of T frames.
        measured: name of the kind → (T, E) measured values, of the kinds that have them.
        phase: the coarse path, a playback or a stand.
    """
    return [track.kind.renewed(track, measured.get(track.name), phase) for track in tracks]


def measured_by(problem: Problem, graph: RobotGraph, qpos: Floats) -> dict[str, Floats]:
    """Measure the edges of every symbolic cost; those that join frames outside the clip repeat its ends.

    Args:
        problem: the compiled measures.
        graph: its tracks.
        qpos: (T, nq) configurations.

    Returns:
        Name of the kind → (T, E) measured values.
    """
    every = np.array([problem.values(q) for q in qpos])
    ends = np.cumsum([len(track) for track in graph.costs])[:-1]
    found = {track.name: part for track, part in zip(graph.costs, np.split(every, ends, axis=1), strict=True)}
    return found | {cost.track.name: cost.values(qpos) for cost in problem.stencils}


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
    smooth, inertia = limits.difference_weights(targets, SECOND_DIFFERENCE)
    return ClipProblem(solver, targets, smoothing, smooth, inertia, limits.bounds(targets), fps, fixed)


def clip_passes(clip: ClipProblem, start: list[Floats], count: Count) -> list[FrameSolution]:
    """Alternate between frames drawn to a smooth path and the smooth path through the frames.

    The alternating direction method of multipliers solves  Σ f_t(q_t) + Σ κ ‖s_{t−1} − 2 s_t + s_{t+1}‖²  subject to
    q_t = s_t: every pass moves each frame by one step against ρ‖q_t ⊖ s_t + y_t‖², then the path s, then the
    multipliers y; both see q_t over-relaxed, s_t ⊕ α (q_t ⊖ s_t) [Boyd2011, 3.4.3]. Frames whose cost still falls
    after the last pass take more steps (`Smoothing.extra`). The function returns the frames, not the path, because the
    frames satisfy all limits. Joint speeds hold between the frames: the start is slowed down to them, and no step
    exceeds them relative to a neighbour. The first `fixed` frames stay unchanged.
    """
    solver, smoothing, robot = clip.solver, clip.smoothing, clip.solver.robot
    path = _at_speeds(clip, start)
    poses = [FrameSolution(q, Status.OUT_OF_ITERATIONS, np.inf, 0) for q in path]
    dual = np.zeros((len(poses), robot.model.nv))
    rho = smoothing.proximal * clip.inertia
    interpenetrating: set[int] = set()
    for number in range(smoothing.passes + smoothing.extra):
        moving = _moving(poses, clip.fixed) if number >= smoothing.passes else range(clip.fixed, len(poses))
        if not moving:
            break
        if number in smoothing.collision_checks:
            interpenetrating |= _interpenetrating(clip, poses)
        relaxed = _over_relaxed(clip, poses, path)
        moved = np.array([integrate(robot, q, y) for q, y in zip(relaxed, dual, strict=True)])
        path = _smooth_path(clip, moved, clip.smooth / rho)
        dual += [difference(robot, s, q) for s, q in zip(path, relaxed, strict=True)]
        dual[: clip.fixed] = 0.0
        for t in moving:
            poses[t] = _stepped(clip, poses, t, Proximal(path[t], -dual[t], rho), interpenetrating)
            if number < smoothing.passes:
                count.advance()
    proximal = [Proximal(s, -y, rho) for s, y in zip(path, dual, strict=True)]
    met = _separated(clip, _hard_edges_met(clip, poses, proximal), proximal)
    return [solver.raise_above_floor(pose, clip.all_targets.at(t)) for t, pose in enumerate(met)]


def _moving(poses: list[FrameSolution], fixed: int) -> list[int]:
    """Return the frames after the fixed ones whose cost still falls."""
    return [t for t in range(fixed, len(poses)) if poses[t].status is Status.OUT_OF_ITERATIONS]


def _at_speeds(clip: ClipProblem, start: list[Floats]) -> list[Floats]:
    """Return the start slowed down to the joints' speeds; the boxes of each pass keep these speeds afterwards."""
    hinges, paced = clip.solver.robot.qpos_index, np.array(start)
    paced[:, hinges] = within_speeds(paced[:, hinges], clip.bounds.speed[1:] / clip.fps, clip.fixed)
    return list(paced)


def _over_relaxed(clip: ClipProblem, poses: list[FrameSolution], path: list[Floats]) -> list[Floats]:
    """Return the frames beyond the path: s ⊕ α (q ⊖ s)."""
    robot, alpha = clip.solver.robot, clip.smoothing.relaxation
    return [integrate(robot, s, alpha * difference(robot, s, p.qpos)) for s, p in zip(path, poses, strict=True)]


def _stepped(
    clip: ClipProblem, poses: list[FrameSolution], t: int, proximal: Proximal, interpenetrating: set[int]
) -> FrameSolution:
    """A frame after one more step: within reach of its neighbours, with links apart between frames that interpenetrate."""
    solver = clip.solver
    after = solver.solve_frame(
        poses[t],
        clip.all_targets.at(t),
        proximal=proximal,
        around=solver.around(poses, clip.all_targets, t, 1 / clip.fps),
        iterations=1,
        tolerance=clip.smoothing.tolerance,
        box=clip.box(poses, t),
        between=_between(clip, poses, t, interpenetrating),
    )
    moved = float(np.abs(difference(solver.robot, poses[t].qpos, after.qpos)).max())
    falls = after.cost < (1 - clip.smoothing.settled) * poses[t].cost
    status = after.status if moved >= clip.smoothing.converged and falls else Status.CONVERGED
    return replace(after, status=status, iterations=poses[t].iterations + after.iterations)


def _smooth_path(clip: ClipProblem, moved: Floats, stiffness: Floats) -> list[Floats]:
    """Return the smooth path nearest to configurations: s = q ⊕ δ with the offsets of `smooth_offsets`."""
    robot = clip.solver.robot
    speed = np.array([difference(robot, a, b) for a, b in pairwise(moved)]).reshape(-1, robot.model.nv)
    offsets = smooth_offsets(speed, stiffness, clip.fixed)
    return [integrate(robot, q, d) for q, d in zip(moved, offsets, strict=True)]


def _between(
    clip: ClipProblem, poses: list[FrameSolution], t: int, interpenetrating: set[int]
) -> tuple[SweptConfiguration, ...]:
    """Where links are kept apart between a frame and its neighbours: after the frames in `interpenetrating`."""
    neighbours = (poses[k].qpos for k in (t - 1, t + 1) if min(k, t) in interpenetrating)
    return tuple(way for q in neighbours for way in swept_configurations(clip.solver.robot, q, poses[t].qpos))


def _interpenetrating(clip: ClipProblem, poses: list[FrameSolution]) -> set[int]:
    """Return the frames t with links inside each other between t and t + 1."""
    first, last, solver = max(clip.fixed - 1, 0), len(poses) - 1, clip.solver
    depth = {t: solver.depth_between(poses[t].qpos, poses[t + 1].qpos) for t in range(first, last)}
    return {t for t, deep in depth.items() if deep > solver.options.overlap}


def _hard_edges_met(clip: ClipProblem, poses: list[FrameSolution], proximal: list[Proximal]) -> list[FrameSolution]:
    """Return the poses; those that miss a hard edge are solved to the end, because one step per pass may be too few."""
    poses, solver = list(poses), clip.solver
    for _ in range(ROUNDS):
        missing = [
            t
            for t in range(clip.fixed, len(poses))
            if solver.problem.missed(poses[t].qpos, clip.all_targets.at(t)) > LOOSE
        ]
        for t in missing:
            around, targets = solver.around(poses, clip.all_targets, t, 1 / clip.fps), clip.all_targets.at(t)
            poses[t] = solver.solve_frame(
                poses[t], targets, proximal=proximal[t], around=around, box=clip.box(poses, t)
            )
        if not missing:
            break
    return poses


def _separated(clip: ClipProblem, poses: list[FrameSolution], proximal: list[Proximal]) -> list[FrameSolution]:
    """Return the poses with links apart, at frames and between them, if such poses are found.

    If links interpenetrate at a frame or between it and a neighbour, the frame is solved again with separation rows on
    the way between them. A frame whose links still interpenetrate moves back towards the frame before.
    """
    poses, solver = list(poses), clip.solver
    for _ in range(ROUNDS):
        interpenetrating = _interpenetrating(clip, poses)
        inside = {t for t in range(clip.fixed, len(poses)) if solver.overlapping(poses[t].qpos)}
        frames = sorted({t for k in interpenetrating for t in (k, k + 1) if t >= clip.fixed} | inside)
        for t in frames:
            poses[t] = _shallower(clip, poses, t, proximal[t], interpenetrating)
        if not frames:
            break
    for t in range(max(clip.fixed, 1), len(poses)):
        poses[t] = solver.backtrack_to_clearance(poses[t - 1].qpos, poses[t])
    return poses


def _shallower(
    clip: ClipProblem, poses: list[FrameSolution], t: int, proximal: Proximal, interpenetrating: set[int]
) -> FrameSolution:
    """Return a frame solved again with links apart on the ways to its neighbours, if links overlap less afterwards."""
    solver, box = clip.solver, clip.box(poses, t)
    ways, targets = _between(clip, poses, t, interpenetrating), clip.all_targets.at(t)
    around = solver.around(poses, clip.all_targets, t, 1 / clip.fps)
    again = solver.solve_frame(poses[t].qpos, targets, proximal=proximal, around=around, box=box, between=ways)
    return again if solver.depth(again.qpos) <= solver.depth(poses[t].qpos) else poses[t]
