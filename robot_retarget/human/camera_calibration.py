"""Calibration frames: a clip may start or end with a T-pose, or at the origin, and jump into the motion or out of it.

A retargeter that starts there sends the robot across the room. What jumps is dropped; a T- or A-pose that leads smoothly into
the motion may be intended, and is only reported.
"""

import numpy as np

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.keypoints import ARM, LEG, SIDES
from robot_retarget.human.recognition.recognise import Recognition, leg_length
from robot_retarget.human.repair.repair import RepairRule
from robot_retarget.human.repair.sentences import span
from robot_retarget.human.repair.steps import excess

HELD = 0.3
"""Least duration of a calibration pose [s] ..."""
NEAR = 0.35
"""... whose joints are this near to their angles: knees and elbows straight, upper arms raised from the trunk [rad]."""
RAISED = {"T-pose": np.pi / 2, "A-pose": np.pi / 4}
"""Angle between upper arms and the way down the trunk [rad]."""


def calibration_frames(recognition: Recognition, positions: Floats, fps: float) -> tuple[slice, tuple[str, ...]]:
    """Return the frames of the motion proper, and sentences about the still poses before its first jump and after its last.

    The body jumps where its keypoints, on average, step farther than a body can.

    Args:
        positions: (T, J, 3) of the joints [any unit].
        fps: frames per second [1/s].
    """
    rule, points = RepairRule(), recognition.place(positions) / leg_length(recognition, positions)
    steps = np.linalg.norm(excess(np.diff(points, axis=0), rule.steps), axis=2).mean(axis=1)
    jumps = np.flatnonzero(steps > rule.steps.body_threshold(fps)) + 1
    start, stop, notes = 0, len(points), []
    if jumps.size and stop - jumps[0] > 1 and np.ptp(points[: jumps[0]], axis=0).max() < rule.still:
        start = int(jumps[0])
        notes.append(_dropped("first", start, fps, "from"))
    if jumps.size and jumps[-1] - start > 1 and np.ptp(points[jumps[-1] :], axis=0).max() < rule.still:
        stop = int(jumps[-1])
        notes.append(_dropped("last", len(points) - stop, fps, "to"))
    return slice(start, stop), tuple(notes)


def _dropped(which: str, count: int, fps: float, way: str) -> str:
    what = (
        f"The {which} frame is a calibration"
        if count == 1
        else f"The {which} {count} frames ({count / fps:.2f} s) are one"
    )
    return f"{what} pose, {way} which the body jumps: dropped."


def calibration_pose_notes(recognition: Recognition, positions: Floats, fps: float) -> tuple[str, ...]:
    """A sentence for each end of a clip that is a T- or an A-pose, held still before or after a motion.

    Args:
        positions: (T, J, 3) of the joints, z up [m].
        fps: frames per second [1/s].
    """
    x, notes, count = recognition.place(positions) / leg_length(recognition, positions), [], len(positions)
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
    moved = np.linalg.norm(x - x[:1], axis=2).max(axis=1) > RepairRule().still
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
