"""The home pose of a frame: the end of a descent from the standing pose, independent of the past.

The pose that follows the performer stays in its basin of attraction. In parallel, a second pose starts from the
standing pose repeatedly and advances one step at a time. Where it reaches the first, mostly after two to four steps, it rests
until the next start. If it ends elsewhere and costs clearly less, the hinges that differ move to it along a smooth curve in
time, and all other hinges follow their targets.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, smoothstep
from robot_retarget.solver.descent import Box, FrameSolution
from robot_retarget.solver.options import RealTime
from robot_retarget.solver.problem import EdgeTargets
from robot_retarget.solver.sqp import FrameSolver

LED = 0.25
"""Hinges move to the home pose if they differ by more than this share of the basin threshold (`RealTime.same`), and without
such hinges the second pose has reached the first [-] ..."""
GIVE = 0.1
"""... and may deviate from their curve by this share of it, so that the other targets keep their effect [-]."""
ROUNDING = 0.99
"""Each frame takes one step when frames arrive at the step rate, whatever the last digit of their times [-]."""


@dataclass(eq=False)
class HomeTransition:
    """A transition to the home pose."""

    hinges: np.ndarray
    """(n,) whether a hinge takes part."""
    since: Floats
    """(n,) angles at the start [rad]."""
    lasts: float
    """Duration [s]."""
    gone: float = 0.0
    """Elapsed time [s]."""

    @property
    def arrived(self) -> bool:
        """Whether the duration is over."""
        return self.gone >= self.lasts

    def around(self, box: Box, home: Floats, slack: float) -> Box:
        """Return the box with the moving hinges on their curve to the home angles (n,), as far as the box allows."""
        share = smoothstep(min(self.gone / self.lasts, 1.0))
        aim = np.clip((1 - share) * self.since + share * home, box.lower, box.upper)
        lower = np.where(self.hinges, np.maximum(aim - slack, box.lower), box.lower)
        upper = np.where(self.hinges, np.minimum(aim + slack, box.upper), box.upper)
        return Box(lower, upper, box.root)


class BasinEscape:
    """Search for the home pose of a stream, and move to it."""

    solver: FrameSolver
    options: RealTime
    steps: int
    waited: float

    def __init__(self, solver: FrameSolver, options: RealTime):
        self.solver, self.options = solver, options
        self.pose: FrameSolution | None = None
        """The second pose; None while it rests."""
        self.steps, self.waited = options.home_steps, 0.0
        self.lead: HomeTransition | None = None

    def move_home(self, standing: Floats, targets: EdgeTargets, before: Floats) -> None:
        """Descend from a standing pose to the home pose, and start the transition to it."""
        self.pose = self.solver.solve_frame(standing, targets, iterations=self.options.start)
        self._set_out(before, targets)

    def search_step(
        self, current: FrameSolution, targets: EdgeTargets, standing: Callable[[], Floats], seconds: float
    ) -> None:
        """Take one step of the search if it is due; start the transition when the home pose is found and cheaper."""
        self.waited += seconds
        if self.waited < ROUNDING / self.options.home_rate:
            return
        self.waited, there = 0.0, self.steps >= self.options.home_steps and self.lead is None
        if there and self.pose is not None and self._better(self.pose, current):
            self._set_out(current.qpos, targets)
        elif there:
            self.pose, self.steps = FrameSolution(standing(), current.status, np.inf, 0), 0
        self.steps += 1
        if self.pose is not None:
            self.pose = self.solver.real_time_step(self.pose.qpos, targets, None, self.solver.ranges(targets), 1)
            if self.lead is None and not self._leads(self._way(current.qpos)).any():
                self.pose = None

    def box(self, box: Box, seconds: float) -> Box:
        """Return the box with the moving hinges on their curves."""
        if self.lead is None or self.pose is None:
            return box
        self.lead.gone += seconds
        led = self.lead.around(box, self.pose.qpos[self.solver.robot.qpos_index], GIVE * self.options.same)
        if self.lead.arrived:
            self.lead, self.steps = None, self.options.home_steps
        return led

    def _better(self, home: FrameSolution, current: FrameSolution) -> bool:
        apart = self._way(current.qpos).max(initial=0.0)
        return bool(apart > self.options.same and home.cost < self.options.worth * current.cost)

    def _way(self, qpos: Floats) -> Floats:
        """Return how far each hinge (n,) of a configuration is from the second pose [rad]."""
        assert self.pose is not None
        return np.abs(self.pose.qpos - qpos)[self.solver.robot.qpos_index]

    def _leads(self, way: Floats) -> Bools:
        """Return which hinges (n,) would move to the second pose."""
        return way > LED * self.options.same

    def _set_out(self, before: Floats, targets: EdgeTargets) -> None:
        way = self._way(before)
        hinges = self._leads(way)
        if hinges.any():
            needed = (way / self.solver.bounds(targets).speed)[hinges].max() / self.options.unhurried
            since = before[self.solver.robot.qpos_index]
            self.lead = HomeTransition(hinges, since, max(float(needed), self.options.ease))
