"""Log of the writes of hosts to a servo."""

from dataclasses import dataclass


@dataclass
class WriteLog:
    """Extremes of the writes since the start, for tests and for authors of hosts."""

    goals: int = 0
    lowest_goal: int = 1 << 31
    highest_goal: int = -(1 << 31)
    largest_step: int = 0
    """Between a goal and the present position, at goals with torque on and at torque on [ticks]."""
    settled: float = 0.0
    """When a host last wrote something, or the watchdog last stopped the servo: since then it is left alone [s]."""

    def note(self, goal: int, present: float | None) -> None:
        """Record a goal position and, with torque on, its distance from the present position [ticks].

        Args:
            goal: the goal position.
            present: the present position; None with torque off.
        """
        self.goals += 1
        self.lowest_goal, self.highest_goal = min(self.lowest_goal, goal), max(self.highest_goal, goal)
        if present is not None:
            self.step(goal, present)

    def step(self, goal: int, present: float) -> None:
        """Record the distance from the shaft to a goal."""
        self.largest_step = max(self.largest_step, round(abs(goal - present)))
