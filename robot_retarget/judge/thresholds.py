"""Limits of a pass: one table, which a TOML file can override line by line."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

from robot_retarget.actuators.goals import TRACKING_RMS
from robot_retarget.base.errors import UsageError, known
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.judge.units import UNITS, shown


@dataclass(frozen=True)
class Thresholds:
    """Upper limits of a pass. An unstable simulation and a fall in mode `free` always fail."""

    tracking_rms: float = TRACKING_RMS
    """Of the worst joint [rad]."""
    penetration: float = 0.001
    """Of the robot with itself in the replay [m]; no frame may be deeper."""
    between_frames: float = 0.01
    """Of the robot with itself on the straight way from frame to frame [m]: 8 N at the end of an arm of 15 cm move
    a servo this far; the tracking error covers stronger contacts."""
    tracked_penetration: float = 0.002
    """Of the robot with itself on the servos [m]: the softness of the contact of a limb that is pressed on."""
    range_excess: float = 0.01
    """Beyond a joint's range in the replay [rad]."""
    speed_ratio: float = 2.0
    """Planned speed of the fastest joint over its speed limit; beyond twice the limit a servo does not follow."""
    saturated_share: float = 0.5
    """Share of the time at the torque limit."""
    temperature_rise: float = 40.0
    """Of the hottest servo over the trajectory [K]: room temperature to 70 °C."""
    foot_slip: float = 0.01
    """Slip of a standing foot [m], in mode `free`."""
    body_contacts_lost: float = 0.3
    """Share of the planned time of contacts with bodies that the simulation lacks."""
    fallen_share: float = 0.1
    """Share of the drawn simulations (mass, friction, stiffness, delay, tilt) that end in a fall, in mode `free`."""
    unlike_arms: float = 0.45
    """Mean angle of upper arms and forearms to the human's [rad]; a larger one is unlike, not a fail ..."""
    unlike_trunk: float = 0.2
    """... the same of the trunk ..."""
    unlike_legs: float = 0.4
    """... and of thighs and shins."""
    limbs_far: float = 0.05
    """Share of the frames in which the limbs are over 25° from the human's on average: a fall, a roll, a leap."""
    unlike_slowdown: float = 2.5
    """Duration over the human's."""
    contacts_lost: float = 0.3
    """Share of the human's hand contacts that the robot does not make."""
    steps_shortened: float = 0.6
    """Share by which steps are shorter than the scaled human's."""
    path_off: float = 0.6
    """Mean error of the pelvis' place over the human's mean distance from its start, or a leg: steps of half their length make
    0.5, standing in place makes 1."""
    heading_off: float = 0.6
    """Heading error that lasts for a tenth of the time [rad]."""
    steps_lost: float = 0.5
    """Share of the human's steps that the robot does not take."""
    unfinished: float = 0.25
    """Share of the frames that the solver did not finish."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, int | float) or isinstance(value, bool) or not value >= 0:
                raise UsageError(f"the threshold {name} must be a number, 0 or more, got {value!r}")

    @property
    def changed(self) -> dict[str, dict[str, str]]:
        """Thresholds that differ from their defaults: `{name: {"value": …, "default": …}}`, as decimal texts."""
        usual = vars(Thresholds())
        changed = {name: (float(value), usual[name]) for name, value in vars(self).items() if value != usual[name]}
        return {name: {"value": repr(value), "default": repr(default)} for name, (value, default) in changed.items()}


class Check(NamedTuple):
    """A threshold, the figure it bounds, its name and unit for people, and the sentence of a figure beyond it.

    Sentences may contain `{value}` and `{bound}` with their units, `{number}` without, and other figures.
    """

    threshold: str
    figure: str
    what: str
    unit: str
    sentence: str = "{what}: {value}, more than {bound}"

    def exceeded(self, figures: Mapping[str, Any], most: Thresholds) -> bool:
        """Return whether the figure is beyond its threshold; one that does not apply is not."""
        return (figures.get(self.figure) or 0.0) > getattr(most, self.threshold)

    def reason(self, figures: Mapping[str, Any], most: Thresholds) -> str:
        """Return the sentence of a figure."""
        value, bound = figures[self.figure], getattr(most, self.threshold)
        number = UNITS.get(self.unit, (1.0, ""))[0] * value
        texts = {"what": self.what, "value": shown(value, self.unit), "bound": shown(bound, self.unit)}
        return self.sentence.format(**{**figures, **texts, "number": number})


CHECKS = (
    Check("tracking_rms", "worst_joint_rms_rad", "tracking error of the worst joint (rms)", "rad",
          "{worst_joint} tracks {value} off (rms), more than {bound}"),
    Check("speed_ratio", "speed_ratio", "ratio of planned speed to top speed, fastest joint", "",
          "{speed_ratio_joint} would have to turn {number:.2g} times as fast as it can"),
    Check("saturated_share", "saturated_share", "time at torque limit", "of all",
          "{saturated_joint} is at its torque limit {number:.0f} % of the time"),
    Check("temperature_rise", "temperature_rise_K", "warming of the hottest servo", "K",
          "{hottest_joint} warms up by {number:.0f} K"),
    Check("penetration", "self_contact_depth_m", "overlap of the robot with itself, planned", "m"),
    Check("between_frames", "between_frames_depth_m", "overlap of the robot with itself between frames", "m"),
    Check("tracked_penetration", "tracked_self_contact_depth_m", "overlap of the robot with itself on the servos", "m"),
    Check("foot_slip", "foot_slip_m", "slip of a standing foot", "m", "a foot slides {value} while it stands"),
    Check("body_contacts_lost", "body_contacts_lost", "planned contacts with bodies that are missing", "of all",
          "{value} of the planned contacts with bodies are missing: {lost_contact}"),
    Check("fallen_share", "fallen_share", "randomised simulations in which it falls", "of all",
          "falls in {value} of {draws} simulations with other mass, friction, servos and tilt"),
    Check("range_excess", "range_excess_rad", "beyond a joint's range, planned", "rad",
          "{range_excess_joint} leaves its range by {value}"),
)  # fmt: skip
OVERLAPS = ("penetration", "between_frames", "tracked_penetration")
"""Thresholds of overlaps, whose sentences name pairs of links (`verdict.judge`)."""
FROM_STANDING = ("foot_slip", "fallen_share")
"""Thresholds that say nothing of a robot that fell."""

_FROM_HUMAN = "from the human's on average"
UNLIKE = (
    Check("unlike_arms", "limb_rad_arms", "mean angle of the arms to the human's", "rad", f"arms are {{number:.0f}}° {_FROM_HUMAN}"),
    Check("unlike_trunk", "limb_rad_trunk", "mean angle of the trunk to the human's", "rad", f"trunk is {{number:.0f}}° {_FROM_HUMAN}"),
    Check("unlike_legs", "limb_rad_legs", "mean angle of the legs to the human's", "rad", f"legs are {{number:.0f}}° {_FROM_HUMAN}"),
    Check("limbs_far", "limbs_far_share", "frames with limbs over 25° from the human's", "of all"),
    Check("unlike_slowdown", "slowdown", "ratio of durations, robot to human", "", "it takes {number:.1f} times as long as the human"),
    Check("contacts_lost", "contacts_lost", "hand contacts that are lost", "of all"),
    Check("steps_shortened", "steps_shortened", "steps shorter than the human's, scaled, by", "of all"),
    Check("path_off", "path_off", "root path deviation, over the path's extent", "of all"),
    Check("heading_off", "heading_off_rad", "heading error that lasts", "rad"),
    Check("steps_lost", "steps_lost", "steps of the human that are left out", "of all"),
    Check("unfinished", "unfinished_share", "frames that the solver did not finish", "of all"),
)  # fmt: skip
"""Comparisons with the human of a motion that passes."""


def read_thresholds(path: str | Path) -> Thresholds:
    """Read thresholds from TOML: `tracking_rms = 0.1`; others keep their defaults, `inf` switches one off.

    Raises:
        UsageError: The file is not TOML, names a threshold that is not known, or gives one that is not a number.
    """
    table = read_toml(path, UsageError)
    names = [field.name for field in fields(Thresholds)]
    strange = [name for name in table if name not in names]
    if strange:
        raise UsageError(f"{path}: no threshold {strange[0]!r}; {known(names, typed=strange[0])}")
    try:
        return Thresholds(**table)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None
