"""The skeleton of a human: a tree of joints."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, Ints, frozen, path_to_root
from robot_retarget.base.errors import MotionError


@dataclass(frozen=True)
class Skeleton:
    """A tree of joints, the pair (S, χ) of [Mucherino2019] with χ(v) the displacement from the parent.

    Joints stand after their parents; joint 0 is a root (parent −1). End sites are joints too, named `PARENT_end`.
    """

    names: tuple[str, ...]
    parents: Ints
    """(J,) index of each joint's parent, −1 at a root."""
    offsets: Floats
    """(J, 3) displacement from the parent in the rest pose [m]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "parents", frozen(self.parents, np.int64))
        object.__setattr__(self, "offsets", frozen(self.offsets))
        count = len(self.names)
        if count == 0 or self.parents.shape != (count,) or self.offsets.shape != (count, 3):
            raise MotionError(
                f"a skeleton of {count} names needs parents ({count},) and offsets ({count}, 3), "
                f"got {self.parents.shape} and {self.offsets.shape}"
            )
        late = np.flatnonzero(self.parents >= np.arange(count))
        if late.size:
            raise MotionError(f"joint {self.names[late[0]]!r} stands before its parent")

    def __repr__(self) -> str:
        return f"<Skeleton: {len(self)} joints, {', '.join(self.names[:3])} …>"

    def __len__(self) -> int:
        return len(self.names)

    def rest(self) -> Floats:
        """(J, 3) positions of the joints in the rest pose, each root at its offset [m]."""
        place = np.array(self.offsets)
        for joint in np.flatnonzero(self.parents >= 0):
            place[joint] += place[self.parents[joint]]
        return place

    def posed(self, root: Floats, joints: Sequence[int], turns: Floats) -> tuple[Floats, Floats]:
        """World positions (T, J, 3) and rotations (T, J, 4) of turned joints; the others keep their pose in their parent.

        Args:
            root: (T, 3) places of the root [m].
            joints: indices of N joints.
            turns: (T, N, 4) of these joints in their parents, unit w x y z.
        """
        translations = np.tile(self.offsets, (len(turns), 1, 1))
        translations[:, 0] = root
        local = np.tile([1.0, 0.0, 0.0, 0.0], (len(turns), len(self), 1))
        local[:, list(joints)] = turns
        return forward(self.parents, translations, local)

    def above(self, joint: int) -> tuple[int, ...]:
        """A joint and all that carry it, up to the root."""
        return tuple(path_to_root(self.parents, joint))

    def below(self, *joints: int) -> list[int]:
        """Return some joints and all that they carry."""
        carried = set(joints)
        for child, parent in enumerate(self.parents.tolist()):
            if parent in carried:
                carried.add(child)
        return sorted(carried)

    def outward(self, joint: int) -> Floats:
        """(3,) from a joint to the next on the way to its farthest descendant at rest [m]; 0 for a joint without children.

        Joints that stand where their parent does are passed over. From a wrist this is the way to the middle finger.
        """
        carried, step = [joint], {joint: np.zeros(3)}
        for child in range(joint + 1, len(self)):
            before = step.get(int(self.parents[child]))
            if before is not None:
                carried.append(child)
                step[child] = before if before.any() else self.offsets[child]
        place = self.rest()
        away = np.linalg.norm(place[carried] - place[joint], axis=1)
        return step[carried[int(away.argmax())]]


# Trees over joints in an order with parents before children.


def sorted_tree(parents: Ints) -> tuple[Ints, Ints]:
    """The joints in an order with parents before children: the new parents, and the old index of each joint.

    Raises:
        ValueError: the parents form a ring.
    """
    depth = np.zeros(len(parents), dtype=int)
    above = np.array(parents)
    for _ in range(len(parents)):
        depth += above >= 0
        above = np.where(above >= 0, parents[np.maximum(above, 0)], -1)
    if (above >= 0).any():
        raise ValueError("the parents form a ring; expected a tree with −1 at its root")
    order = np.arange(len(parents)) if np.all(parents < np.arange(len(parents))) else np.argsort(depth, kind="stable")
    place = np.argsort(order)
    return np.where(parents[order] < 0, -1, place[np.maximum(parents[order], 0)]), order


# Forward kinematics of a human skeleton: poses of joints in their parents ↔ poses in the world.
#
# x_j = x_p + R_p t_j,  R_j = R_p Q_j,  with p the parent of j; over all frames at once, one joint after the other.


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
