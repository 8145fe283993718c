"""A motion at another frame rate."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.human.skeleton import backward, forward

RATES = (1.0, 1000.0)
"""Accepted frames per second [1/s]; others are mistakes."""


def resample(motion: Motion, fps: float) -> Motion:
    """The motion at `fps`, its duration kept to half a frame.

    With rotations, each joint's pose in its parent is interpolated (slerp, lerp) and put together again, so that bones
    keep their lengths; without, positions are interpolated linearly.

    Args:
        motion: the motion.
        fps: the new rate [1/s].

    Raises:
        UsageError: `fps` is not a number from 1 to 1000.
    """
    if not RATES[0] <= fps <= RATES[1]:
        raise UsageError(f"frames per second must be from {RATES[0]:g} to {RATES[1]:g}, got {fps}")
    if fps == motion.fps or len(motion.clip) == 1:
        return replace(motion, fps=fps)
    count = max(1, round(motion.duration * fps)) + 1 if len(motion) > 1 else 1
    step, first = motion.fps / fps, motion.span.start
    before = int(first / step)
    after = max(0, int((len(motion.clip) - 1 - first) / step) - count + 1)
    frames = first + step * np.arange(-before, count + after)
    resampled = at_frames(motion.clip, frames, fps)
    return resampled if motion.whole is None else resampled.frames(before, before + count)


def at_frames(motion: Motion, frames: Floats, fps: float) -> Motion:
    """The motion at (T,) whole or broken numbers of its frames, in any order, the ends held beyond them; played at `fps`.

    Contacts are those of the nearest frame.

    Args:
        motion: the motion.
        frames: (N,) indices of frames, whole or not.
        fps: rate at which the result is played [1/s].
    """
    at = np.clip(frames, 0, len(motion) - 1)
    contacts = None if motion.contacts is None else motion.contacts[np.round(at).astype(int)]
    began = motion.start_time + float(frames[0]) / motion.fps if len(frames) else motion.start_time
    around = None if motion.scene is None else motion.scene.resampled(at)
    motion = replace(motion, contacts=None, scene=None, start_time=began)
    if len(motion) == 1:
        return replace(
            motion,
            positions=np.repeat(motion.positions, len(frames), axis=0),
            fps=fps,
            rotations=_held(motion, len(frames)),
            contacts=contacts,
            scene=around,
        )
    before = np.minimum(at.astype(int), len(motion) - 2)
    share = np.asarray(at - before, dtype=np.float64)[:, None]
    if motion.rotations is None:
        return replace(
            motion, positions=_lerp(motion.positions, before, share), fps=fps, contacts=contacts, scene=around
        )
    parents = motion.skeleton.parents
    translations, turns = backward(parents, motion.positions, motion.rotations)
    positions, rotations = forward(parents, _lerp(translations, before, share), _slerp(turns, before, share))
    return replace(motion, positions=positions, rotations=rotations, fps=fps, contacts=contacts, scene=around)


def _held(motion: Motion, count: int) -> Floats | None:
    return None if motion.rotations is None else np.repeat(motion.rotations, count, axis=0)


def _lerp(values: Floats, before: np.ndarray, share: Floats) -> Floats:
    return values[before] + share[..., None] * (values[before + 1] - values[before])


def _slerp(values: Floats, before: np.ndarray, share: Floats) -> Floats:
    """q (q⁻¹ r)^u of (T, J, 4) unit quaternions, every joint by its own shortest way."""
    shape = (len(before), *values.shape[1:])
    start, end = (
        Rotation.from_quat(values[frames].reshape(-1, 4), scalar_first=True) for frames in (before, before + 1)
    )
    part = np.broadcast_to(share, shape[:2]).reshape(-1, 1)
    turned = start * Rotation.from_rotvec(part * (start.inv() * end).as_rotvec())
    return turned.as_quat(scalar_first=True).reshape(shape)
