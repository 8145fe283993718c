"""The whole clip at once: a coarse path through the candidates, then rounds of passes over windows; targets follow the path."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.progress import Count
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.kind import CoarsePhase, Phase, SolvedPhase
from robot_retarget.graph.track import SECOND_DIFFERENCE, THIRD_DIFFERENCE, Form, Role, Track, concatenated
from robot_retarget.robot.kinematics import difference, tangent_names
from robot_retarget.solver.candidates import coarse_path
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.options import Search, Smoothing
from robot_retarget.solver.passes import Passes, clip_of
from robot_retarget.solver.problem import Problem
from robot_retarget.solver.sqp import FrameSolver

COARSE = 4
"""The coarse path takes about as long as this number of passes; the progress counts it as such."""

UNREACHED = 0.0125
"""A hard edge that a round misses by more is out of reach, over the leg [-]: by 2.8 mm on the OP3, 8 mm on the G1. With 1 cm for
both, 31 clips cost 2.5 % more on the OP3, a ballet 45 %; with half and double -0.5 and 0.6 %."""


def clip_poses(
    solver: FrameSolver,
    graph: RobotGraph,
    search: Search,
    smoothing: Smoothing,
    count: Count,
    start: Floats | None = None,
) -> tuple[list[FrameSolution], RobotGraph]:
    """Solve the windows in order. Returns poses and the graph with renewed tracks (`Kind.renewed`).

    Args:
        start: (T, nq) a path in place of the coarse one.
    """
    poses: list[FrameSolution] = []
    asked: list[list[Track]] = []
    windows = tuple(smoothing.windows.cut(len(graph), graph.fps))
    moving = sum(window.last - window.first - window.fixed for window in windows)
    count.expect(COARSE * len(graph) + smoothing.passes * moving)
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
    """Return the tracks and the poses of a window that rounds of passes reach from a path.

    Targets that depend on the poses, such as footholds, follow the poses before each round. A foot that misses its foothold in one
    round is free in the next ones.
    """
    path, unreached = coarse, np.zeros(len(coarse), dtype=bool)
    tracks = renewed_tracks(solver, graph, path, fixed)
    passes = Passes(clip_of(solver, tracks, smoothing, graph.fps, fixed), path)
    for number in range(1, smoothing.rounds + 1):
        last = number == smoothing.rounds
        passes.take(smoothing.passes - 1 if last else number * smoothing.passes // smoothing.rounds, count)
        unreached |= solver.problem.missed(passes.qpos, passes.clip.all_targets) > UNREACHED * solver.leg
        path = path if last else passes.qpos.copy()
        tracks = renewed_tracks(solver, graph, path, fixed, unreached)
        passes.renew(clip_of(solver, tracks, smoothing, graph.fps, fixed))
    return tracks, passes.finish(count)


def coarse_tracks(graph: RobotGraph) -> list[Track]:
    """Return the tracks of the coarse path."""
    return renewed(graph.tracks, {}, CoarsePhase())


def renewed_tracks(
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
    return renewed(graph.tracks, measured_by(solver.problem, graph, coarse), SolvedPhase(fixed, unreached))


def renewed(tracks: Sequence[Track], measured: Mapping[str, Floats], phase: Phase) -> list[Track]:
    """Return tracks with their targets in a phase of the solution.

    Args:
        tracks: of T frames.
        measured: name of the kind → (T, E) measured values, of the kinds that have them.
        phase: the coarse path, a playback or a stand.
    """
    return [track.kind.renewed(track, measured.get(track.name), phase) for track in tracks]


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
