"""Make the sample clips of `samples/`: wave, clap, hips and bow, squat, walk.

Each clip is composed, not captured: targets for pelvis, hands and feet, joined by minimum-jerk moves (moves.py) and
worn by a mannequin (mannequin.py); the walk follows published joint angles (gait.py). The files come out the same on every run.

    python scripts/tools/make_samples.py [--out samples]
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from gait import CYCLE, Stride, arm_swing, steady
from mannequin import (
    ANKLE_HEIGHT,
    FOREARM,
    SHIN,
    SHOULDER,
    SIDES,
    THIGH,
    UPPER_ARM,
    WAIST,
    Act,
    Foot,
    Hand,
    perform,
)
from moves import Floats, covered, through, turning
from scipy.optimize import root_scalar

from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.bvh import write_bvh

FPS = 30.0
STANDING = np.array([0.025, 0.0, ANKLE_HEIGHT + THIGH + SHIN - 0.003])
"""Where the hip joints of a standing body are, before and above its ankles, the knees all but straight [m]."""

Vector = tuple[float, float, float]


class Reach(NamedTuple):
    """What a left hand does; see `mannequin.Hand`."""

    wrist: Vector
    elbow: Vector
    palm: Vector
    fingers: Vector


HANGING = Reach((0.05, 0.245, -0.512), (-1, 0.25, 0), (0, -1, 0), (0.25, -0.05, -1))
RAISED = Reach((0.17, 0.36, 0.20), (-0.3, 0.5, -1), (1, 0, 0), (0.1, 0.1, 1))
APART = Reach((0.33, 0.16, -0.09), (-0.3, 0.5, -1), (0, -1, 0.1), (0.8, 0.03, 0.55))
TOGETHER = Reach((0.33, 0.025, -0.07), (-0.3, 0.6, -1), (0, -1, 0), (0.8, -0.06, 0.6))
FORWARD = Reach((0.41, 0.17, 0.30), (0, 0.4, -1), (0, -1, 0), (0.8, -0.05, 0.6))
# These two in the pelvis.
AKIMBO = Reach((0.02, 0.20, 0.07), (-0.3, 1, 0), (0.5, -1, 0), (0.72, -0.5, -0.35))
BESIDE = HANGING._replace(wrist=(0.05, 0.245, WAIST - 0.512))


def wave() -> Motion:
    """The right hand is raised, waves four times and goes down."""
    time = clock(5.6)
    beat, start, stop = 0.6, 1.5, 1.5 + 4 * 0.6
    swing = through(time, (start - 0.3, 0.0), (start + 0.4, 1.0), (stop - 0.4, 1.0), (stop + 0.3, 0.0))
    swing *= np.sin(2 * np.pi * (time - start) / beat)
    raised = through(time, (0.4, 0.0), (1.4, 1.0), (stop, 1.0), (stop + 1.1, 0.0))
    right = hand(time, "Right", (0.4, HANGING), (1.4, RAISED), (stop, RAISED), (stop + 1.1, HANGING))
    # About the elbow: the wrist on an arc, the hand a little further.
    arc = np.stack([0 * swing, 0.09 * swing, -((0.09 * swing) ** 2) / (2 * FOREARM)], axis=-1)
    right = replace(right, wrist=right.wrist + arc, fingers=right.fingers + np.outer(swing, [0, 0.5, 0]))
    act = standing(
        time,
        hips=np.outer(raised, [0, 0.015, 0]),
        spine=np.radians(np.outer(raised, [0, 0, 3])),
        head=np.radians(np.outer(raised, [-6, -3, 4])),
        hands={"Right": right, "Left": hand(time, "Left", (0, HANGING))},
    )
    return perform(act, FPS, "wave")


def clap() -> Motion:
    """The hands meet six times in front of the chest."""
    time = clock(5.8)
    claps = [(1.4 + 0.5 * k + shift, reach) for k in range(6) for shift, reach in ((0.2, TOGETHER), (0.5, APART))]
    keys = [(0.4, HANGING), (1.4, APART), *claps, (5.4, HANGING)]
    nod = through(time, (0.4, 0.0), (1.4, 1.0), (4.4, 1.0), (5.4, 0.0))
    act = standing(
        time,
        spine=np.radians(np.outer(nod, [0, 3, 0])),
        head=np.radians(np.outer(nod, [0, 6, 0])),
        hands={side: hand(time, side, *keys) for side in SIDES},
    )
    return perform(act, FPS, "clap")


def hips_and_bow() -> Motion:
    """The hands go to the hips, the body bows and rises, the hands go down."""
    time = clock(6.8)
    bow = through(time, (1.7, 0.0), (3.1, 1.0), (3.6, 1.0), (5.0, 0.0))
    keys = [(0.4, BESIDE), (1.4, AKIMBO), (5.3, AKIMBO), (6.3, BESIDE)]
    act = standing(
        time,
        hips=np.outer(bow, [-0.14, 0, -0.008]),
        pelvis=np.radians(np.outer(bow, [0, 38, 0])),
        spine=np.radians(np.outer(bow, [0, 16, 0])),
        head=np.radians(np.outer(bow, [0, 6, 0])),
        hands={side: hand(time, side, *keys, about=SHOULDER + np.array([0, 0, WAIST])) for side in SIDES},
        hands_in="Hips",
    )
    return perform(act, FPS, "hips_and_bow")


def squat() -> Motion:
    """Two squats with planted feet, the arms stretched forward for balance."""
    time = clock(6.8)
    downs = [
        (0.5 + 2.9 * k + shift, depth) for k in range(2) for shift, depth in ((0, 0), (1.3, 1), (1.6, 1), (2.8, 0))
    ]
    keys = [(moment, FORWARD if depth else HANGING) for moment, depth in downs]
    down = through(time, *downs)
    act = standing(
        time,
        stance=0.12,
        hips=np.outer(down, [-0.19, 0, -0.40]),
        pelvis=np.radians(np.outer(down, [0, 28, 0])),
        spine=np.radians(np.outer(down, [0, 12, 0])),
        head=np.radians(np.outer(down, [0, -25, 0])),
        hands={side: hand(time, side, *keys) for side in SIDES},
    )
    return perform(act, FPS, "squat")


def walk() -> Motion:
    """From standing, seven steps forward and back to standing.

    At the first phase and at the last one foot swings past the other, which stands: there the walk is joined to
    standing on the spot, the swinging foot put up or down.
    """
    stride, stance, steps = steady(), 0.07, 7
    passing = _passing(stride)
    begin, ramp = 0.6, 0.8
    end = begin + steps / 2 * CYCLE
    time = clock(end + ramp + 0.8)
    phase = passing + (covered(time, begin, ramp) - covered(time, end, ramp)) / CYCLE
    walking = through(time, (0.4, 0.0), (1.1, 1.0), (end + 0.1, 1.0), (end + 0.8, 0.0))
    place = np.where(time < (begin + end) / 2, 0.0, steps / 2 * stride.length)
    hands = {side: hand(time, side, (0, HANGING)) for side in SIDES}
    act = _blend(standing(time, hands, stance=stance, place=place), _walking(stride, phase, stance), walking)
    return perform(act, FPS, "walk")


def standing(time: Floats, hands: dict[str, Hand], stance: float = 0.0875, place: Floats | float = 0.0, **does) -> Act:
    """A body that stands at x = `place`, its feet `stance` to the sides, and what else it does; `hips` by how much."""
    rest = np.zeros((len(time), 3))
    there = rest + np.multiply.outer(place, [1, 0, 0])
    feet = {
        side: Foot(there + np.array([0, sign * stance, ANKLE_HEIGHT]), rest[:, 0], rest[:, 0])
        for side, sign in SIDES.items()
    }
    turns = {part: does.pop(part, rest) for part in ("pelvis", "spine", "head")}
    return Act(there + STANDING + does.pop("hips", 0), **turns, hands=hands, feet=feet, **does)


def _walking(stride: Stride, phase: Floats, stance: float) -> Act:
    """Steady walking: the left leg at `phase`, the right one half a stride on; the trunk turns against the pelvis."""
    own = {"Left": phase, "Right": phase + 0.5}
    feet = {side: stride.foot(own[side], SIDES[side] * stance) for side in SIDES}
    feet["Right"].ankle[:, 0] -= stride.length / 2
    (x, z), beat, rest = stride.hips(phase), 2 * np.pi * phase, 0 * phase
    return Act(
        hips=np.stack([x, 0.022 * np.sin(beat), z], axis=-1),
        pelvis=np.radians(np.stack([-4 * np.cos(beat), rest, 3 * np.cos(beat - 0.9)], axis=-1)),
        spine=np.radians(np.stack([7 * np.cos(beat), rest + 3, -3 * np.cos(beat - 0.9)], axis=-1)),
        head=np.radians(np.stack([-3 * np.cos(beat), rest - 2, rest], axis=-1)),
        hands={side: _swinging(side, own[side]) for side in SIDES},
        feet=feet,
    )


def _passing(stride: Stride) -> float:
    """The phase at which the other foot swings past the one that stands."""

    def ahead(phase: float) -> float:
        return float(stride.foot(np.array([phase + 0.5]), 0).ankle[0, 0]) - stride.length / 2

    return float(root_scalar(ahead, bracket=(0.15, 0.35)).root)


def _swinging(side: str, phase: Floats) -> Hand:
    """A hand that swings with its arm, of the phase of the leg on its side."""
    upper, bend = arm_swing(phase)
    lower, rest = upper + bend, np.zeros((len(phase), 3))
    forth = UPPER_ARM * np.sin(upper) + FOREARM * np.sin(lower)
    down = UPPER_ARM * np.cos(upper) + FOREARM * np.cos(lower) - 0.005
    wrist = np.stack([SHOULDER[0] + forth, rest[:, 0] + HANGING.wrist[1], SHOULDER[2] - down], axis=-1)
    fingers = np.stack([np.sin(lower), rest[:, 0] - 0.05, -np.cos(lower)], axis=-1)
    way = (wrist, rest + HANGING.elbow, rest + HANGING.palm, fingers)
    return Hand(*(mirrored(vectors, side) for vectors in way))


def _blend(one: Act, other: Act, share: Floats) -> Act:
    """From one act to another as the share goes from 0 to 1."""

    def mixed(here: Floats, there: Floats) -> Floats:
        # A foot comes up before it turns, lest its toes dip into the ground.
        return here + (share[:, None] if here.ndim > 1 else share**2) * (there - here)

    def joined(here, there):
        return type(here)(*map(mixed, vars(here).values(), vars(there).values()))

    return Act(
        hips=mixed(one.hips, other.hips),
        pelvis=mixed(one.pelvis, other.pelvis),
        spine=mixed(one.spine, other.spine),
        head=mixed(one.head, other.head),
        hands={side: joined(one.hands[side], other.hands[side]) for side in SIDES},
        feet={side: joined(one.feet[side], other.feet[side]) for side in SIDES},
    )


def hand(time: Floats, side: str, *keys: tuple[float, Reach], about: Floats = SHOULDER) -> Hand:
    """A hand that goes through keys given for the left side, the wrist on arcs about the left shoulder."""
    moments = [moment for moment, _ in keys]
    arms = [np.subtract(reach.wrist, about) for _, reach in keys]
    lengths = through(time, *zip(moments, np.linalg.norm(arms, axis=1), strict=True))
    ways = [arms, *([reach[part] for _, reach in keys] for part in (1, 2, 3))]
    wrist, *others = (turning(time, *zip(moments, way, strict=True)) for way in ways)
    return Hand(*(mirrored(vectors, side) for vectors in (about + lengths[:, None] * wrist, *others)))


def mirrored(vectors: Floats, side: str) -> Floats:
    """Vectors of the left side, on this side."""
    return vectors * (1.0, SIDES[side], 1.0)


def clock(seconds: float) -> Floats:
    """The times of the frames [s]."""
    return np.arange(round(seconds * FPS) + 1) / FPS


CLIPS = (wave, clap, hips_and_bow, squat, walk)


def main() -> None:
    parser = argparse.ArgumentParser(description="Make the sample clips.")
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parents[2] / "samples")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for clip in CLIPS:
        motion = clip()
        path = folder / f"{motion.source}.bvh"
        write_bvh(motion, path)
        # The sign of a zero is rounding noise that differs from run to run.
        path.write_text(path.read_text().replace("-0.000000", "0.000000"), newline="\n")
        print(f"{motion.source}: {len(motion)} frames, {motion.duration:.1f} s")


if __name__ == "__main__":
    main()
