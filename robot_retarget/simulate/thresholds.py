"""What is still a pass: one table, that a TOML file may override line by line."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

from robot_retarget.documents import read_toml
from robot_retarget.errors import UsageError, known


@dataclass(frozen=True)
class Thresholds:
    """The most that is let pass. A simulation that breaks down fails in any case, and so does a fall in mode `free`."""

    tracking_rms: float = 0.2
    """Of the worst joint [rad]: 11°, what a servo of 50 ms lag loses at 4 rad/s."""
    penetration: float = 0.001
    """Of the robot with itself in the replay [m]; no frame may be deeper."""
    between_frames: float = 0.01
    """Of the robot with itself on the straight way from frame to frame [m]: at the end of an arm of 15 cm a servo gives way
    so much for some 8 N, a brush; what a brush does to the motion, tracking shows."""
    tracked_penetration: float = 0.002
    """Of the robot with itself on the servos [m]: the softness of the contact of a limb that is pressed on."""
    range_excess: float = 0.01
    """Beyond a joint's range in the replay [rad]."""
    speed_ratio: float = 2.0
    """Of the fastest joint to what it can do; a servo asked for twice its speed is somewhere else."""
    saturated_share: float = 0.5
    """Of the time that a servo may give all it has."""
    temperature_rise: float = 40.0
    """Of the hottest servo over the trajectory [K]: room temperature to 70 °C."""
    foot_slip: float = 0.01
    """How far a foot may slide while it stands [m], in mode `free`."""
    fallen_share: float = 0.1
    """Of drawn worlds (mass, friction, stiffness, delay, tilt) in which it falls, in mode `free`."""
    unlike_arms: float = 0.45
    """Mean angle of upper arms and forearms to the human's [rad]; what is more is unlike, not failed ..."""
    unlike_trunk: float = 0.2
    """... the same of the trunk ..."""
    unlike_legs: float = 0.4
    """... and of thighs and shins."""
    limbs_far: float = 0.05
    """Share of the frames in which the limbs are over 25° from the human's on average: a fall, a roll, a leap."""
    unlike_slowdown: float = 2.5
    """Times as long as the human."""
    contacts_lost: float = 0.3
    """Share of the human's contacts of hands that the robot does not make."""
    steps_shortened: float = 0.6
    """By which share of the scaled human's steps are shorter."""
    path_off: float = 0.6
    """Mean error of the pelvis' place over the human's mean distance from its start, or a leg: steps of half their length make
    0.5, standing in place makes 1."""
    heading_off: float = 0.6
    """Heading error that lasts for a tenth of the time [rad]."""
    steps_lost: float = 0.5
    """Share of the human's steps that the robot does not take."""
    unfinished: float = 0.25
    """Share of frames at which the solver was not done."""

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
    """Which figure a threshold bounds, and how to say so."""

    threshold: str
    figure: str
    what: str
    unit: str


CHECKS = (
    Check("tracking_rms", "worst_joint_rms_rad", "tracking error of the worst joint (rms)", "rad"),
    Check("speed_ratio", "speed_ratio", "planned speed of the fastest joint, in its top speeds", ""),
    Check("saturated_share", "saturated_share", "time at torque limit", "of all"),
    Check("temperature_rise", "temperature_rise_K", "warming of the hottest servo", "K"),
    Check("penetration", "self_contact_depth_m", "overlap of the robot with itself, planned", "m"),
    Check("between_frames", "between_frames_depth_m", "the same between frames", "m"),
    Check("tracked_penetration", "tracked_self_contact_depth_m", "the same on the servos", "m"),
    Check("foot_slip", "foot_slip_m", "slip of a standing foot", "m"),
    Check("fallen_share", "fallen_share", "randomised simulations in which it falls", "of all"),
    Check("range_excess", "range_excess_rad", "beyond a joint's range, planned", "rad"),
)

UNLIKE = (
    Check("unlike_arms", "limb_rad_arms", "arms off the human's, on the mean", "rad"),
    Check("unlike_trunk", "limb_rad_trunk", "trunk off the human's, on the mean", "rad"),
    Check("unlike_legs", "limb_rad_legs", "legs off the human's, on the mean", "rad"),
    Check("limbs_far", "limbs_far_share", "frames with limbs over 25° from the human's", "of all"),
    Check("unlike_slowdown", "slowdown", "time it takes, over the human's", ""),
    Check("contacts_lost", "contacts_lost", "contacts of hands that are lost", "of all"),
    Check("steps_shortened", "steps_shortened", "steps shorter than the human's, scaled, by", "of all"),
    Check("path_off", "path_off", "root path deviation, over the path's extent", "of all"),
    Check("heading_off", "heading_off_rad", "heading error that lasts", "rad"),
    Check("steps_lost", "steps_lost", "steps of the human that are left out", "of all"),
    Check("unfinished", "unfinished_share", "frames that were not solved to the end", "of all"),
)
"""What a motion that passes is compared with the human by."""


def read_thresholds(path: str | Path) -> Thresholds:
    """Thresholds from TOML: `tracking_rms = 0.1`; what the file does not name keeps its default, `inf` switches one off.

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
