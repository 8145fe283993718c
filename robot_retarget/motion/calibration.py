"""Calibration frames: a clip may start or end with a T-pose, or at the origin, and jump into the motion or out of it.

A retargeter that starts there sends the robot across the room. What jumps is dropped; a T- or A-pose that leads smoothly into
the motion may be intended, and is only reported.
"""

import numpy as np

from robot_retarget.arrays import Floats, unit
from robot_retarget.keypoints import ARM, LEG, SIDES
from robot_retarget.motion.recognise import Recognition
from robot_retarget.motion.repair.repair import RepairRule
from robot_retarget.motion.repair.sentences import span
from robot_retarget.motion.repair.steps import JumpRule

WINDOW = 10
"""Frames at an end that are searched for a jump, and frames next to them with which it is compared."""
TIMES = 4.0
"""The jump over the largest step that follows (clean clips: at most 2; clips with calibration frames: 6.6 and more)."""
HELD = 0.3
"""Least duration of a calibration pose [s] ..."""
NEAR = 0.35
"""... whose joints are this near to their angles: knees and elbows straight, upper arms raised from the trunk [rad]."""
RAISED = {"T-pose": np.pi / 2, "A-pose": np.pi / 4}
"""Angle between upper arms and the way down the trunk [rad]."""


def calibration_frames(recognition: Recognition, positions: Floats, fps: float) -> tuple[slice, tuple[str, ...]]:
    """The frames of the motion proper, and a sentence about those before and after it.

    Args:
        recognition: keypoints of the skeleton.
        positions: (T, J, 3) of the joints [any unit].
        fps: frames per second [1/s].
    """
    notes = []
    start, size = _jumped(recognition, positions, fps)
    if start:
        notes.append(_dropped("first", start, size, "the next"))
    end, size = _jumped(recognition, positions[:start:-1] if start else positions[::-1], fps)
    if end:
        notes.append(_dropped("last", end, size, "the one before"))
    return slice(start, len(positions) - end), tuple(notes)


def _dropped(which: str, count: int, size: float, beside: str) -> str:
    what = f"The {which} frame is" if count == 1 else f"The {which} {count} frames are"
    return f"{what} a calibration pose, {size:.1f} leg lengths from {beside}: dropped."


def _jumped(recognition: Recognition, positions: Floats, fps: float) -> tuple[int, float]:
    """How many frames lie before the jump at the start, and how far it goes, in leg lengths."""
    x = recognition.place(positions[: 2 * WINDOW + 2])
    rule = JumpRule()
    steps = np.linalg.norm(np.diff(x, axis=0), axis=2).mean(axis=1) / _leg(recognition, x)
    for last in range(min(WINDOW, len(steps) - 3) - 1, -1, -1):
        if steps[last] > max(rule.body_threshold(fps), TIMES * steps[last + 1 : last + 1 + WINDOW].max()):
            return last + 1, float(steps[last])
    return 0, 0.0


def _leg(recognition: Recognition, x: Floats) -> float:
    at = recognition.keypoints.index
    hip, knee, ankle = (x[:, at(f"l_{part}")] for part in LEG[:3])
    return float(np.median(np.linalg.norm(hip - knee, axis=1) + np.linalg.norm(knee - ankle, axis=1)))


def calibration_pose_notes(recognition: Recognition, positions: Floats, fps: float) -> tuple[str, ...]:
    """A sentence for each end of a clip that is a T- or an A-pose, held still before or after a motion.

    Args:
        recognition: keypoints of the skeleton.
        positions: (T, J, 3) of the joints, z up [m].
        fps: frames per second [1/s].
    """
    x, notes, count = recognition.place(positions), [], len(positions)
    for which, seen in (("starts", x), ("ends", x[::-1])):
        pose, held = _pose(recognition, seen), _held(recognition, seen)
        if pose and HELD * fps <= held < count / 2:
            first, last = (0, held - 1) if which == "starts" else (count - held, count - 1)
            rest = f"{held}:" if which == "starts" else f":{count - held}"
            where = span(first, last, fps)
            notes.append(f"It {which} in a {pose}, {where}: --frames {rest} leaves it out.")
    return tuple(notes)


def _held(recognition: Recognition, x: Floats) -> int:
    """For how many frames the first pose is held."""
    moved = np.linalg.norm(x - x[:1], axis=2).max(axis=1) > RepairRule().still * _leg(recognition, x[:1])
    return int(moved.argmax()) if moved.any() else len(x)


def _pose(recognition: Recognition, x: Floats) -> str:
    """The name of the calibration pose in the first frame; empty for any other pose."""
    at = {keypoint: x[0, k] for k, keypoint in enumerate(recognition.keypoints)}
    limbs = [[at[f"{side}_{part}"] for part in parts[:3]] for side in SIDES for parts in (ARM, LEG)]
    bends = [np.arccos(np.clip(unit(b - a) @ unit(c - b), -1, 1)) for a, b, c in limbs]
    if max(bends) > NEAR:
        return ""
    shoulders = (at["l_shoulder"] + at["r_shoulder"]) / 2
    down = unit(at["pelvis"] - shoulders)
    raised = [np.arccos(np.clip(unit(at[f"{s}_elbow"] - at[f"{s}_shoulder"]) @ down, -1, 1)) for s in SIDES]
    return next((pose for pose, angle in RAISED.items() if np.abs(np.subtract(raised, angle)).max() < NEAR), "")
