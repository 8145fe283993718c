"""A trajectory mended: a wish of one's own becomes an edge of the graph, and the frames around it are solved again.

The window of an edge are its frames and as much time before and after as a smooth path needs to leave and come back
(`AROUND`). It is solved from the trajectory as it is, by the passes that solve whole clips, its first frames fixed. What
it is away from the trajectory fades over the last of that time, so that everything before and after stays as it was.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.edits import Edit, edited
from robot_retarget.describe.graph import Graph
from robot_retarget.progress import Count
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solve.clip import Clip, clip_passes, renewed_tracks, smoothness
from robot_retarget.solve.options import Options, Smoothing
from robot_retarget.solve.problem import build_problem, wishes_of
from robot_retarget.solve.sqp import FrameSolver
from robot_retarget.trajectory import Trajectory

AROUND = 0.5
"""Time before and after an edge that is solved with it [s]."""
MISSED = 1.0
"""A soft edge that nowhere comes nearer to what it asks for is said to be too weak [cm]."""
FIXED = 2
"""Frames at the beginning of a window that stay: position and velocity go on."""


@dataclass(frozen=True, eq=False)
class Mended:
    """A trajectory after a touch-up."""

    graph: Graph
    """With the edge."""
    trajectory: Trajectory
    first: int
    last: int
    """Frames that were solved again."""
    seconds: float
    """How long that took [s]."""
    reached: str = ""
    """What came of an edge, in a sentence."""


def mended(graph: Graph, trajectory: Trajectory, edit: Edit) -> Mended:
    """Solve the frames around an edit again.

    Args:
        graph: of the trajectory, frame by frame.

    Raises:
        GraphError: the graph refuses the edit.
    """
    began = time.perf_counter()
    wished = edited(graph, [edit])
    first, last = edit.values.get("frames", (0, len(graph) - 1))
    around = round(AROUND * graph.fps)
    start, stop = max(first - around, 0), min(last + around + 1, len(graph))
    part = wished.frames(start, stop)
    solver = FrameSolver(build_problem(part.robot, part.match, part.tracks), Options())
    smoothing, known = Smoothing(), [np.array(q) for q in trajectory.qpos[start:stop]]
    fixed = 0 if start == 0 else min(FIXED, len(known) - 1)
    tracks = renewed_tracks(solver, part, known, fixed)
    smooth = smoothness(part.robot, part.weights.smooth, part.weights.smooth_root, part.fps)
    clip = Clip(solver, wishes_of(tracks), smoothing, smooth, part.fps, fixed)
    count = Count(None, len(known) * smoothing.passes)
    poses = [pose.qpos for pose in clip_passes(clip, known, count)]
    qpos = np.array(trajectory.qpos)
    qpos[start:stop] = _faded(graph, known, poses, 0 if stop == len(graph) else around)
    done = replace(trajectory, qpos=qpos, goals=None)
    measured = np.array([solver.problem.values(q) for q in qpos[first : last + 1]])
    return Mended(wished, done, start, stop - 1, time.perf_counter() - began, _reached(wished, edit, measured))


def _reached(graph: Graph, edit: Edit, measured: Floats) -> str:
    """What an edge asks for and what it came to, from what all edges measure (T, E) at its frames."""
    ends = np.cumsum([len(track) for track in graph.tracks])
    own = next((int(end) for track, end in zip(graph.tracks, ends, strict=True) if track.name == "own"), None)
    if edit.action != "edge" or own is None:
        return ""
    here, asked = 100 * measured[:, own - 1], np.atleast_1d(edit.values["at"])
    wished = " to ".join(f"{100 * float(value):.3g}" for value in asked)
    missed = np.abs(here - np.clip(here, 100 * asked[0], 100 * asked[-1])).min()
    firmer = (
        "; hard = true, or a priority over 100, brings them nearer"
        if missed > MISSED and "hard" not in edit.values
        else ""
    )
    apart = f"{here.min():.1f} to {here.max():.1f} cm apart"
    return f"{edit.values['a']} and {edit.values['b']} are {apart}, asked for {wished} cm{firmer}"


def _faded(graph: Graph, known: Sequence[Floats], poses: Sequence[Floats], frames: int) -> Floats:
    """The poses, brought back to what was known over the last so many frames: q ⊕ w (p ⊖ q), w = 1 − 3u² + 2u³."""
    ahead = len(poses) - 1 - np.arange(len(poses))
    u = np.clip(1 - ahead / frames, 0, 1) if frames else np.zeros(len(poses))
    shares = 1 - 3 * u**2 + 2 * u**3
    return np.array(
        [
            integrate(graph.robot, q, share * difference(graph.robot, q, p))
            for q, p, share in zip(known, poses, shares, strict=True)
        ]
    )


def all_mended(graph: Graph, trajectory: Trajectory, edits: Sequence[Edit]) -> tuple[Trajectory, list[str]]:
    """Every edit in turn, each on what the one before left; the trajectory, and what came of each edge.

    Raises:
        GraphError: the graph refuses an edit.
    """
    told = []
    for edit in edits:
        done = mended(graph, trajectory, edit)
        graph, trajectory = done.graph, done.trajectory
        told += [done.reached] if done.reached else []
    return trajectory, told
