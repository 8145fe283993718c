"""The verdict on a simulation: the reasons against it, its differences from the human, and the badge that names both."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_retarget.judge.bodies import dropped
from robot_retarget.judge.feedback_figures import feedback_reasons
from robot_retarget.judge.kept_contacts import missed_steps
from robot_retarget.judge.thresholds import CHECKS, FROM_STANDING, OVERLAPS, UNLIKE, Thresholds
from robot_retarget.judge.units import shown

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
        *feedback_reasons(figures),
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
