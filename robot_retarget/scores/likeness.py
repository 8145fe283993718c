"""Likeness of a robot's motion to the human's: limb directions, hand contacts, pace, travel, heading and steps.

    path_off     mean ‖Δp − r Δh‖ / max(mean ‖r Δh‖, ℓ)      pelvis p, human pelvis h, leg ratio r, robot leg ℓ
    heading_off  90th percentile of |Δψ_p − Δψ_h|
    steps_lost   share of the human's steps during which the same foot of the robot stays down

Δ is the change since the first frame. The human is always the one of the motion, also where the robot keeps its feet in place.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints, intervals
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.rule import JOINTS
from robot_retarget.contact.soles import sole_contacts
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot, world_points
from robot_retarget.scene import Scene
from robot_retarget.scores.figure import Check
from robot_retarget.scores.pair import PARTS, Pair, best_bone_angles

# How far a body travels over the floor, how far it turns, and how many steps it takes.
#
# p(t) = x(t) − x(0)        the place of the pelvis, seen from above
# ψ(t) = α(t) − α(0)        the heading of the hip line, unwrapped


LIFT = JOINTS.high
"""A human swing counts as a step if the ankle rises by more, over the leg [-] ..."""
LENGTH = 0.3
"""... or comes down farther away, over the leg [-]; less is a shuffle, which a flat sole need not copy. Of 21 clips
half counts other steps in 6 and double in 8."""


@dataclass(frozen=True, eq=False)
class Travel:
    """The travel of one body over T frames."""

    path: Floats
    """(T, 2) place of the pelvis relative to the first frame [m]."""
    heading: Floats
    """(T,) heading relative to the first frame, positive to the left [rad]; 0 without hips."""
    steps: tuple[tuple[str, int, int], ...]
    """Of each step the foot, the frame of its lift-off and that of its touchdown."""

    def figures(self) -> dict[str, float]:
        """The figures of reports: the greatest distance and angle from the first place and heading, and the steps."""
        distance, turn = np.linalg.norm(self.path, axis=1).max(), np.abs(self.heading).max()
        return {"distance_m": round(float(distance), 3), "turn_rad": round(float(turn), 3), "steps": len(self.steps)}


def human_travel(human: HumanFeatures) -> Travel:
    """Return the travel of the human."""
    match = human.calibration.match
    ends = {side: k for side in "lr" for k in (f"{side}_toe", f"{side}_ankle") if k in match.keypoints}
    places = {side: human.positions[:, match.index(k)] / match.human_leg for side, k in ends.items()}
    return _travel(
        human.positions, match, [step for step in human.contacts.swings if _is_step(places[step[0]], *step[1:])]
    )


def _is_step(place: Floats, start: int, stop: int) -> bool:
    """Whether a swing of a foot, at places (T, 3) in legs, lifts it or carries it away."""
    before, after = place[start - 1], place[stop]
    lift = place[start:stop, 2].max() - max(before[2], after[2])
    return bool(lift > LIFT or np.linalg.norm((after - before)[:2]) > LENGTH)


def _travel(x: Floats, match: Match, steps: Sequence[tuple[str, int, int]]) -> Travel:
    """Of keypoints (T, K, 3) [m]."""
    pelvis = x[:, match.index("pelvis") if "pelvis" in match.keypoints else 0, :2]
    turned = np.unwrap(match.heading(x))
    return Travel(pelvis - pelvis[0], turned - turned[0], tuple(steps))


FAR = np.radians(25.0)
"""A frame is far from the human's pose if its bones are off by more on average [rad]."""
AT_LIMIT = 0.99
"""A joint is at its limit of speed or torque from this share of it on [-]: the solver keeps limits to 1e-4."""
LASTING = 0.9
"""Quantile of the heading error that is judged [-]: a turn counts if it lasts for 10 % of the time."""


