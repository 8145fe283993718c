"""The whole clip at once: a coarse path through the candidates, then rounds of steps over windows; targets follow the path."""

from dataclasses import replace

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.progress import Count
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.track import SECOND_DIFFERENCE, THIRD_DIFFERENCE, Form, Role, Track, concatenated
from robot_retarget.robot.kinematics import difference, tangent_names
from robot_retarget.solver.candidates import coarse_path
from robot_retarget.solver.clip_model import clip_of
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.minimum import ClipMinimum
from robot_retarget.solver.options import Search, Smoothing
from robot_retarget.solver.problem import UNREACHED, Problem
from robot_retarget.solver.solution import UNMET
from robot_retarget.solver.sqp import FrameSolver

EXPECTED = 10
"""Number of steps that the progress expects [-]: measured, 6 to 24 on 19 clips."""
COARSE = 10
"""The coarse path takes about as long as this number of steps; the progress counts it as such."""


def clip_poses(
    solver: FrameSolver,
    graph: RobotGraph,
    search: Search,
    smoothing: Smoothing,
    count: Count,
    start: Floats | None = None,
) -> tuple[list[FrameSolution], RobotGraph]:
    """Solve the windows in order. Returns poses and the graph with the tracks (`Kind.solved`).

    Args:
        start: (T, nq) a path in place of the coarse one.
    """
    poses: list[FrameSolution] = []
    asked: list[list[Track]] = []
    windows = tuple(smoothing.windows.cut(len(graph), graph.fps))
    moving = sum(window.last - window.first - window.fixed for window in windows)
    count.expect(COARSE * len(graph) + EXPECTED * moving)
    asks = targets_of(coarse_tracks(graph))
    path = coarse_path(solver, graph, asks, search) if start is None else list(start)
    count.advance(COARSE * len(graph))
    for window in windows:
        own = graph.frames(window.first, window.last)
        coarse = np.array([*(pose.qpos for pose in poses[window.first :]), *path[len(poses) : window.last]])
        tracks, found = _window_poses(solver, own, coarse, smoothing, window.fixed, count)
        kept = slice(window.fixed, window.final - window.first)
        poses += found[kept]
        asked.append([track.at(kept) for track in tracks])
    return poses, replace(graph, tracks=tuple(concatenated(parts) for parts in zip(*asked, strict=True)))


def _window_poses(
    solver: FrameSolver, graph: RobotGraph, coarse: Floats, smoothing: Smoothing, fixed: int, count: Count
) -> tuple[list[Track], list[FrameSolution]]:
    """Return the tracks and the poses of a window that steps reach from a path.

    Targets that depend on the poses, such as footholds, follow the poses after each round. After the last one, a foot is free where
    the path misses its foothold. Hard edges of a user count as soft ones until then.
    """
    problem, tracks = solver.problem, solved_tracks(solver, graph, coarse, fixed)
    clip = clip_of(solver, targets_of(tracks), smoothing, graph.fps, fixed)
    minimum = ClipMinimum(replace(clip, all_targets=problem.eased(clip.all_targets)), coarse)
    for number, steps in enumerate(smoothing.rounds, 1):
        minimum.take(steps, count)
        placed_tracks = _reachable_tracks if number == len(smoothing.rounds) else solved_tracks
        tracks = placed_tracks(solver, graph, minimum.qpos, fixed)
        clip = clip_of(solver, targets_of(tracks), smoothing, graph.fps, fixed)
        minimum.renew(replace(clip, all_targets=problem.eased(clip.all_targets)))
    if problem.by_user.size:
        minimum.take(smoothing.steps, count)
        minimum.renew(clip)
        minimum.take(smoothing.steps, count)
        tracks = _reachable_tracks(solver, graph, minimum.qpos, fixed)
        clip = clip_of(solver, targets_of(tracks), smoothing, graph.fps, fixed)
        minimum.renew(clip)
        if problem.missed(minimum.qpos, problem.eased(clip.all_targets)).max() > UNMET:  # they drag the feet
            minimum.renew(replace(clip, all_targets=problem.within_reach(minimum.qpos, clip.all_targets)))
    minimum.keep_apart()
    return tracks, minimum.finish(count)


def _reachable_tracks(solver: FrameSolver, graph: RobotGraph, path: Floats, fixed: int) -> list[Track]:
    """Return the tracks with targets that depend on a path, and feet free where it misses their footholds."""
    tracks = solved_tracks(solver, graph, path, fixed)
    unreached = solver.problem.missed(path, solver.problem.eased(targets_of(tracks))) > UNREACHED * solver.leg
    return solved_tracks(solver, graph, path, fixed, unreached) if unreached.any() else tracks


def coarse_tracks(graph: RobotGraph) -> list[Track]:
    """Return the tracks of the coarse path."""
    return [track.kind.coarse(track) for track in graph.tracks]


def solved_tracks(
    solver: FrameSolver, graph: RobotGraph, coarse: Floats, fixed: int = 0, unreached: Bools | None = None
) -> list[Track]:
    """Return the tracks of a graph with targets that depend on the coarse path.

    Args:
        solver: measures the edges.
        graph: T frames.
        coarse: (T, nq) configurations.
        fixed: number of first frames that stay unchanged.
        unreached: (T,) frames at which hard edges are out of reach.
    """
    measured = measured_by(solver.problem, graph, coarse)
    return [track.kind.solved(track, measured, fixed, unreached) for track in graph.tracks]


def measured_by(problem: Problem, graph: RobotGraph, qpos: Floats) -> dict[str, Floats]:
    """Measure the edges of every symbolic cost.

    Args:
        problem: the compiled measures.
        graph: its tracks.
        qpos: (T, nq) configurations.

    Returns:
        Name of the kind → (T, E) measured values.
    """
    every = problem.values(qpos)
    ends = np.cumsum([len(track) for track in graph.costs])[:-1]
    return {track.name: part for track, part in zip(graph.costs, np.split(every, ends, axis=1), strict=True)}


def stresses(solver: FrameSolver, graph: RobotGraph, qpos: Floats) -> dict[str, Floats]:
    """Return per kind (T,) its cost in every frame.

    Args:
        solver: of the graph's problem.
        graph: its tracks have their final targets.
        qpos: (T, nq) configurations.
    """
    measured = measured_by(solver.problem, graph, qpos)
    found = {name: graph.kinds[name].stress(values).sum(axis=1) for name, values in measured.items()}
    return found | solver.costs.parts(qpos, targets_of(graph.tracks)) | _temporal_stress(graph, qpos)


def _temporal_stress(graph: RobotGraph, qpos: Floats) -> dict[str, Floats]:
    """Return per kind of second or third differences (T,) its cost about every frame; 0 where the clip has no such neighbours."""
    speed, names = difference(graph.robot, qpos[:-1], qpos[1:]), tangent_names(graph.robot)
    found = {}
    for stencil in (SECOND_DIFFERENCE, THIRD_DIFFERENCE):
        bend, order = np.zeros((len(qpos), len(names))), len(stencil) - 1
        if len(qpos) > order:
            bend[1 : len(qpos) - order + 1] = np.diff(speed, order - 1, axis=0)
        for track in graph.tracks:
            if (track.role, track.kind.form, track.stencil) == (Role.COST, Form.JOINT, stencil):
                columns = [names.index(end) for end, _ in track.ends]
                found[track.name] = track.stress(bend[:, columns]).sum(axis=1)
    return found
