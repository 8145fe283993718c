"""Calibration frames: a clip may start with a T-pose or at the origin and jump into the motion.

A retargeter that starts there sends the robot across the room.
"""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.motion.recognise import Recognition

WINDOW = 10
"""Frames at the start in which the jump is looked for, and after it with which it is compared."""
JUMP = 0.1
"""Least mean step of the keypoints that counts as a jump, in leg lengths."""
SPEED = 8.0
"""Least speed of that step, in leg lengths per second."""
TIMES = 4.0
"""The jump over the largest step that follows (clean clips: at most 2; clips with calibration frames: 6.6 and more)."""


def calibration_frames(recognition: Recognition, positions: Floats, fps: float) -> tuple[int, tuple[str, ...]]:
    """The first frame of the motion proper, and a sentence about those before it."""
    x = recognition.place(positions[: 2 * WINDOW + 2])
    at = recognition.keypoints.index
    leg = np.linalg.norm(x[:, at("l_hip")] - x[:, at("l_knee")], axis=1) + np.linalg.norm(
        x[:, at("l_knee")] - x[:, at("l_ankle")], axis=1
    )
    steps = np.linalg.norm(np.diff(x, axis=0), axis=2).mean(axis=1) / np.median(leg)
    for last in range(min(WINDOW, len(steps) - 3) - 1, -1, -1):
        if steps[last] > max(JUMP, SPEED / fps, TIMES * steps[last + 1 : last + 1 + WINDOW].max()):
            count = last + 1
            what = "The first frame is" if count == 1 else f"The first {count} frames are"
            return count, (f"{what} a calibration pose, {steps[last]:.1f} leg lengths from the next: dropped.",)
    return 0, ()