@dataclass(frozen=True, eq=False)
class Likeness:
    """How similar a robot's motion is to the human's."""

    angles: dict[str, Floats]
    """Per bone, named by the keypoint at its end, (T,) angle between the human's and the robot's, each seen from its own
    pelvis' heading [rad]."""
    contacts: float | None
    """Share of the human's hand contacts that the robot makes; None without contacts."""
    human: Travel
    """In the human's own metres."""
    robot: Travel
    path_off: float
    """Error of the pelvis path over its length, as above [-]."""
    slowdown: float
    """Duration over the human's."""
    stride: float
    """Length of the robot's steps over the scaled human's."""
    legs: str
    """`follow` the human's, `stand` (both feet in place, chosen by the user) or `instead` (in place because following failed)."""
    unfinished: float
    """Share of the frames that the solver did not finish."""
    rushed: Bools
    """(T,) whether a joint is at its speed limit."""
    pair: Pair
    """The compared keypoints of the robot, in its configurations."""
    feet: ContactRecord
    """Which feet of the robot are on the ground."""
    not_standing: str = ""
    """What of the motion no robot plays that stands on its own feet; empty without any."""

    def __repr__(self) -> str:
        return f"<Likeness over {len(self.rushed)} frames: {self.sentence}>"

    @cached_property
    def best(self) -> dict[str, Floats]:
        """Per bone the angles that ranges of joints alone allow, at some moments from the first frame to the last [rad]."""
        assert self.pair.model is not None
        return best_bone_angles(self.pair.model, self.pair.match, self.pair.human, self.pair.qpos, self.pair.fps)

    @property
    def far(self) -> Bools:
        """(T,) whether a frame is far from the human's pose, by the mean angle of its bones, where ranges of joints allow nearer ones."""
        if not self.angles:
            return np.zeros(len(self.rushed), bool)
        far = np.mean(list(self.angles.values()), axis=0) > FAR
        if not far.any():
            return far
        least = np.mean([self.best[bone] for bone in self.angles], axis=0)
        moments = np.linspace(0, len(far) - 1, len(least))
        return far & (np.interp(np.arange(len(far)), moments, least) < FAR)

    @property
    def notes(self) -> tuple[str, ...]:
        """Frames that are far from the human's pose, and frames with a joint at its speed limit, a sentence each."""
        notes = []
        if self.far.any():
            bone, angle, frame = self.peak()
            notes.append(
                f"{self._counted(self.far)} the limbs are over {np.degrees(FAR):.0f}° from the human's on average; "
                f"most {bone}, {np.degrees(angle):.0f}° at {frame / self.pair.fps:.1f} s"
            )
        if self.rushed.any():
            notes.append(
                f"{self._counted(self.rushed)} a joint is at its speed limit: the human is faster than the robot there"
            )
        return tuple(notes)

    def _counted(self, frames: Bools) -> str:
        """How many frames, and the longest stretch of them."""
        start, stop = max(intervals(frames), key=lambda run: run[1] - run[0])
        when = f"{start / self.pair.fps:.1f} to {stop / self.pair.fps:.1f} s"
        return f"In {int(frames.sum())} of {len(frames)} frames, longest from {when},"

    def peak(self) -> tuple[str, float, int]:
        """The bone with the largest angle of all frames, that angle [rad], and its frame."""
        bone, angle = max(self.angles.items(), key=lambda item: item[1].max())
        return bone, float(angle.max()), int(angle.argmax())

    @property
    def heading_off(self) -> float:
        """Error of the heading [rad]."""
        return float(np.quantile(np.abs(self.robot.heading - self.human.heading), LASTING))

    @property
    def steps_lost(self) -> float | None:
        """Share of the human's steps during which the same foot of the robot stays down; None if the human takes none."""
        down = dict(zip(self.feet.feet, self.feet.down.T, strict=True))
        lost = [foot not in down or down[foot][start:stop].all() for foot, start, stop in self.human.steps]
        return float(np.mean(lost)) if lost else None

    def part(self, name: str) -> float | None:
        """The mean angle of a part's bones [rad]; None if the robot lacks them."""
        return _mean_of_part(self.angles, name)

    def best_of_part(self, name: str) -> float | None:
        """The least mean angle of a part's bones that ranges of joints alone allow [rad]; None if they are not compared."""
        return None if self.part(name) is None else _mean_of_part(self.best, name)

    def beyond(self, name: str) -> float:
        """The mean angle of a part's bones beyond the least that ranges of joints allow [rad]; 0 without the part."""
        return max((self.part(name) or 0.0) - (self.best_of_part(name) or 0.0), 0.0)

    @property
    def pace(self) -> float | None:
        """Speed over the human's, each in its own legs [-]: length of steps over slowdown; None without steps of both."""
        return self.stride / self.slowdown if self.robot.steps and self.human.steps else None

    def worst(self) -> tuple[str, float]:
        """The bone with the largest mean angle, and that angle [rad]."""
        means = {bone: float(angle.mean()) for bone, angle in self.angles.items()}
        return max(means.items(), key=lambda item: item[1]) if means else ("", 0.0)

    @property
    def sentence(self) -> str:
        """A summary in one line."""
        parts = ((name, self.part(name)) for name in PARTS)
        off = ", ".join(f"{name} {np.degrees(angle):.0f}°" for name, angle in parts if angle is not None)
        pace = f", {self.slowdown:.1f} times as slow" if round(self.slowdown, 1) > 1 else ""
        return f"{off} from the human's on average{pace}"

    def figures(self) -> dict[str, Any]:
        """The figures of reports: angles [rad], shares, factors."""
        bone, off = self.worst()
        mean = float(np.mean([angle.mean() for angle in self.angles.values()])) if self.angles else None
        return {
            **{f"limb_rad_{name}": _rounded(self.part(name)) for name in PARTS},
            **{f"limb_rad_{name}_best": _rounded(self.best_of_part(name)) for name in PARTS},
            "limb_rad": _rounded(mean),
            "limb_rad_worst": _rounded(off),
            "limb_worst": bone,
            "limbs_far_share": round(float(self.far.mean()), 4) if self.angles else None,
            "limb_peak_rad": _rounded(self.peak()[1]) if self.angles else None,
            "at_speed_limit_share": round(float(self.rushed.mean()), 4) if len(self.rushed) else None,
            "contacts_lost": None if self.contacts is None else round(1 - self.contacts, 3),
            "slowdown": round(self.slowdown, 3),
            "stride": round(self.stride, 3) if self.robot.steps else None,
            "pace": None if self.pace is None else round(self.pace, 3),
            "not_standing": self.not_standing or None,
            "unfinished_share": round(self.unfinished, 3),
            "legs": self.legs,
            **self._travel_figures(),
        }

    def _travel_figures(self) -> dict[str, Any]:
        """Travel of both; its errors are None where the user chose that both feet stay in place."""
        errors = {
            "path_off": _rounded(self.path_off),
            "heading_off_rad": _rounded(self.heading_off),
            "steps_lost": _rounded(self.steps_lost),
            "steps_shortened": round(1 - self.stride, 3) if self.robot.steps else None,
        }
        return {
            **(dict.fromkeys(errors) if self.legs == "stand" else errors),
            **{
                f"{who}_{name}": value
                for who, travel in (("human", self.human), ("robot", self.robot))
                for name, value in travel.figures().items()
            },
        }


