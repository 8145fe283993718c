"""The verdict on a simulation: the reasons against it, its differences from the human, and the badge that names both."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_retarget.actuators.goals import TRACKING_RMS
from robot_retarget.base.errors import LISTED, UsageError, known
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.judge.bodies import dropped
from robot_retarget.judge.cures import Cure, Failing, Origin, cure_of
from robot_retarget.judge.stance import missed_steps
from robot_retarget.scores.figure import Check, shown
from robot_retarget.scores.likeness import UNLIKE, Alike, compared_figures, differences
from robot_retarget.scores.subject import OVERLAP

# Limits of a pass: one table, which a TOML file can override line by line.


@dataclass(frozen=True)
class Thresholds(Alike):
    """Limits of a pass, and of likeness. An unstable simulation and a fall in mode `free` always fail."""

    tracking_rms: float = TRACKING_RMS
    """Of the worst joint [rad]."""
    penetration: float = OVERLAP
    """Of the robot with itself in the replay [m]; no frame may be deeper."""
    between_frames: float = 0.01
    """Of the robot with itself on the straight way from frame to frame [m]: 8 N at the end of an arm of 15 cm move
    a servo this far; the tracking error covers stronger contacts."""
    tracked_penetration: float = 0.002
    """Of the robot with itself on the servos [m]: the softness of the contact of a limb that is pressed on, 0.001 at most in twenty clips measured
    on the OP3."""
    range_excess: float = 0.01
    """Beyond a joint's range in the replay [rad]: 0.6°, six ticks of 0.0015 rad of an encoder."""
    speed_ratio: float = 2.0
    """Planned speed of the fastest joint over its speed limit: 0.8 in 21 balanced clips, measured; beyond twice the limit a servo does not follow."""
    saturated_share: float = 0.5
    """Share of the time at the torque limit."""
    temperature_rise: float = 40.0
    """Of the hottest servo over the trajectory [K]: room temperature to 70 °C."""
    foot_slip: float = 0.01
    """Slip of a standing foot [m], in mode `free`: of twenty clips measured on the OP3, those that stay up slip by 0.004 at most."""
    body_contacts_lost: float = 0.3
    """Share of the planned time of contacts with bodies that the simulation lacks."""
    fallen_share: float = 0.1
    """Share of the drawn simulations (`worlds.Spread`) that end in a fall, in mode `free`: one of 10."""
    zmp_margin: float = 0.007
    """A pass is at the edge if the least margin of the zero moment point in its plan is smaller [m]. The plan's margin orders falls: of nine walks on
    the OP3 in five soft worlds each 0 of 45 with 8.2 mm and more, 0 of 5 with 6.9 mm, 1 with 4.7, 2 with 1.7 and 5 with −.3 mm. That of the
    simulation does not: −.1 to 1.7 mm in all nine that stand."""

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
          "falls in {value} of {draws} simulations with other mass, friction, servos, supply, floor and tilt"),
    Check("range_excess", "range_excess_rad", "beyond a joint's range, planned", "rad",
          "{range_excess_joint} leaves its range by {value}"),
)  # fmt: skip
OVERLAPS = ("penetration", "between_frames", "tracked_penetration")
"""Thresholds of overlaps, whose sentences name pairs of links (`verdict.judge`)."""
FROM_STANDING = ("foot_slip", "fallen_share")
"""Thresholds that say nothing of a robot that fell."""


def read_thresholds(path: str | Path) -> Thresholds:
    """Read thresholds from TOML: `tracking_rms = 0.1`; others keep their defaults, `inf` switches one off.

    Raises:
        UsageError: The file is not TOML, names a threshold that is not known, or gives one that is not a number.
    """
    table = read_toml(path, UsageError)
    names = [*Thresholds.__annotations__, *Alike.__annotations__]
    strange = [name for name in table if name not in names]
    if strange:
        raise UsageError(f"{path}: no threshold {strange[0]!r}; {known(names, typed=strange[0])}")
    try:
        return Thresholds(**table)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


