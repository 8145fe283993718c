"""Touch-up: add an edge to a solved trajectory and solve the frames around it again.

The limbs at the ends of the edge move, and the rest of the body is held (`edit.held`), over the edge's window (`edit.window`).
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.edit.held import free_hinges, held, with_root
from robot_retarget.edit.window import MISSED, solved_window
from robot_retarget.graph.added import end_name
from robot_retarget.graph.describe import RobotGraph, among_placed, describe
from robot_retarget.graph.edits import Edit, edited, end_of, write_edits
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.solver.solution import Solution, UnmetEdge, reasons_against, unmet_of_user
from robot_retarget.solver.solve import problem_of
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.trajectory import Trajectory

REST = "the rest of the body is held: `solve --edges` moves it too"
"""The last words about an edge that a limb misses."""


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
    known, whole, free = np.array(trajectory.qpos), with_root(edited_graph), np.ones(len(graph.robot.joint_names), bool)
    solver = FrameSolver(problem_of(whole))
    if edit.action == "edge":
        ends = end_of(edit.values["a"]), end_of(edit.values["b"])
        free = free_hinges(whole, ends, slice(first, last + 1))
        whole = held(whole, solver.problem, known, free)
    solution, start, moved = solved_window(solver, whole, known, first, last)
    frames = start + np.flatnonzero(moved)
    known[frames] = solution.trajectory.qpos[moved]
    reached = _reached(solver, solution, edit, slice(first - start, last + 1 - start), not free.all())
    unmet = tuple(each.later(start) for each in solution.unmet)
    done, seconds = trajectory.altered(qpos=known), time.perf_counter() - began
    return EditResult(edited_graph, done, int(frames[0]), int(frames[-1]), seconds, reached, unmet)


def _reached(solver: FrameSolver, solution: Solution, edit: Edit, frames: slice, limbs: bool) -> str:
    """The measured range of an edge at its frames, its interval, and the reasons of a miss in every frame.

    Args:
        limbs: whether only limbs could move.
    """
    if edit.action != "edge":
        return ""
    a, b = (end_name(end_of(edit.values[end])) for end in "ab")
    track = next(track for track in solution.graph.tracks if track.kind.by_user)
    column = int(np.flatnonzero(track.joins(a, b))[-1])
    values = 100 * solution.measured[track.name][frames, column]
    bounds = 100 * np.atleast_1d(np.asarray(edit.values["at"], float))
    errors, why = values - np.clip(values, bounds[0], bounds[-1]), ""
    if np.abs(errors).min() > 100 * MISSED:
        least = int(np.abs(errors).argmin())
        qpos, at = solution.trajectory.qpos, frames.start + least
        reasons = reasons_against(solver, solution.graph, qpos, (track, column), at, errors[least])
        other = "other edges oppose it: hold (hard = true) puts it before them"
        why = "; ".join(["", *(reasons or (other,)), *([REST] if limbs else [])])
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
