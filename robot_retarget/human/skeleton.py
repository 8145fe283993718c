"""The skeleton of a human: a tree of joints."""

from dataclasses import dataclass

import numpy as np

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

    def above(self, joint: int) -> tuple[int, ...]:
        """A joint and all that carry it, up to the root."""
        return tuple(path_to_root(self.parents, joint))

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