TEXTS = {
    "pass": "pass",
    "edge": "pass, at the edge",
    "unlike": "pass, but unlike",
    "unplayable": "not playable standing",
    "fail": "fail",
}
"""Levels of a badge for people."""


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
    edge: bool = False
    """Whether the zero moment point of the plan comes near the edge of the support."""
    standing: bool = True
    """Whether a standing robot can play the human's motion."""
    pace: float | None = None
    """Speed over the human's, each in its own legs [-]; None without steps, and under a policy, which has its own."""
    policy: str = ""
    """The frozen controller that made the goals; empty without one."""
    margin: float | None = None
    """Least margin of the zero moment point in the plan [m]; None without balance, and under a policy."""

    @property
    def level(self) -> str:
        """`pass`, `edge`, `unlike`, `unplayable` or `fail`: the badge's colour."""
        if not self.passed:
            return "fail"
        if self.unlike:
            return "unlike" if self.standing or self.pinned else "unplayable"
        return "edge" if self.edge else "pass"

    @property
    def text(self) -> str:
        """For people: `pass (pinned)`, `pass (free, margin 8 mm, at 0.86 of the human's speed)`, `not playable standing (free)`."""
        verdict = TEXTS[self.level]
        if self.level in ("pass", "edge") and not self.compared:
            verdict = f"{verdict}, likeness not judged"
        how = ["pinned" if self.pinned else "free", *(["with feedback"] if self.feedback else [])]
        how += [f"under {self.policy}"] if self.policy else []
        if self.margin is not None and not self.pinned:
            how.append(f"margin {1000 * self.margin:.0f} mm")
        if self.pace is not None and not self.pinned:
            how.append(f"at {self.pace:.2f} of the human's speed")
        return f"{verdict} ({', '.join(how)})"

    def contract(self) -> dict[str, str]:
        """The content for JSON."""
        return {"text": self.text, "level": self.level}


def badge_of(reasons: tuple[str, ...], unlike: tuple[str, ...], figures: Mapping[str, Any]) -> Badge:
    """Return the badge of a simulation with these reasons, differences and figures."""
    return Badge(
        not reasons, bool(unlike), figures["mode"] == "pinned", bool(figures.get("feedback")), "limb_rad" in figures,
        bool(figures.get("at_edge")), not figures.get("not_standing"),
        None if "policy" in figures else figures.get("pace"), figures.get("policy", ""),
        None if "policy" in figures else figures.get("plan_margin_m"),
    )  # fmt: skip


def judge(figures: Mapping[str, Any], most: Thresholds) -> tuple[str, ...]:
    """Return the reasons against a trajectory; none for a pass."""
    return tuple(reason for reason, _ in _findings(figures, most))


def cures(figures: Mapping[str, Any], most: Thresholds, origin: Origin | None = None) -> tuple[Cure, ...]:
    """Return what helps against each reason and each difference from the human, in their order.

    Args:
        origin: files and commands that the cures name; by default placeholders.
    """
    failing = Failing(figures, most, origin or Origin())
    return tuple(cure_of(*found, failing) for found in (*_findings(figures, most), *differences(figures, most)))


def at_edge(figures: Mapping[str, Any], most: Thresholds) -> bool:
    """Return whether the zero moment point of the plan comes nearer to the edge of the support than its least margin."""
    margin = figures.get("plan_margin_m")
    return margin is not None and margin < most.zmp_margin


def near_limits(figures: Mapping[str, Any], most: Thresholds) -> list[str]:
    """Return a sentence for each figure that another run may put on the other side of its limit."""
    known = compared_figures(figures)
    near = [check for check in (*CHECKS, *UNLIKE) if check.near(known, most)]
    return [
        f"near its limit: {check.what}, {shown(known[check.figure], check.unit)} of "
        f"{shown(getattr(most, check.threshold), check.unit)}"
        for check in near
    ]