def likeness_of(
    human: HumanFeatures,
    robot: Robot,
    qpos: Floats,
    frames: slice | Bools | Ints = slice(None),
    *,
    slowdown: float = 1.0,
    stride: float = 1.0,
    legs: str = "follow",
    unfinished: float = 0.0,
    scene: Scene | None = None,
) -> Likeness:
    """Compare configurations (T, nq) with the human, frame by frame.

    Args:
        frames: consecutive ones that are compared; all by default.
        scene: the bodies around the robot.
    """
    match = human.calibration.match
    feet = sole_contacts(robot, match.anatomy, qpos, human.fps, scene)[frames]
    human, qpos = human.at(frames), qpos[frames]
    places = world_points(robot, match.points, qpos)
    pair = Pair(match, human.positions, places, human.contacts, human.fps, robot, qpos)
    performed, moved = human_travel(human), _travel(pair.robot, match, feet.swings)
    angles = pair.bone_angles(PARTS.keys() - ({"legs"} if legs == "stand" else set()))
    path = _path_off(moved.path, match.leg_ratio * performed.path, match.robot_leg)
    rushed = _rushed(robot, qpos, human.fps)
    return Likeness(
        angles, pair.touches.share, performed, moved, path, slowdown, stride, legs, unfinished, rushed,
        pair, feet, human.not_standing,
    )  # fmt: skip


def _mean_of_part(angles: dict[str, Floats], name: str) -> float | None:
    own = [angle for bone, angle in angles.items() if bone.split("_")[-1] in PARTS[name]]
    return float(np.mean(own)) if own else None


def _rushed(robot: Robot, qpos: Floats, fps: float) -> Bools:
    """(T,) whether a joint is at its speed limit on the way to the next frame; the last frame has none."""
    speed = np.abs(np.diff(qpos[:, robot.qpos_index], axis=0)) * fps
    return np.append((speed >= AT_LIMIT * robot.max_speed).any(axis=1), False)


