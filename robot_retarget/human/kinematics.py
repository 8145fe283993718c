"""Forward kinematics of a human skeleton: poses of joints in their parents ↔ poses in the world.

x_j = x_p + R_p t_j,  R_j = R_p Q_j,  with p the parent of j; over all frames at once, one joint after the other.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, Ints


def forward(parents: Ints, translations: Floats, rotations: Floats) -> tuple[Floats, Floats]:
    """World positions and rotations from each joint's pose in its parent.

    Args:
        parents: (J,) index of each joint's parent, −1 at a root; parents stand before children.
        translations: (T, J, 3) t_j, in the parent's frame.
        rotations: (T, J, 4) Q_j, unit w x y z.

    Returns:
        positions (T, J, 3) and rotations (T, J, 4).
    """
    positions = np.array(translations, dtype=float)
    turns: list[Rotation] = []
    for joint, parent in enumerate(parents):
        turn = Rotation.from_quat(rotations[:, joint], scalar_first=True)
        if parent >= 0:
            positions[:, joint] = positions[:, parent] + turns[parent].apply(positions[:, joint])
            turn = turns[parent] * turn
        turns.append(turn)
    world = np.stack([turn.as_quat(scalar_first=True) for turn in turns], axis=1)
    return positions, world


Place = tuple[float, float, float]
Turn = tuple[float, float, float, float]


def forward_once(
    parents: Sequence[int], translations: Sequence[Place], rotations: Sequence[Turn]
) -> tuple[list[Place], list[Turn]]:
    """`forward` of a single pose, in plain numbers: for a live stream, in a fifth of the time.

    Args:
        parents: J indices of parents, −1 at a root.
        translations: J places in the parents' frames.
        rotations: J unit quaternions w x y z in the parents' frames.
    """
    places: list[Place] = []
    turns: list[Turn] = []
    for parent, place, turn in zip(parents, translations, rotations, strict=True):
        if parent >= 0:
            carrier = turns[parent]
            (x, y, z), (dx, dy, dz) = places[parent], _turned(carrier, place)
            place, turn = (x + dx, y + dy, z + dz), _product(carrier, turn)
        places.append(place)
        turns.append(turn)
    return places, turns


def _turned(q: Turn, v: Place) -> Place:
    """q v q⁻¹ = v + w t + u × t with t = 2 u × v, for a unit quaternion q = (w, u)."""
    (w, a, b, c), (x, y, z) = q, v
    r, s, t = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    return x + w * r + b * t - c * s, y + w * s + c * r - a * t, z + w * t + a * s - b * r


def _product(p: Turn, q: Turn) -> Turn:
    (w, a, b, c), (x, d, e, f) = p, q
    return (
        w * x - a * d - b * e - c * f,
        w * d + a * x + b * f - c * e,
        w * e - a * f + b * x + c * d,
        w * f + a * e - b * d + c * x,
    )


def backward(parents: Ints, positions: Floats, rotations: Floats) -> tuple[Floats, Floats]:
    """Each joint's pose in its parent from the poses in the world; the inverse of `forward`.

    Args:
        parents: (J,) index of each joint's parent, −1 at a root.
        positions: (T, J, 3) in the world.
        rotations: (T, J, 4) in the world, unit w x y z.
    """
    translations, local = np.array(positions, dtype=float), np.array(rotations, dtype=float)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            undo = Rotation.from_quat(rotations[:, parent], scalar_first=True).inv()
            translations[:, joint] = undo.apply(positions[:, joint] - positions[:, parent])
            turn = undo * Rotation.from_quat(rotations[:, joint], scalar_first=True)
            local[:, joint] = turn.as_quat(scalar_first=True)
    return translations, local
