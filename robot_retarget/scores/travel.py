"""How far a body travels over the floor, how far it turns, and how many steps it takes.

p(t) = x(t) − x(0)        the place of the pelvis, seen from above
ψ(t) = α(t) − α(0)        the heading of the hip line, unwrapped
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, intervals
from robot_retarget.contact.rule import JOINTS, over_lowest
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot, world_points
from robot_retarget.robot.support import sole_corners


@dataclass(frozen=True)
class StepThresholds:
    """Which swings of a foot count as steps; lengths in units of the body's leg."""

    lift: float = JOINTS.high
    """A human swing counts if the ankle rises by more ..."""
    length: float = 0.3
    """... or comes down farther away; less is a shuffle, which a flat sole need not copy."""
    clearance: float = 0.02
    """A robot's sole is in the air above this height; planned swings are exact, captured ones are not."""


@dataclass(frozen=True, eq=False)
class Travel:
    """The travel of one body over T frames."""

    path: Floats
    """(T, 2) place of the pelvis relative to the first frame [m]."""
    heading: Floats
    """(T,) heading relative to the first frame, positive to the left [rad]; 0 without hips."""
    steps: int
    """Steps of all feet."""

    @property
    def distance(self) -> float:
        """The greatest distance from the first place [m]."""
        return float(np.linalg.norm(self.path, axis=1).max())

    @property
    def turn(self) -> float:
        """The greatest angle from the first heading [rad]."""
        return float(np.abs(self.heading).max())

    def figures(self) -> dict[str, float]:
        """The figures of reports."""
        return {"distance_m": round(self.distance, 3), "turn_rad": round(self.turn, 3), "steps": self.steps}


STEPS = StepThresholds()


def human_travel(human: HumanFeatures) -> Travel:
    """Return the travel of the human."""
    match, steps = human.calibration.match, 0
    for side, stands in human.contacts.items():
        foot = next((k for k in (f"{side}_ankle", f"{side}_toe") if k in match.keypoints), None)
        if foot is not None:
            place = human.positions[:, match.index(foot)] / match.human_leg
            steps += _counted(place, ~np.any(stands, axis=1))
    return _travel(human.positions, match, steps)


def robot_travel(x: Floats, qpos: Floats, robot: Robot, match: Match, fps: float) -> Travel:
    """Return the travel of a robot.

    Args:
        x: (T, K, 3) its keypoints [m].
        qpos: (T, nq) configurations.
        fps: frames per second [1/s].
    """
    feet, steps = tuple(match.anatomy.soles), 0
    if feet:
        soles = [world_points(robot, sole_corners(match.anatomy, foot), qpos)[..., 2].min(axis=1) for foot in feet]
        low = over_lowest(np.stack(soles, axis=1) / match.robot_leg, fps)
        steps = sum(len(_inner(foot, len(qpos))) for foot in (low > STEPS.clearance).T)
    return _travel(x, match, steps)


def _counted(place: Floats, swinging: Bools) -> int:
    """The number of swings of a foot, at places (T, 3) in legs, that lift it or carry it away."""
    count = 0
    for start, stop in _inner(swinging, len(place)):
        before, after = place[start - 1], place[stop]
        lift = place[start:stop, 2].max() - max(before[2], after[2])
        count += bool(lift > STEPS.lift or np.linalg.norm((after - before)[:2]) > STEPS.length)
    return count


def _inner(swinging: Bools, count: int) -> list[tuple[int, int]]:
    """The swings that begin and end inside a clip of `count` frames."""
    return [(start, stop) for start, stop in intervals(swinging) if start > 0 and stop < count]


def _travel(x: Floats, match: Match, steps: int) -> Travel:
    """Of keypoints (T, K, 3) [m]."""
    pelvis = x[:, match.index("pelvis") if "pelvis" in match.keypoints else 0, :2]
    turned = np.unwrap(match.heading(x))
    return Travel(pelvis - pelvis[0], turned - turned[0], steps)
