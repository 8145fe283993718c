"""Touch-up: add an edge to a solved trajectory and solve the frames around it again.

The window of an edge is its frames and the time before and after that the joints need to come and go (`AROUND` at least).
The frames of the edge are solved alone first, and the frames around lead there and back smoothly. From there the passes of
a whole clip solve the window, its first frames fixed. The change fades out before the window ends: all frames outside stay.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import SMOOTHSTEP_PEAK, Floats, smoothstep
from robot_retarget.base.errors import UsageError
from robot_retarget.base.progress import Count
from robot_retarget.graph.added import end_name
from robot_retarget.graph.describe import RobotGraph, among_placed, describe
from robot_retarget.graph.edits import Edit, edited, end_of, write_edits
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solver.clip import measured_by, renewed_tracks
from robot_retarget.solver.limits import Targets, targets_of
from robot_retarget.solver.options import Smoothing, SolveOptions
from robot_retarget.solver.passes import Passes, clip_of
from robot_retarget.solver.problem import build_problem
from robot_retarget.solver.solution import UnmetEdge, reasons_against, unmet_edges, unmet_of_user
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.trajectory import Trajectory

AROUND = 0.5
"""Least time before and after an edge, or before a branch, that is solved with it [s]: stances need it. Where a hand of
a wave is set to 0.2 m from the head for a third of a second, half changes nothing and double lowers the jerk from 104
to 86 rad/s³, at 14 more frames."""
FADING = 0.25
"""Time after that, in which the change fades out [s]: that jerk is 106 with half and 103 with double."""
MISSED = 1.0
"""The report of an edge that misses its interval by more in every frame says why [cm]."""
FIXED = 2
"""Frames at the beginning of a window that stay: 2 hold position and velocity."""

EDITED = Smoothing(passes=8, closing=1.7)
"""A touch-up is drawn to its smooth path less than a clip: the edges that were met before stay met."""


@dataclass(frozen=True, eq=False)
class EditResult:
    """A trajectory after a touch-up."""

    graph: RobotGraph
    """With the edge."""
    trajectory: Trajectory
    first: int
    last: int
    """Frames that were solved again."""
    seconds: float
    """Time of the solve [s]."""
    reached: str = ""
    """The measured and the requested interval of an edge, in a sentence."""
    unmet: tuple[UnmetEdge, ...] = ()
    """Hard edges of the window that miss their interval."""


def apply_edit(graph: RobotGraph, trajectory: Trajectory, edit: Edit) -> EditResult:
    """Solve the frames around an edit again.

    Args:
        graph: of the trajectory, frame by frame.

    Raises:
        GraphError: the graph refuses the edit.
    """
    began = time.perf_counter()
    edited_graph = edited(graph, [edit])
    first, last = edit.values.get("frames", (0, len(graph) - 1))
    solver = FrameSolver(build_problem(graph.robot, graph.match, edited_graph.tracks), SolveOptions())
    known = [np.array(q) for q in trajectory.qpos]
    tracks = renewed_tracks(solver, edited_graph, np.array(known))
    all_targets = targets_of(tracks)
    offsets = _offsets(solver, all_targets, known, first, last)
    speed = solver.problem.limits.bounds(all_targets).speed.min(axis=0)
    around = max(round(AROUND * graph.fps), _frames_needed(solver, speed, offsets, graph.fps))
    fading = round(FADING * graph.fps)
    start, stop = max(first - around, 0), min(last + around + fading + 1, len(graph))
    shares = _shares(np.arange(start, stop), first, last, around)
    led = np.clip(np.arange(start, stop), first, last) - first
    begin = [
        integrate(graph.robot, known[t], w * offsets[k])
        for t, w, k in zip(range(start, stop), shares, led, strict=True)
    ]
    fixed = 0 if start == 0 else min(FIXED, first - start)
    clip = clip_of(solver, [track.at(slice(start, stop)) for track in tracks], EDITED, graph.fps, fixed)
    poses = [pose.qpos for pose in Passes(clip, np.array(begin)).finish(Count(None, len(begin) * EDITED.passes))]
    qpos = np.array(trajectory.qpos)
    qpos[start:stop] = _faded(graph, known[start:stop], poses, 0 if stop == len(graph) else fading)
    done, window = trajectory.altered(qpos=qpos), slice(start, stop)
    solved = replace(edited_graph.at(window), tracks=tuple(track.at(window) for track in tracks))
    measured = measured_by(solver.problem, solved, qpos[window])
    unmet = unmet_edges(solver, solved, measured, qpos[window])
    reached = _reached(solver, solved, edit, measured, slice(first - start, last + 1 - start), qpos[window])
    return EditResult(edited_graph, done, start, stop - 1, time.perf_counter() - began, reached, unmet)


def _offsets(solver: FrameSolver, all_targets: Targets, known: Sequence[Floats], first: int, last: int) -> list[Floats]:
    """Per frame of the edge (nv,) the change that solves it alone, from the change of the frame before."""
    offsets, offset = [], np.zeros(solver.robot.model.nv)
    for t in range(first, last + 1):
        pose = solver.solve_frame(integrate(solver.robot, known[t], offset), all_targets.at(t))
        offset = difference(solver.robot, known[t], pose.qpos)
        offsets.append(offset)
    return offsets


def _frames_needed(solver: FrameSolver, speed: Floats, offsets: Sequence[Floats], fps: float) -> int:
    """Frames in which joints at their speed cover the largest change on a smooth way."""
    way = np.abs(np.array([offsets[0], offsets[-1]])[:, solver.hinges])
    return math.ceil(float((SMOOTHSTEP_PEAK * way / speed).max(initial=0.0)) * fps)


def _shares(frames: np.ndarray, first: int, last: int, around: int) -> Floats:
    """Per frame the share of the edge's change: 1 within its frames, smoothly 0 at `around` frames from them."""
    away = np.maximum(np.maximum(first - frames, frames - last), 0)
    return smoothstep(np.clip(1 - away / around, 0.0, 1.0))


