"""Compare the solved motion with the human's as an observer would: same motion, mirrored or upside down.

The solver can only follow the map of both bodies. Where the map is wrong (a heel in place of a toe, a front in place of
a back), the solver follows it faithfully, and the error shows on the robot: it faces elsewhere, or its knees bend the
other way.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, unit
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import body_frames, world_points

AGAINST = -0.5
"""The robot's direction opposes the human's if the cosine between them is smaller: more than 120° apart."""
BENT = 0.4
"""Knees and elbows of a human count as bent if the sine of the angle is larger: 24° and more."""
STRAIGHT = {"knee": 0.5, "elbow": -0.2}
"""The robot's limb opposes the human's if it has a smaller share of this bend. A reversed knee stops at its limit,
because it bends backwards; a reversed elbow bends away. Arms of few hinges leave an elbow straight where a human bends
it sideways. With half 21 clips are accepted as well; double would refuse 10."""
LEVEL = 0.5
"""A left direction that points up or down by a larger cosine, 30° over the level, has no heading."""
ELBOWS_APART = 0.5
"""Elbows at least this far apart sideways, in shoulder widths, are on two sides. Half and double accept the same 21
clips."""
SHOWN = 0.2
"""A check needs this share of the frames to show its feature (half and double accept the same 21 clips) ..."""
OPPOSED = 0.6
"""... and reports a mismatch if the robot opposes the human in this share of them: more than half, and with 0.3 the
same 21 clips are accepted."""
LIMBS = {"knee": ("hip", "ankle"), "elbow": ("shoulder", "hand")}


@dataclass(frozen=True)
class PlausibilityCheck:
    """One thing that was looked at."""

    what: str
    shown: Bools
    """(T,) whether a frame shows the feature."""
    opposed: Bools
    """(T,) whether the robot opposes the human there."""
    cause: str
    """The likely error, and the line of a map file that corrects it."""

    @property
    def against(self) -> float:
        """Share of the frames that show the feature in which the robot opposes the human."""
        return float(self.opposed[self.shown].mean()) if self.shown.any() else 0.0

    @property
    def wrong(self) -> bool:
        """Whether the robot opposes the human in most of the frames that show the feature."""
        return self.shown.mean() > SHOWN and self.against > OPPOSED


def mismatch(human: HumanFeatures, robot: Robot, qpos: Floats, source: str) -> str:
    """Describe the features in which a robot opposes the human over most of the clip; empty without any.

    Args:
        qpos: (T, nq) solved configurations.
        source: name of the motion.
    """
    wrong = [check for check in plausibility_checks(human, robot, qpos) if check.wrong]
    if not wrong:
        return ""
    seen = "; ".join(f"{g.what} in {g.against:.0%} of the frames that show it" for g in wrong)
    return f"{robot.name} does not do what {source or 'the human'} shows: {seen}. {wrong[0].cause}"


def plausibility_checks(human: HumanFeatures, robot: Robot, qpos: Floats) -> list[PlausibilityCheck]:
    """Return the checks of the features by which a robot may oppose the human: bends of limbs, head over pelvis, sides.

    Args:
        qpos: (T, nq) solved configurations.
    """
    match = human.calibration.match
    shown, own = match.named(human.positions), match.named(world_points(robot, match.points, qpos))
    return [*_bends(shown, own), *_upright(shown, own), *_sides(robot, match, qpos, shown, own)]


def _bends(human: dict[str, Floats], own: dict[str, Floats]) -> Iterator[PlausibilityCheck]:
    """Knees and elbows bend the human's way."""
    for side, called in (("l", "left"), ("r", "right")):
        for joint, ends in LIMBS.items():
            keys = [f"{side}_{k}" for k in (ends[0], joint, ends[1])]
            if not set(keys) <= human.keys():
                continue
            wanted, actual = (_fold(*(body[k] for k in keys)) for body in (human, own))
            bend = np.linalg.norm(wanted, axis=1)
            along = (actual * unit(wanted)).sum(axis=1) / np.maximum(bend, BENT)
            cause = (
                f"Front and back, or left and right, of one of the two are likely taken wrong: `forward = [x, y, z]` in "
                f'[robot], or `{side}_{joint} = "Joint"` in [human] of a map file (--map) mends it; where the other side bends rightly, a '
                "[range] of --limits does: that of the model then bends this one the wrong way"
            )
            what = f"its {called} {joint} does not bend that way"
            yield PlausibilityCheck(what, bend > BENT, along < STRAIGHT[joint], cause)


def _fold(start: Floats, middle: Floats, end: Floats) -> Floats:
    """Return the axis (T, 3) about which a limb bends, with the sine of the angle as its length."""
    return np.cross(unit(middle - start), unit(end - middle))


def _upright(human: dict[str, Floats], own: dict[str, Floats]) -> Iterator[PlausibilityCheck]:
    """The head is over the pelvis, or under it, as the human's is."""
    top = next((k for k in ("head", "neck", "chest") if k in human), None)
    if top and "pelvis" in human:
        wanted, actual = (unit(body[top] - body["pelvis"]) for body in (human, own))
        cause = "The motion's up axis is likely taken wrong: `--up` says which one it is"
        what, always = f"its {top} is where the human's feet are", np.ones(len(wanted), bool)
        yield PlausibilityCheck(what, always, _opposed(wanted, actual), cause)


def _sides(
    robot: Robot, match: Match, qpos: Floats, human: dict[str, Floats], own: dict[str, Floats]
) -> Iterator[PlausibilityCheck]:
    """Pelvis and chest face where the human's do; elbows are on their own sides."""
    rotations = body_frames(robot, qpos)[1]
    cause = (
        "Left and right of one of the two are likely taken for each other: `forward = [x, y, z]` in [robot], or lines "
        '`l_hip = "Joint"`, `r_hip = "Joint"` … in [human] of a map file (--map) mend it'
    )
    for segment, pair in (("pelvis", "hip"), ("chest", "shoulder")):
        keys = [f"{side}_{pair}" for side in "lr"]
        if segment in match.anatomy.frames and set(keys) <= human.keys():
            body, axes = match.anatomy.frames[segment]
            wanted, actual = unit(human[keys[0]] - human[keys[1]]), rotations[:, body] @ axes[:, 1]
            shown = (np.abs(wanted[:, 2]) < LEVEL) & (np.abs(actual[:, 2]) < LEVEL)
            yield PlausibilityCheck(f"its {segment} faces the other way", shown, _opposed(wanted, actual), cause)
            if segment == "chest":
                yield _elbows(human, own, wanted, actual, cause)


def _elbows(
    human: dict[str, Floats], own: dict[str, Floats], wanted: Floats, actual: Floats, cause: str
) -> PlausibilityCheck:
    """The left elbow is to the left of the right one, seen from the chests with such lefts (T, 3).

    Hands change sides where arms cross. Elbows do not.
    """
    apart = [
        ((body["l_elbow"] - body["r_elbow"]) * left).sum(axis=1)
        / np.linalg.norm(body["l_shoulder"] - body["r_shoulder"], axis=1)
        if {"l_elbow", "r_elbow"} <= body.keys()
        else np.zeros(len(left))
        for body, left in ((human, wanted), (own, actual))
    ]
    what = "its left elbow is where the human's right one is"
    return PlausibilityCheck(what, np.abs(apart[0]) > ELBOWS_APART, apart[1] * np.sign(apart[0]) < 0, cause)


def _opposed(wanted: Floats, actual: Floats) -> Bools:
    """(T,) whether directions of the robot oppose those of the human (T, 3)."""
    return (unit(wanted) * unit(actual)).sum(axis=1) < AGAINST
