"""A trajectory under touch-up: edits in order, with undo and redo, saved in a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robot_retarget.base.errors import UsageError
from robot_retarget.edit.touchup import EditResult, apply_edit
from robot_retarget.graph.describe import RobotGraph, among_placed, describe
from robot_retarget.graph.edits import Edit, write_edits
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.solver.solution import unmet_of_user
from robot_retarget.trajectory import Trajectory


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

    def make(self, table: Mapping[str, Any]) -> None:
        """Add an edge, given by the keys of its table in EDITS.toml; undone edits are discarded.

        Raises:
            GraphError: the graph refuses it.
        """
        edit = Edit("edge", dict(table))
        self.last = apply_edit(*self._states[self._at], edit)
        self._states[self._at + 1 :] = [(self.last.graph, self.last.trajectory)]
        self._edits[self._at :] = [edit]
        self._at += 1

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
