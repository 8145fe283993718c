"""The verdict on a simulation: the reasons against it, its differences from the human, and the badge that names both."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robot_retarget.actuators.goals import TRACKING_RMS
from robot_retarget.base.errors import UsageError, known
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.judge.bodies import dropped
from robot_retarget.judge.stance import missed_steps

# Figures of reports in the units that people read.

UNITS = {"rad": (57.29578, "°"), "m": (1000.0, "mm"), "of all": (100.0, "%")}
"""What figures are shown in: a factor and a unit for each unit of the report."""


def shown(value: float | str, unit: str) -> str:
    """Return a figure in a common unit: 0.2 rad as 11.5°. Texts are returned unchanged."""
    if isinstance(value, str):
        return value
    factor, name = UNITS.get(unit, (1.0, "°" if unit == "deg" else unit))
    return f"{factor * value + 0.0:.3g}{'' if name == '°' or not name else ' '}{name}"


# Limits of a pass: one table, which a TOML file can override line by line.


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


NAMED_PAIRS = 3
"""The number of overlapping pairs that are listed one by one."""
TRAVEL = ("path_off", "heading_off", "steps_lost")
"""The thresholds that a robot exceeds by standing in place."""


@dataclass(frozen=True)
class Badge:
    """The verdict as every output words it: terminal, `report.json`, report page and viewer."""

    passed: bool
    unlike: bool = False
    """Whether the motion differs from the human's by more than the thresholds allow."""
    pinned: bool = True
    """Whether the pelvis was held; if not, the robot stood free."""
    feedback: bool = False
    """Whether balance feedback corrected the goals."""
    compared: bool = True
    """Whether the motion was compared with the human's."""

    @property
    def level(self) -> str:
        """`pass`, `unlike` or `fail`: the badge's colour."""
        return ("unlike" if self.unlike else "pass") if self.passed else "fail"

    @property
    def text(self) -> str:
        """For people: `pass (pinned)`, `pass, but unlike (free)`, `pass, likeness not judged (free, with feedback)`, `fail (free)`."""
        verdict = {"pass": "pass", "unlike": "pass, but unlike", "fail": "fail"}[self.level]
        if self.level == "pass" and not self.compared:
            verdict = "pass, likeness not judged"
        how = ("pinned" if self.pinned else "free") + (", with feedback" if self.feedback else "")
        return f"{verdict} ({how})"

    def contract(self) -> dict[str, str]:
        """The content for JSON."""
        return {"text": self.text, "level": self.level}


def badge_of(reasons: tuple[str, ...], unlike: tuple[str, ...], figures: Mapping[str, Any]) -> Badge:
    """Return the badge of a simulation with these reasons, differences and figures."""
    return Badge(
        not reasons, bool(unlike), figures["mode"] == "pinned", bool(figures.get("feedback")), "limb_rad" in figures
    )


def judge(figures: Mapping[str, Any], most: Thresholds) -> tuple[str, ...]:
    """Return the reasons against a trajectory; none for a pass."""
    skipped = OVERLAPS if figures.get("fall_s") is None else (*OVERLAPS, *FROM_STANDING)
    over = [check for check in CHECKS if check.threshold not in skipped and check.exceeded(figures, most)]
    return (
        *_upright(figures),
        *_feedback(figures),
        *(check.reason(figures, most) for check in over),
        *_goal_step(figures),
        *dropped(figures),
        *missed_steps(figures),
        *_links(figures, most),
    )


def unlikeness(figures: Mapping[str, Any], most: Thresholds) -> tuple[str, ...]:
    """Return the differences from the human's motion that exceed the thresholds, a sentence each."""
    over = [check for check in UNLIKE if check.exceeded(figures, most)]
    stands = figures.get("legs") == "instead" and any(check.threshold in TRAVEL for check in over)
    sentences = [stands_in_place(figures)] if stands else []
    own = [check for check in over if not (stands and check.threshold in TRAVEL)]
    return (*sentences, *(check.reason(figures, most) for check in own))


