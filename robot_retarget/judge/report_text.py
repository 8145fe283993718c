"""Text of a report: the outcome in a sentence, and its figures in common units with their meaning."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from robot_retarget.judge.report import Report
from robot_retarget.judge.verdict import CHECKS
from robot_retarget.judge.worlds import NOMINAL
from robot_retarget.scores.figure import shown, shown_apart
from robot_retarget.scores.likeness import UNLIKE, compared_figures


class Line(NamedTuple):
    """One thing that was judged."""

    held: bool
    what: str
    value: str = ""
    most: str = ""


class Fact(NamedTuple):
    """A figure that is reported and not judged."""

    figure: str
    what: str
    unit: str
    meaning: str


FACTS = (
    Fact("duration_s", "length", "s", "of the robot's motion, including the stands before and after"),
    Fact("slowdown", "slowdown", "times", "the length of the human's clip; 1 is the human's own pace"),
    Fact("limb_rad", "angle of limbs to the human's", "rad", "mean angle; under 10° looks alike"),
    *(
        fact
        for part in ("arms", "trunk", "legs")
        for fact in (
            Fact(f"limb_rad_{part}", f"angle of {part}", "rad", "mean angle to the human's"),
            Fact(f"limb_rad_{part}_best", f"least angle of {part}", "rad", "that ranges of joints alone allow"),
        )
    ),
    Fact("pace", "speed", "times", "the human's, each in its own legs: length of steps over slowdown"),
    Fact("stride", "length of steps", "times", "the human's, scaled to the robot's legs"),
    Fact("way_m", "way of the root", "", "under the policy, from start to end [m]"),
    Fact("planned_way_m", "way of the plan's root", "", "from start to end [m]"),
    Fact("draws", "randomised simulations", "", "with other mass, friction, servos, supply, floor and tilt"),
    Fact("tracking_rms_rad", "tracking error of all joints", "rad", "measured minus planned angle (rms), on the servos of the verdict"),
    Fact("servos", "servos of the verdict", "", "of the modelled, published and drawn ones those with the worst outcome"),
    Fact("plan_margin_m", "least margin of the plan", "m", "of the zero moment point to the edge of the soles: it orders falls"),
    Fact("zmp_margin_m", "least margin as simulated", "m", "of the zero moment point to the edge of the soles; below 0 it is outside, and a sole begins to tip"),
    Fact("peak_supply_current_A", "largest current", "A", "peak load of the power supply"),
    Fact("energy_J", "energy", "J", "total from the supply"),
    Fact("tracked_self_contact_share", "time in self-contact", "of all", "on the servos, intended or not"),
)  # fmt: skip


ELSEWHERE = {
    "nominal_tracking_rms_rad": "modelled servos",
    "played_tracking_rms_rad": "emulated bus",
    "plain_tracking_rms_rad": "goals without compensation",
}
"""Tracking errors of the same motion that are compared with that of the verdict, in one line."""


def headline(report: Report) -> str:
    """Return the outcome in one sentence, for a new reader of reports."""
    figures = report.figures
    if figures["unstable_s"] is not None:
        return f"The simulation broke down at {figures['unstable_s']:g} s of {figures['duration_s']:.1f} s."
    if figures.get("fall_s") is not None:
        return f"The robot falls over at {max(figures['fall_s'], 0):.1f} s of {figures['duration_s']:.1f} s."
    if report.reasons:
        came = "It stays on its feet" if "fall_s" in figures else "Held by the pelvis, it plays to the end"
        return f"{came}, but does not pass: {report.reasons[0]}."
    came = (
        "The robot stays on its feet to the end" if "fall_s" in figures else "Held by the pelvis, it plays to the end"
    )
    worst = figures.get("worst_joint_rms_rad")
    close = f", its joints within {shown(worst, 'rad')} of the plan (rms)" if worst is not None else ""
    return f"{came}{close}{_pace(figures)}{_likeness(figures)}."


def cured(report: Report) -> list[tuple[list[str], str, str]]:
    """Return reasons and differences with what helps and its command; those that one command helps stand together."""
    known = {cure.reason: (cure.what, cure.command) for cure in report.cures}
    groups: dict[tuple[str, str], list[str]] = {}
    for reason in (*report.reasons, *report.unlike):
        groups.setdefault(known.get(reason, ("", "")), []).append(reason)
    return [(reasons, what, command) for (what, command), reasons in groups.items()]


def judged_lines(report: Report) -> list[Line]:
    """Return every judged figure with its limit."""
    figures = compared_figures(report.figures)
    lines = [Line(figures["unstable_s"] is None, "the simulation runs to its end")]
    if "fall_s" in figures:
        lines.append(Line(figures["fall_s"] is None, "it stays up, and nothing but the feet touches the floor"))
    for check in (*CHECKS, *UNLIKE):
        value, most = figures.get(check.figure), getattr(report.thresholds, check.threshold)
        if value is not None:
            held = value <= most
            texts = (
                (shown(value, check.unit), shown(most, check.unit)) if held else shown_apart(value, most, check.unit)
            )
            lines.append(Line(held, check.what, *texts))
    if figures.get("plan_margin_m") is not None:
        margin, least = figures["plan_margin_m"], report.thresholds.zmp_margin
        own, most = shown_apart(margin, least, "m")
        lines.append(Line(margin >= least, "least margin of the plan", own, f"at least {most}"))
    return lines


WAYS = {"follow": "steps of the human", "turn": "turns in place", "stand": "both feet in place"}
"""The values of `legs` in words."""


def attempted(figures: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return (way, longest steps, slowdown, margin, rounds solved, reasons) of every attempt at balance; none without it."""
    units = {"reach": "of all", "slowdown": "", "margin_m": "m", "solved": ""}
    found = [(row, [row.get(name) for name in units]) for row in figures.get("attempts") or ()]
    return [
        (
            f"{WAYS.get(row.get('legs'), '–')}, {row.get('mode')}",
            *("–" if value is None else shown(value, unit) for value, unit in zip(values, units.values(), strict=True)),
            row.get("reasons") or "nothing",
        )
        for row, values in found
    ]


def facts(figures: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return (what, value, meaning) of every reported figure of a simulation."""
    found = ((fact, figures.get(fact.figure)) for fact in FACTS)
    lines = [(fact.what, shown(value, fact.unit), fact.meaning) for fact, value in found if value is not None]
    same = () if figures.get("servos") != NOMINAL else ("nominal_tracking_rms_rad",)
    elsewhere = ((figures.get(name), on) for name, on in ELSEWHERE.items() if name not in same)
    other = [f"{shown(error, 'rad')} {on}" for error, on in elsewhere if error is not None]
    return [
        *lines,
        *([("the same elsewhere", ", ".join(other), "tracking error of all joints (rms)")] if other else []),
    ]


def _pace(figures: Mapping[str, Any]) -> str:
    slower = figures.get("slowdown")
    return f", {slower:.1f} times as slow as the human" if slower is not None and slower > 1.05 else ""


def _likeness(figures: Mapping[str, Any]) -> str:
    angle = figures.get("limb_rad")
    return "" if angle is None else f", its limbs {shown(angle, 'rad')} from the human's on average"