def _reached(
    solver: FrameSolver, graph: RobotGraph, edit: Edit, measured: Mapping[str, Floats], frames: slice, qpos: Floats
) -> str:
    """The measured range of an edge at its frames, its interval, and the reasons of a miss in every frame."""
    if edit.action != "edge":
        return ""
    a, b = (end_name(end_of(edit.values[end])) for end in "ab")
    track = next(track for track in graph.tracks if track.kind.by_user)
    column = int(np.flatnonzero(track.joins(a, b))[-1])
    values = 100 * measured[track.name][frames, column]
    bounds = 100 * np.atleast_1d(np.asarray(edit.values["at"], float))
    errors, why = values - np.clip(values, bounds[0], bounds[-1]), ""
    if np.abs(errors).min() > MISSED:
        least = int(np.abs(errors).argmin())
        reasons = reasons_against(solver, graph, qpos, (track, column), frames.start + least, errors[least])
        why = f"; {'; '.join(reasons) or 'other edges oppose it: hold (hard = true) puts it before them'}"
    return f"{a} and {b} are {values.min():.1f} to {values.max():.1f} cm apart; interval: {_asked(bounds)}{why}"


def _asked(bounds: Floats) -> str:
    """An interval [cm] in the words of the viewer's form."""
    lower, upper = bounds[0], bounds[-1]
    if upper == 0:
        return "touch"
    if lower == upper:
        return f"exactly {lower:.3g} cm"
    least = [f"at least {lower:.3g} cm"] if lower > 0 else []
    return " and ".join([*least, *([f"at most {upper:.3g} cm"] if np.isfinite(upper) else [])])


def _faded(graph: RobotGraph, known: Sequence[Floats], poses: Sequence[Floats], frames: int) -> Floats:
    """(T, nq) the poses, faded to the known ones over the last `frames`: q ⊕ w (p ⊖ q), w a smoothstep."""
    ahead = len(poses) - 1 - np.arange(len(poses))
    shares = smoothstep(np.clip(ahead / frames, 0.0, 1.0)) if frames else np.ones(len(poses))
    changes = [difference(graph.robot, q, p) for q, p in zip(known, poses, strict=True)]
    return np.array([integrate(graph.robot, q, w * v) for q, w, v in zip(known, shares, changes, strict=True)])


