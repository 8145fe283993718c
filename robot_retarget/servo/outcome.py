"""Options and outcome of a playback."""

from dataclasses import dataclass, field, replace
from enum import Enum
from math import inf
from typing import Any

from robot_retarget.actuators.balance_tables import require_bounds, within
from robot_retarget.actuators.goals import TRACKING_RMS


class FaultError(Exception):
    """Playback cannot continue; the text gives the reason."""


class HeatError(FaultError):
    """A servo is hot, but it still moves: a short way into a stand is left."""


class PlaybackEnd(Enum):
    """How playing ended; the value is the sentence for it."""

    FINISHED = "played to the end"
    ASTRAY = "played to the end, off the plan"
    INTERRUPTED = "interrupted"
    FAULT = "stopped"
    LOST = "lost the bus"


@dataclass(frozen=True)
class PlaybackOptions:
    """How to play."""

    end_pose: bool = True
    """Go softly to the map's stop pose at the end."""
    release: bool = False
    """Switch torque off after a good end."""
    fast: bool = True
    """Use fast reads where every servo knows them."""
    grace: float = field(default=10.0, metadata=within(0, 3600, "s"))
    """Time after Ctrl-C for which the pose is held and checked; a second Ctrl-C releases [s]."""

    tracking_rms: float = field(default=TRACKING_RMS, metadata=within(0, inf, "rad"))
    """A joint with a larger tracking error (rms) did not follow the plan [rad]."""
    test_lean: bool = True
    """Before a motion with feedback, lean a little and compare the inertial sensor with that."""
    lockstep: bool = False
    """Send each tick as soon as the last is answered, for an emulated bus in lockstep."""

    def __post_init__(self) -> None:
        require_bounds(self)


@dataclass(frozen=True)
class PlaybackOutcome:
    """Outcome of a playback."""

    ended: PlaybackEnd
    state: str
    """`hold`: torque on, goals kept; `release`: torque switched off; `limp`: torque is off, but not by the player;
    `watchdog`: the servos stop by themselves."""
    reason: str
    figures: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """End, reason and state of the servos."""
        how = self.ended.value
        return f"{self.reason if self.reason.startswith(how) else f'{how}: {self.reason}'} ({self.state})"

    def compared(self, tracking_rms: float) -> "PlaybackOutcome":
        """Return the outcome; a motion played to the end with a joint off by more than `tracking_rms` [rad] is astray."""
        off, joint = self.figures.get("worst_joint_rms_rad", 0.0), self.figures.get("worst_joint")
        if self.ended is not PlaybackEnd.FINISHED or off <= tracking_rms:
            return self
        reason = f"{joint} was {off:.2f} rad off (rms), more than {tracking_rms:.2g}: jammed, overloaded or too slow"
        return replace(self, ended=PlaybackEnd.ASTRAY, reason=reason)

    @property
    def exit_code(self) -> int:
        return 0 if self.ended is PlaybackEnd.FINISHED else 1
