"""What helps against each reason of a report, as a command.

A cure solves the trajectory again (slower, in balance, links apart), keeps a part of it, or runs the motion with other options.
"""

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

PROGRAM = "robot-retarget"
SPEEDS = 0.3, 0.9
"""Least and greatest factor of a speed that a cure names [-]: by definition a cure slows the motion, and leaves a motion to see."""
STEADY = 0.7
"""Factor of the speed where no figure says how much too fast a motion is [-]: accelerations are halved."""
COOLER = 0.9
"""Share that a cure keeps of the time in which a servo reaches its limit of temperature [-]: by definition a tenth is left; warming slows down
with time, so that this errs to the cool side."""


class Cure(NamedTuple):
    """A reason, what helps against it, and the command that does so."""

    reason: str
    what: str
    command: str


@dataclass(frozen=True)
class Origin:
    """Files and commands of a report, as its cures name them."""

    trajectory: str = "trajectory.npz"
    robot: str = "ROBOT"
    motion: str = "MOTION"
    run: str = ""
    """The command that made the trajectory, without its folder of results; empty if unknown."""
    judge: str = ""
    """The options of `simulate`; by default the robot."""

    def judged(self, trajectory: str, *more: str) -> str:
        """Return the command that judges a trajectory."""
        options = shlex.split(self.judge) or ["--robot", self.robot]
        return shlex.join([PROGRAM, "simulate", trajectory, *_without(options, more[:1]), *more])

    def edited(self, how: str, name: str, *more: str) -> str:
        """Return the commands that edit the trajectory and judge the result; the earlier trajectory and report stay."""
        path = Path(self.trajectory)
        made = path.with_name(f"{'' if path.stem == 'trajectory' else f'{path.stem}-'}{name}.npz")
        words = [PROGRAM, "edit", how, self.trajectory, "--robot", self.robot, *more, "-o", str(made)]
        return f"{shlex.join(words)} && {self.judged(str(made), '--report', str(made.with_suffix('.json')))}"

    def again(self, name: str, option: str, value: str) -> str:
        """Return the command that runs the motion again with another option, into another folder."""
        words = shlex.split(self.run) or [PROGRAM, "run", self.motion, "--robot", self.robot]
        path = Path(self.trajectory)
        place = path.parent if self.run else path.with_suffix("")
        place = place.with_name(f"{place.name}-{name}")
        return shlex.join([*_without(words, [option]), option, value, "--out", str(place)])


def _without(words: list[str], options: Sequence[str]) -> list[str]:
    """Return words without some options and their values."""
    found = [words.index(option) for option in options if option in words]
    return [word for k, word in enumerate(words) if not any(k - at in (0, 1) for at in found)]


class Failing(NamedTuple):
    """A report whose reasons are to be cured."""

    figures: Mapping[str, Any]
    most: Any
    """`verdict.Thresholds`."""
    origin: Origin

    @property
    def pinned(self) -> bool:
        """Whether the pelvis was held."""
        return self.figures.get("mode") == "pinned"

    @property
    def balance(self) -> str:
        """The balance that a new trajectory needs; a policy has its own."""
        alone = self.pinned or "policy" in self.figures
        return "off" if alone else self.figures.get("balance") or "static"


def cure_of(reason: str, kind: str, failing: Failing) -> Cure:
    """Return what helps against a reason.

    Args:
        kind: the threshold that is exceeded, or a key of `CURES`.
    """
    return Cure(reason, *CURES[kind](failing))


Advice = tuple[str, str]
"""What helps, and the command."""


def _slower(failing: Failing, speed: float = STEADY) -> Advice:
    least, most = SPEEDS
    factor = f"{math.floor(100 * min(max(speed, least), most)) / 100:g}"
    more = "--speed", factor, "--balance", failing.balance
    return f"slow it to {factor} of its speed", failing.origin.edited("retime", "slower", *more)


def _slower_by(figure: str, threshold: str) -> Callable[[Failing], Advice]:
    """Return the cure that slows a motion by as much as a figure exceeds its threshold."""

    def cure(failing: Failing) -> Advice:
        most = getattr(failing.most, threshold, None) or failing.figures.get(threshold) or 0.0
        return _slower(failing, most / failing.figures[figure])

    return cure


def _apart(failing: Failing) -> Advice:
    more = "--speed", "1", "--balance", failing.balance
    return "solve it again within ranges and with its links apart", failing.origin.edited("retime", "apart", *more)


