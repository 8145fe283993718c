"""Forward kinematics of a human skeleton: poses of joints in their parents ↔ poses in the world.

x_j = x_p + R_p t_j,  R_j = R_p Q_j,  with p the parent of j; over all frames at once, one joint after the other.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats, Ints


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


def backward(parents: Ints, positions: Floats, rotations: Floats) -> tuple[Floats, Floats]:
    """Each joint's pose in its parent from the poses in the world; the inverse of `forward`."""
    translations, local = np.array(positions, dtype=float), np.array(rotations, dtype=float)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            undo = Rotation.from_quat(rotations[:, parent], scalar_first=True).inv()
            translations[:, joint] = undo.apply(positions[:, joint] - positions[:, parent])
            turn = undo * Rotation.from_quat(rotations[:, joint], scalar_first=True)
            local[:, joint] = turn.as_quat(scalar_first=True)
    return translations, local