def _findings(figures: Mapping[str, Any], most: Thresholds) -> list[tuple[str, str]]:
    """Return each reason against a trajectory with its kind, a key of `cures.CURES`."""
    skipped = OVERLAPS if figures.get("fall_s") is None else (*OVERLAPS, *FROM_STANDING)
    over = [check for check in CHECKS if check.threshold not in skipped and check.exceeded(figures, most)]
    return [
        *_upright(figures),
        *_feedback(figures),
        *((check.reason(figures, most), check.threshold) for check in over),
        *_goal_step(figures),
        *((reason, "dropped") for reason in dropped(figures)),
        *((reason, "missed_step") for reason in missed_steps(figures)),
        *_links(figures, most),
    ]


def _links(figures: Mapping[str, Any], most: Thresholds) -> Iterator[tuple[str, str]]:
    """Yield links inside each other: at the frames, between them, and on the servos of a robot that stays up."""
    for deep in _overlaps(figures["self_contacts"], most.penetration, "overlap"):
        yield deep, "penetration"
    if figures["between_frames_depth_m"] > max(most.between_frames, figures["self_contact_depth_m"]):
        depth, when = 1000 * figures["between_frames_depth_m"], figures["between_frames_s"]
        pair = " and ".join(figures["between_frames_bodies"])
        yield f"{pair} pass through each other by {depth:.1f} mm between two frames, at {when:g} s", "between_frames"
    if figures.get("fall_s") is None:
        planned = [line["bodies"] for line in figures["self_contacts"] if line["depth_m"] > most.penetration]
        hits = [line for line in figures["tracked_self_contacts"] if line["bodies"] not in planned]
        for hit in _overlaps(hits, most.tracked_penetration, "hit each other on the servos, overlapping"):
            yield hit, "tracked_penetration"


def _upright(figures: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what kept the simulation or the robot from the end."""
    if figures["unstable_s"] is not None:
        yield f"the simulation broke down at {figures['unstable_s']:g} s", "unstable"
    if figures.get("fall_s") is not None:
        when = f"at {figures['fall_s']:g} s" if figures["fall_s"] >= 0 else "in the first pose, before it began to move"
        body = figures["fall_body"]
        yield f"fell: {f'{body} touched the floor' if body else 'sank to half its height'} {when}", "fell"
        stiffness, gravity = figures.get("ankle_stiffness_Nm_rad", 0.0), figures.get("tipping_stiffness_Nm_rad", 0.0)
        if stiffness < gravity:
            soft = f"its ankles are too soft to stand on: {stiffness:g} N m/rad, and gravity tips it over with {gravity:g} N m/rad"
            yield soft, "soft"


def _goal_step(figures: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield goals that playback would hold back."""
    cap = figures.get("goal_step_limit_rad")
    if cap is not None and figures["goal_step_rad"] > cap:
        ahead, joint = shown(figures["goal_step_rad"], "rad"), figures["goal_step_joint"]
        yield f"{joint} is {ahead} from its goal, and playback holds goals back beyond {shown(cap, 'rad')}", "goal_step"


def _overlaps(pairs: list[dict[str, Any]], penetration: float, what: str) -> list[str]:
    """Return a sentence for each of the deepest pairs, and one for the number of the others; pairs come deepest first."""
    deep = [line for line in pairs if line["depth_m"] > penetration]
    sentences = [
        f"{' and '.join(line['bodies'])} {what} by up to {1000 * line['depth_m']:.1f} mm, "
        f"touching in {line['frames']} frames"
        for line in deep[:LISTED]
    ]
    return [*sentences, f"{len(deep) - LISTED} more pairs {what}"] if len(deep) > LISTED else sentences


def _feedback(figures: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what speaks against the feedback."""
    if "feedback_oscillation_joint" in figures:
        joint, frequency = figures["feedback_oscillation_joint"], figures["feedback_oscillation_Hz"]
        size = shown(figures["feedback_oscillation_rad"], "rad")
        yield f"the feedback oscillates: {joint} swings by {size} at {frequency:g} Hz", "oscillates"
    if figures.get("feedback_stopped_s") is not None:
        yield f"the feedback gave up on a lean and crouched at {figures['feedback_stopped_s']:g} s", "gave_up"
