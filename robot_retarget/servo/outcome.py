"""How to play, and what became of it."""

from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from robot_retarget.servo.bounds import require_bounds, within


class FaultError(Exception):
    """Playing cannot go on; the text says why."""


class Ended(Enum):
    """How playing ended; the value is the sentence for it."""

    FINISHED = "played to the end"
    INTERRUPTED = "interrupted"
    FAULT = "stopped"
    LOST = "lost the bus"


@dataclass(frozen=True)
class Options:
    """How to play."""

    end_pose: bool = True
    """Go softly to the map's stop pose at the end."""
    release: bool = False
    """Switch torque off after a good end."""
    fast: bool = True
    """Use fast reads where every servo knows them."""
    grace: float = field(default=10.0, metadata=within(0, 3600, "s"))
    """After Ctrl-C the pose is held under watch for so long; a second Ctrl-C lets go [s]."""

    lockstep: bool = False
    """Ticks follow each other as soon as they are answered: for an emulated bus whose time goes by goals."""

    def __post_init__(self) -> None:
        require_bounds(self)


@dataclass(frozen=True)
class Outcome:
    """What became of it."""

    ended: Ended
    state: str
    """`hold`: torque on, goals kept; `release`: torque switched off; `limp`: torque is off without our doing;
    `watchdog`: the servos stop by themselves."""
    reason: str
    figures: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """How it ended and why, and in what state the servos are."""
        how = self.ended.value
        return f"{self.reason if self.reason.startswith(how) else f'{how}: {self.reason}'} ({self.state})"

    @property
    def exit_code(self) -> int:
        return 0 if self.ended is Ended.FINISHED else 1