def _path_off(robot: Floats, human: Floats, leg: float) -> float:
    """The error of a path (T, 2) against the scaled human's, over the human's mean distance from its start or a leg [-]."""
    off, away = (np.linalg.norm(way, axis=1).mean() for way in (robot - human, human))
    return float(off / max(away, leg))


# How alike is alike: limits, and a sentence for each figure beyond its limit. The verdict and balance read these.


@dataclass(frozen=True)
class Alike:
    """Limits of a motion that is like the human's.

    In brackets: how many of 31 clips on the G1 and on the OP3 without balance, 62, exceed half of a limit, the limit and double.
    """

    unlike_arms: float = 0.2
    """Mean angle of upper arms and forearms to the human's, beyond the least that ranges of joints allow [rad] ..."""
    unlike_trunk: float = 0.2
    """... the same of the trunk ..."""
    unlike_legs: float = 0.4
    """... and of thighs and shins. On the OP3 ranges alone cost arms 14° on average (wave, walk), trunk 1° and legs 0°: with
    them these limits are angles of 26, 12 and 23°."""
    limbs_far: float = 0.05
    """Share of the frames in which the limbs are over 25° from the human's on average: a fall, a roll, a leap."""
    unlike_slowdown: float = 2.5
    """Duration over the human's."""
    contacts_lost: float = 0.3
    """Share of the human's hand contacts that the robot does not make (1, 0, 0)."""
    steps_shortened: float = 0.6
    """Share by which steps are shorter than the scaled human's (0, 0, 0); half steps make 0.5."""
    path_off: float = steps_shortened
    """Mean error of the pelvis' place over the human's mean distance from its start, or a leg: steps of half their length make
    0.5 here too, standing in place makes 1."""
    heading_off: float = 0.6
    """Heading error that lasts for a tenth of the time [rad] (0, 0, 0): 34°."""
    steps_lost: float = 0.5
    """Share of the human's steps that the robot does not take (11, 3, 0): every second one makes 0.5."""
    unfinished: float = 0.25
    """Share of the frames that the solver did not finish (0, 0, 0): one in 4."""


def _part_check(part: str, are: str) -> Check:
    return Check(
        f"unlike_{part}", f"limb_rad_{part}_beyond", f"mean angle of the {part} to the human's, beyond what ranges of joints cost",
        "rad", f"{part} {are} {{limb_{part}}} from the human's on average, {{value}} more than ranges of joints cost",
    )  # fmt: skip


UNLIKE = (
    _part_check("arms", "are"),
    _part_check("trunk", "is"),
    _part_check("legs", "are"),
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
TRAVEL = ("path_off", "heading_off", "steps_lost")
"""The thresholds that a robot exceeds by standing in place."""


def unlikeness(figures: Mapping[str, Any], most: Alike) -> tuple[str, ...]:
    """Return the differences from the human's motion that exceed their limits, a sentence each."""
    return tuple(sentence for sentence, _ in differences(figures, most))


def differences(figures: Mapping[str, Any], most: Alike) -> list[tuple[str, str]]:
    """Return each difference from the human's motion beyond its limit, with its threshold."""
    figures = compared_figures(figures)
    over = [check for check in UNLIKE if check.exceeded(figures, most)]
    stands = figures.get("legs") == "instead" and any(check.threshold in TRAVEL for check in over)
    own = [check for check in over if not (stands and check.threshold in TRAVEL)]
    in_place = [(stands_in_place(figures), TRAVEL[0])] if stands else []
    return [*in_place, *((check.reason(figures, most), check.threshold) for check in own)]


def compared_figures(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures with two for each part: the angle as text, and the angle beyond the ranges' share (0 if the share is unknown)."""
    found = dict(figures)
    for part in PARTS:
        angle = found.get(f"limb_rad_{part}")
        if angle is not None:
            found[f"limb_rad_{part}_beyond"] = max(angle - (found.get(f"limb_rad_{part}_best") or 0.0), 0.0)
            found[f"limb_{part}"] = f"{np.degrees(angle):.0f}°"
    return found


def stands_in_place(figures: Mapping[str, Any]) -> str:
    """Name the travel and the steps of the human that a robot with its feet in place leaves out."""
    turn, steps = np.degrees(figures.get("human_turn_rad", 0.0)), figures.get("human_steps")
    stepping = f" in {steps} step{'s' if steps > 1 else ''}" if steps else ""
    return (
        f"stands in place: the human moves {figures.get('human_distance_m', 0.0):.1f} m and turns {turn:.0f}°{stepping}"
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