def apply_edits(
    graph: RobotGraph, trajectory: Trajectory, edits: Sequence[Edit]
) -> tuple[Trajectory, list[EditResult]]:
    """Apply edits in order, each to the result of the one before.

    Returns:
        The trajectory, and the outcome of each edit.

    Raises:
        GraphError: the graph refuses an edit.
    """
    outcomes = []
    for edit in edits:
        outcomes.append(apply_edit(graph, trajectory, edit))
        graph, trajectory = outcomes[-1].graph, outcomes[-1].trajectory
    return trajectory, outcomes


# A trajectory under touch-up: edits in order, with undo and redo, saved in a file.


def graph_of(motion: Motion, robot: Robot, trajectory: Trajectory, overrides: str | Path | None = None) -> RobotGraph:
    """Return the graph of a motion, sampled at the frames of a trajectory of that motion, with the bodies around the robot.

    Raises:
        MatchError: the motion is not human, or the robot no humanoid.
    """
    in_step = motion.at_source_time(trajectory.source_time, trajectory.fps)
    if trajectory.scene is not None:
        in_step = among_placed(in_step, robot, trajectory.scene, overrides)
    return describe(in_step, robot, fps=trajectory.fps, overrides=overrides)


class Session:
    """All states of a trajectory under touch-up; every state is kept, so undo and redo give the same bytes."""

    def __init__(self, graph: RobotGraph, trajectory: Trajectory, edits_file: Path, trajectory_file: Path):
        """Start with an unchanged trajectory; only `save` writes the two files."""
        self._states = [(graph, trajectory)]
        self._edits: list[Edit] = []
        self._files = edits_file, trajectory_file
        self._at = 0
        self.last: EditResult | None = None
        """The latest touch-up."""

    @property
    def trajectory(self) -> Trajectory:
        """The present trajectory."""
        return self._states[self._at][1]

    @property
    def before(self) -> Trajectory | None:
        """The trajectory before the latest edit."""
        return self._states[self._at - 1][1] if self._at else None

    @property
    def edits(self) -> list[Edit]:
        """The edits in effect, in order."""
        return self._edits[: self._at]

    def make(self, table: Mapping[str, Any], instead: bool = False) -> None:
        """Add an edge, given by the keys of its table in EDITS.toml; undone edits are discarded.

        Args:
            instead: it replaces the latest edit.

        Raises:
            GraphError: the graph refuses it.
        """
        edit, at = Edit("edge", dict(table)), max(self._at - instead, 0)
        self.last = apply_edit(*self._states[at], edit)
        self._states[at + 1 :] = [(self.last.graph, self.last.trajectory)]
        self._edits[at:] = [edit]
        self._at = at + 1

    def undo(self) -> None:
        """Undo the latest edit.

        Raises:
            UsageError: no edit is left.
        """
        if not self._at:
            raise UsageError("nothing to undo")
        self._at -= 1

    def redo(self) -> None:
        """Redo the last undone edit.

        Raises:
            UsageError: no undone edit is left.
        """
        if self._at + 1 == len(self._states):
            raise UsageError("nothing to do again")
        self._at += 1

    def save(self) -> tuple[Path, Path]:
        """Write the edits and the trajectory; return both paths.

        Raises:
            OutputError: a file cannot be written.
        """
        return write_edits(self.edits, self._files[0]), self.trajectory.save(self._files[1])

    def state(self) -> dict[str, Any]:
        """Return the state of the session, for a page."""
        seconds = None if self.last is None else round(self.last.seconds, 3)
        reached = "" if self.last is None else "; ".join([self.last.reached, *unmet_of_user(self.last.unmet)])
        return {
            "edits": len(self.edits),
            "undone": len(self._states) - 1 - self._at,
            "seconds": seconds,
            "reached": reached,
        }
