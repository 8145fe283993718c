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

    def note(self, goal: int, here: float | None) -> None:
        """A goal position; `here` is the present one, where torque is on."""
        self.goals += 1
        self.lowest_goal, self.highest_goal = min(self.lowest_goal, goal), max(self.highest_goal, goal)
        if here is not None:
            self.step(goal, here)

    def step(self, goal: int, here: float) -> None:
        """Record the distance from the shaft to a goal."""
        self.largest_step = max(self.largest_step, round(abs(goal - here)))
