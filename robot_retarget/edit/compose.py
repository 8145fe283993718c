"""Motions of one performer made into one: joined at seams, spliced of legs and arms, at another speed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.keypoints import ARM, SIDES
from robot_retarget.base.ramps import minimum_jerk
from robot_retarget.edit.seam import Seam, Stances, table_of
from robot_retarget.human.kinematics import backward, forward
from robot_retarget.human.motion import Motion
from robot_retarget.human.resample import at_frames

ARMS = tuple(f"{side}_{part}" for side in SIDES for part in ARM)
"""Keypoints that a splice takes from the second motion."""


def joined(motions: Sequence[Motion], seams: Sequence[Seam]) -> Motion:
    """Return motions one after the other, each placed where the one before has brought the performer.

    During a seam the pose of every joint in its parent passes over with minimum jerk,  (1 − s) a ⊕ s b,  and a foot
    stands where it stands in both. A foot whose places differ steps.

    Args:
        motions: N of one performer, at one rate.
        seams: N − 1, in the frames of the motions.
    """
    whole, shift = motions[0], 0
    for before, after, seam in zip(motions[:-1], motions[1:], seams, strict=True):
        leave = seam.leave + shift
        placed = _placed(after, whole, before, seam, shift)
        parts = [whole.frames(0, leave - seam.frames)] if leave > seam.frames else []
        parts.append(_faded(whole, placed, replace(seam, leave=leave)))
        if seam.enter + seam.frames + 1 < len(placed):
            parts.append(placed.frames(seam.enter + seam.frames + 1))
        whole, shift = _chained(parts), leave - seam.frames - seam.enter
    return replace(whole, source=" + ".join(dict.fromkeys(filter(None, (m.source for m in motions)))), start_time=0.0)


def _placed(after: Motion, whole: Motion, before: Motion, seam: Seam, shift: int) -> Motion:
    """Return a motion turned about the vertical and moved so that its anchor meets that of the motion before."""
    anchor = int(table_of(before, after, seam).anchors[0, 0])
    there, here, (k, e) = Stances(whole), Stances(after), seam.middle
    k += shift
    turn = there.headings[k, anchor] / here.headings[e, anchor]
    move = there.places[k, anchor] - turn * here.places[e, anchor]
    spin = Rotation.from_euler("z", float(np.angle(turn)))
    assert after.rotations is not None
    turned = spin * Rotation.from_quat(after.rotations.reshape(-1, 4), scalar_first=True)
    places = after.positions @ spin.as_matrix().T + [move.real, move.imag, 0.0]
    return replace(
        after, positions=places, rotations=turned.as_quat(scalar_first=True).reshape(after.rotations.shape), whole=None
    )


def _faded(before: Motion, after: Motion, seam: Seam) -> Motion:
    """Return the n + 1 frames of a seam: paired frames of both motions, in order."""
    count = seam.frames + 1
    here = before.frames(seam.leave - seam.frames, seam.leave + 1)
    there = after.frames(seam.enter, seam.enter + count)
    paired = np.arange(2 * count).reshape(2, count).T.reshape(-1)
    pairs = at_frames(_chained([here, there]), paired.astype(float), before.fps)
    share = minimum_jerk(np.linspace(0.0, 1.0, count))
    faded = at_frames(pairs, 2 * np.arange(count) + share, before.fps)
    if here.contacts is None or there.contacts is None:
        return faded
    return replace(faded, contacts=here.contacts & there.contacts & ~_stepping(before, after, seam))


def _stepping(before: Motion, after: Motion, seam: Seam) -> np.ndarray:
    """(4,) whether left heel, left toe, right heel and right toe step during a seam."""
    table = table_of(before, after, seam)
    steps = table.gaps[0, 0] > table.slip
    return np.repeat([steps and foot != table.anchors[0, 0] for foot in range(2)], 2)


def _chained(motions: Sequence[Motion]) -> Motion:
    """Return the frames of motions of one performer, one after the other."""
    contacts = [m.contacts for m in motions if m.contacts is not None]
    rotations = [m.rotations for m in motions if m.rotations is not None]
    return replace(
        motions[0],
        positions=np.concatenate([m.positions for m in motions]),
        rotations=np.concatenate(rotations),
        contacts=np.concatenate(contacts) if contacts else None,
        whole=None,
    )


def spliced(legs: Motion, arms: Motion) -> Motion:
    """Return a motion with the arms of another, in the same pose relative to the chest; it has the duration of the legs.

    Arms that end before hold their last pose.

    Args:
        legs: the motion of legs, trunk and head.
        arms: another of the same performer and rate.
    """
    parents, names = legs.skeleton.parents, legs.skeleton.names
    columns = [k for k, name in enumerate(names) if name in ARMS]
    assert legs.rotations is not None
    own = backward(parents, legs.positions, legs.rotations)
    other = at_frames(arms, np.arange(len(legs), dtype=float), legs.fps)
    assert other.rotations is not None
    for mine, theirs in zip(own, backward(parents, other.positions, other.rotations), strict=True):
        mine[:, columns] = theirs[:, columns]
    positions, rotations = forward(parents, *own)
    source = f"{legs.source} + arms of {arms.source}"
    return replace(legs, positions=positions, rotations=rotations, source=source, whole=None)


def retimed(motion: Motion, speed: float) -> Motion:
    """Return the motion at a factor of its speed, at the same rate.

    Args:
        motion: the motion.
        speed: factor [-].
    """
    frames: Floats = np.arange(0.0, len(motion) - 1 + 1e-9, speed)
    return at_frames(motion, frames, motion.fps)