def _shorter(failing: Failing) -> Advice:
    share = failing.most.temperature_rise / failing.figures["temperature_rise_K"]
    end = f"{COOLER * share * failing.figures.get('duration_s', 1.0):.3g}"
    command = failing.origin.edited("cut", "shorter", "--trim", f"0:{end}")
    return f"keep its first {end} s, and pause after them", command


def _steadier(failing: Failing) -> Advice:
    """Feet in place; for feet already in place, a slower motion."""
    if failing.origin.run and failing.figures.get("legs") != "stand":
        return "keep both feet in place", failing.origin.again("stand", "--legs", "stand")
    return _slower(failing)


def _without_feedback(failing: Failing) -> Advice:
    command = failing.origin.judged(failing.origin.trajectory, "--no-feedback")
    return "lower the gains of `[balance]`, or judge it without feedback", command


def _carried(failing: Failing) -> Advice:
    command = failing.origin.judged(failing.origin.trajectory, "--objects", "carried")
    return "a lighter object, a grasp of both hands, or an object that is carried along its path", command


def _softness(failing: Failing) -> Advice:
    stiffness, gravity = (failing.figures.get(f"{of}_stiffness_Nm_rad") or 0.0 for of in ("ankle", "tipping"))
    more = f"{gravity / stiffness:.2g} times" if stiffness else f"to over {gravity:.2g} N m/rad"
    what = f"raise the position gains of the ankles {more} (`kp` of the model, `p_gain` of the servo map), then judge it again"
    return what, failing.origin.judged(failing.origin.trajectory)


def _sound(failing: Failing) -> Advice:
    command = f"{PROGRAM} info {shlex.quote(failing.origin.robot)}"
    return "check masses, inertias and gains of the model", command


def _nearer(failing: Failing) -> Advice:
    """The next way to follow the human more closely: the legs, dynamic balance, no balance, directions of limbs."""
    figures, origin = failing.figures, failing.origin
    if failing.pinned and "directions" in origin.run:
        what = "ranges of joints, contacts and links that are held apart cost this: see where, and correct it by hand"
        return what, shlex.join([PROGRAM, "view", origin.trajectory, "--robot", origin.robot])
    if failing.pinned:
        return "favour the directions of the limbs", origin.again("directions", "--favour", "directions")
    if figures.get("not_standing"):
        return "hold the pelvis: no robot plays this standing", origin.again("held", "--balance", "off")
    if figures.get("legs") in ("instead", "stand"):
        return "follow the human's legs", origin.again("follow", "--legs", "follow")
    return _quicker(failing)


def _quicker(failing: Failing) -> Advice:
    again = failing.origin.again
    if failing.figures.get("balance") == "static":
        return "balance it dynamically", again("dynamic", "--balance", "dynamic")
    return "hold the pelvis", again("held", "--balance", "off")


def _touching(failing: Failing) -> Advice:
    return "favour distances between parts", failing.origin.again("distances", "--favour", "distances")


def _finished(failing: Failing) -> Advice:
    return "solve half of the frames", failing.origin.again("coarse", "--fps", f"{failing.figures['fps'] / 2:g}")


CURES: dict[str, Callable[[Failing], Advice]] = {
    "tracking_rms": _slower_by("worst_joint_rms_rad", "tracking_rms"),
    **{name: _slower_by(name, name) for name in ("speed_ratio", "saturated_share")},
    "goal_step": _slower_by("goal_step_rad", "goal_step_limit_rad"),
    "temperature_rise": _shorter,
    **dict.fromkeys(("penetration", "between_frames", "range_excess"), _apart),
    **dict.fromkeys(("tracked_penetration", "body_contacts_lost", "missed_step"), _slower),
    **dict.fromkeys(("foot_slip", "fallen_share", "fell", "gave_up"), _steadier),
    "oscillates": _without_feedback,
    "soft": _softness,
    "unstable": _sound,
    "dropped": _carried,
    **dict.fromkeys(("unlike_arms", "unlike_trunk", "unlike_legs", "limbs_far"), _nearer),
    **dict.fromkeys(("path_off", "heading_off", "steps_lost", "steps_shortened"), _nearer),
    "unlike_slowdown": _quicker,
    "contacts_lost": _touching,
    "unfinished": _finished,
}
"""By threshold, or by the name of a reason without one (`verdict._findings`)."""
