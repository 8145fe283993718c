"""What a bystander notes of the hosts of a servo."""

from dataclasses import dataclass


@dataclass
class Witness:
    """What hosts have asked of a servo since it was made: for tests, and for those who write hosts."""

    goals: int = 0
    lowest_goal: int = 1 << 31
    highest_goal: int = -(1 << 31)
    largest_step: int = 0
    """Between a goal and the present position, at goals with torque on and at torque on [ticks]."""
