"""The result of a retargeting: graph, solution, balance, likeness and warnings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from robot_retarget.base.pages import card
from robot_retarget.collision.warn import Warnings, warnings_of
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.track import Status
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.scores.likeness import Likeness, likeness_of
from robot_retarget.solver.balance.playback import Balanced
from robot_retarget.solver.solution import Solution
from robot_retarget.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a retargeting: graph, solution and, with balance, its playback."""

    graph: RobotGraph
    """The solved graph; with balance, its frames are those of the playback."""
    solution: Solution
    balance: Balanced | None = None
    """Timing and plants of a balanced playback, or None."""
    source: Motion | None = None
    """The motion as it was described: cut and resampled, before balance slows it down."""
    doubt: str = ""
    """Difference between robot and human that a map file or a single causal pass accepts; may be empty."""

    @property
    def motion(self) -> Motion:
        """The solved motion: cut and resampled; with balance, slowed and held like the robot's."""
        return self.graph.motion

    @property
    def match(self) -> Match:
        """The map from keypoints of the human to links of the robot."""
        return self.graph.match

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.graph.robot

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about motion, match, balance and likeness, one sentence each."""
        return (
            *((self.doubt,) if self.doubt else ()),
            *self.motion.notes,
            *self.match.notes,
            *(self.balance.notes if self.balance else ()),
            *self.likeness.notes,
        )

    @property
    def trajectory(self) -> Trajectory:
        """The robot's configurations over time, with their likeness to the human's."""
        return replace(self.solution.trajectory, likeness=self.likeness.figures())

    def __repr__(self) -> str:
        return f"<Result {self._title}: {self.likeness.sentence}>"

    def _repr_html_(self) -> str:
        rate = f"{len(self.trajectory)} at {self.trajectory.fps:g} a second"
        facts = {"frames": rate, "solver": self.solution.ended}
        return card(self._title, facts | {"likeness": self.likeness.sentence}, self.notes)

    @property
    def _title(self) -> str:
        return f"{self.trajectory.source or 'a motion'} on {self.robot.name}"

    @cached_property
    def likeness(self) -> Likeness:
        """How like the human's the robot's motion is."""
        if self.balance is None:
            return likeness_of(self.graph, self.solution.trajectory.qpos, unfinished=_unfinished(self.solution.status))
        return likeness_of(
            self.graph,
            self.solution.trajectory.qpos,
            self.balance.timeline.share >= 1,
            slowdown=self.balance.slowdown,
            stride=self.balance.stride,
            legs="instead" if self.balance.instead else self.balance.legs,
            unfinished=_unfinished(self.solution.status),
        )

    @cached_property
    def warnings(self) -> Warnings:
        """Self-collisions predicted along the trajectory, computed on first use.

        Raises:
            TrajectoryError: a single frame has no next one.
        """
        return warnings_of(self.trajectory, self.robot)


def _unfinished(status: Sequence[Status]) -> float:
    """Return the share of frames that the solver left before convergence."""
    return sum(one in (Status.OUT_OF_ITERATIONS, Status.BLOCKED) for one in status) / len(status)
