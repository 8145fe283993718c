"""Ways out of a plan: judged branches that end in a stand, for a playback that is to stop."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.judgement import require_judged
from robot_retarget.servo.plan import ServoPlan, goal_plan
from robot_retarget.trajectory import load_trajectory

FOLDER = "stops"
"""Folder next to a trajectory; it has a folder for each branch, named by its moment [s]."""
AHEAD = 0.3
"""A branch has the goals of its trajectory until this long before its moment, or it belongs to another [s]."""


class Course:
    """The plan that a player follows, and the branches that lead out of it."""

    plan: ServoPlan

    def __init__(self, plan: ServoPlan, ways: Sequence[ServoPlan] = ()) -> None:
        self.plan, self._targets = plan, list(plan.angles)
        self._ways = {parting(plan, way): way for way in ways}
        self._switch = -1
        self.stopping = False
        """Whether somebody asked to stop."""

    @property
    def last(self) -> int:
        """The last row."""
        return len(self._targets) - 1

    def stop(self, row: int) -> bool:
        """Take the next branch after a row; without another one the plan continues to its own stand.

        Returns:
            Whether there is a way into a stand and none was requested before.
        """
        if self.stopping or not self._ways:
            return False
        self.stopping, ahead = True, [parts for parts in self._ways if parts > row]
        self._switch = min(ahead, default=-1)
        return True

    def remaining(self, row: int) -> float:
        """Return the time from a row to the end [s]."""
        end = len(self._ways[self._switch].angles) - 1 if self._switch >= 0 else self.last
        return (end - row) / self.plan.rate

    def reach(self, row: int) -> bool:
        """Go on to a row, in the branch from where it parts; return whether it parts here."""
        if not 0 <= self._switch <= row:
            return False
        self.plan = self._ways[self._switch]
        self._targets, self._switch = list(self.plan.angles), -1
        return True

    def target(self, row: int) -> np.ndarray:
        """Return the goals (n,) of a row [rad]: the same object at every call."""
        return self._targets[min(row, self.last)]


def parting(plan: ServoPlan, way: ServoPlan) -> int:
    """Return the first row of a branch that differs from the plan."""
    shared = min(len(plan.angles), len(way.angles))
    differ = np.flatnonzero((plan.angles[:shared] != way.angles[:shared]).any(axis=1))
    return int(differ[0]) if differ.size else shared


def judged_ways(
    path: str | Path, plan: ServoPlan, servo_map: ServoMap, servos: str, mode: str = "free", loose: bool = False
) -> tuple[list[ServoPlan], list[str]]:
    """Return the branches in `FOLDER` next to a trajectory that passed, and the reasons against the others.

    Args:
        path: file of the trajectory.
        plan: its judged goals.
        servo_map: as for `require_judged`.
        servos: as for `require_judged`.
        mode: as for `require_judged`.
        loose: as for `require_judged`.
    """
    ways, refused = [], []
    for file in sorted(Path(path).parent.glob(f"{FOLDER}/*/trajectory.npz")):
        try:
            branch = load_trajectory(file)
            require_judged(file, branch, servo_map, servos, None, mode, loose)
            way = goal_plan(branch, servo_map)
            lead_in = 0.0 if branch.goals is None else branch.goals.lead_in
            if parting(plan, way) / plan.rate < lead_in + float(file.parent.name) - AHEAD:
                raise ServoError(f"{file} belongs to another trajectory than {path}")
        except (ServoError, ValueError) as error:
            refused.append(str(error))
        else:
            ways.append(way)
    return ways, refused
