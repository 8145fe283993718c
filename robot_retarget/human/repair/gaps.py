"""Stretches in which a limb was lost, and the way across them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robot_retarget.base.arrays import Floats
from robot_retarget.base.keypoints import ARM, LEG, SIDES
from robot_retarget.human.capture import Capture
from robot_retarget.human.kinematics import backward, forward
from robot_retarget.human.recognition.recognise import Recognition

STILL = 1e-4
"""A limb that moves less than this from frame to frame does not move at all [leg lengths]."""


def limbs_of(recognition: Recognition) -> dict[str, list[str]]:
    """The keypoints of every limb and of the head, the first of them the one that it hangs from."""
    kinds = {"arm": ARM, "leg": LEG}
    limbs = {f"{side}_{kind}": [f"{side}_{part}" for part in parts] for kind, parts in kinds.items() for side in SIDES}
    limbs["head"] = ["neck", "head"]
    there = {limb: [k for k in keypoints if k in recognition.marks] for limb, keypoints in limbs.items()}
    return {limb: keypoints for limb, keypoints in there.items() if keypoints[:1] == limbs[limb][:1] and keypoints[1:]}


def gaps(jumps: Floats, points: Floats, longest: int) -> Iterator[tuple[int, int, float, bool]]:
    """First and last frame of a limb's gaps, the largest jump [leg lengths], and whether both ends were found.

    Two jumps at most `longest` frames apart enclose a gap if the second goes back. A single jump ends a gap in which the limb
    stood still.

    Args:
        jumps: (T − 1, 3) how the limb's end jumps between frames.
        points: (T, P, 3) of the limb, seen from where it hangs [leg lengths].
    """
    size = np.linalg.norm(jumps, axis=1)
    steps = np.flatnonzero(size).tolist()
    while steps:
        first = steps.pop(0)
        back = [s for s in steps if s - first <= longest and _returns(jumps[first], jumps[s])]
        if back:
            steps = [step for step in steps if step > back[-1]]
            yield first + 1, back[-1], float(size[first : back[-1] + 1].max()), True
            continue
        moves = np.linalg.norm(np.diff(points[: first + 1], axis=0), axis=2).max(axis=1, initial=0.0) > STILL
        start = int(np.flatnonzero(moves)[-1]) + 2 if moves.any() else 0
        lost = start > 0 and first - start >= 2
        yield (start, first, float(size[first]), True) if lost else (first + 1, first + 1, float(size[first]), False)


def _returns(there: Floats, back: Floats) -> bool:
    """Whether a jump undoes another, to half of the larger one."""
    return bool(np.linalg.norm(there + back) < 0.5 * max(np.linalg.norm(there), np.linalg.norm(back)))


def bridged(capture: Capture, joint: int, first: int, last: int) -> Capture:
    """Interpolate the joints from `joint` on between the frame before `first` and the one after `last`.

    Each turns in its parent along the shortest way; without rotations its place as seen from its parent is led.

    Args:
        joint: the first joint that is interpolated.
        first: first frame of the gap.
        last: last frame of the gap.
    """
    skeleton = capture.skeleton
    joints = [k for k in range(len(skeleton)) if joint in skeleton.above(k)]
    ends, inside = [first - 1, last + 1], np.arange(first, last + 1)
    share = ((inside - ends[0]) / (ends[1] - ends[0]))[:, None]
    local = (
        capture.rotations
        if capture.rotations is not None
        else np.tile([1.0, 0, 0, 0], (*capture.positions.shape[:2], 1))
    )
    translations, turns = backward(skeleton.parents, capture.positions, local)
    for k in joints:
        a, b = translations[ends, k]
        translations[inside, k] = a + share * (b - a)
        way = Slerp(ends, Rotation.from_quat(turns[ends, k], scalar_first=True))
        turns[inside, k] = way(inside).as_quat(scalar_first=True)
    positions, rotations = forward(skeleton.parents, translations, turns)
    return replace(capture, positions=positions, rotations=None if capture.rotations is None else rotations)