def stands_in_place(figures: Mapping[str, Any]) -> str:
    """Name the travel and the steps of the human that a robot with its feet in place leaves out."""
    turn, steps = np.degrees(figures.get("human_turn_rad", 0.0)), figures.get("human_steps")
    stepping = f" in {steps} step{'s' if steps > 1 else ''}" if steps else ""
    return (
        f"stands in place: the human moves {figures.get('human_distance_m', 0.0):.1f} m and turns {turn:.0f}°{stepping}"
    )


def _links(figures: Mapping[str, Any], most: Thresholds) -> list[str]:
    """Links inside each other: at the frames, between them, and on the servos of a robot that stays up."""
    reasons = _overlaps(figures["self_contacts"], most.penetration, "overlap")
    if figures["between_frames_depth_m"] > max(most.between_frames, figures["self_contact_depth_m"]):
        depth, when = 1000 * figures["between_frames_depth_m"], figures["between_frames_s"]
        pair = " and ".join(figures["between_frames_bodies"])
        reasons.append(f"{pair} pass through each other by {depth:.1f} mm between two frames, at {when:g} s")
    if figures.get("fall_s") is None:
        planned = [line["bodies"] for line in figures["self_contacts"] if line["depth_m"] > most.penetration]
        hits = [line for line in figures["tracked_self_contacts"] if line["bodies"] not in planned]
        reasons += _overlaps(hits, most.tracked_penetration, "hit each other on the servos, overlapping")
    return reasons


def _upright(figures: Mapping[str, Any]) -> list[str]:
    """Whether the simulation and the robot came to the end."""
    reasons = []
    if figures["unstable_s"] is not None:
        reasons.append(f"the simulation broke down at {figures['unstable_s']:g} s")
    if figures.get("fall_s") is not None:
        when = f"at {figures['fall_s']:g} s" if figures["fall_s"] >= 0 else "in the first pose, before it began to move"
        body = figures["fall_body"]
        reasons.append(f"fell: {f'{body} touched the floor' if body else 'sank to half its height'} {when}")
    return reasons


def _goal_step(figures: Mapping[str, Any]) -> list[str]:
    """Goals that playback would hold back."""
    cap = figures.get("goal_step_limit_rad")
    if cap is None or figures["goal_step_rad"] <= cap:
        return []
    ahead, bound = shown(figures["goal_step_rad"], "rad"), shown(cap, "rad")
    return [f"{figures['goal_step_joint']} is {ahead} from its goal, and playback holds goals back beyond {bound}"]


def _overlaps(pairs: list[dict[str, Any]], penetration: float, what: str) -> list[str]:
    """Return a sentence for each of the deepest pairs, and one for the number of the others; pairs come deepest first."""
    deep = [line for line in pairs if line["depth_m"] > penetration]
    sentences = [
        f"{' and '.join(line['bodies'])} {what} by up to {1000 * line['depth_m']:.1f} mm, "
        f"touching in {line['frames']} frames"
        for line in deep[:NAMED_PAIRS]
    ]
    return [*sentences, f"{len(deep) - NAMED_PAIRS} more pairs {what}"] if len(deep) > NAMED_PAIRS else sentences


def _feedback(figures: Mapping[str, Any]) -> list[str]:
    """What speaks against the feedback."""
    reasons = []
    if "feedback_oscillation_joint" in figures:
        joint, frequency = figures["feedback_oscillation_joint"], figures["feedback_oscillation_Hz"]
        size = figures["feedback_oscillation_rad"]
        reasons.append(
            f"the feedback oscillates: {joint} swings by {shown(size, 'rad')} at {frequency:g} Hz; lower its gains"
        )
    if figures.get("feedback_stopped_s") is not None:
        reasons.append(f"the feedback gave up on a lean and crouched at {figures['feedback_stopped_s']:g} s")
    return reasons
