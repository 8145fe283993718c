"""One pose of a performer, checked on arrival."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field

import numpy as np

from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.faults import Fault, RefusedError

FARTHEST = 1000.0
"""Largest distance of a joint from the origin [m]: a room is smaller."""
LENGTHS = (1e-3, 1e3)
"""A quaternion of another length is no rotation [-]."""


@dataclass(frozen=True, eq=False)
class Frame:
    """Joint positions and rotations of a skeleton at one time, z up.

    Raises:
        RefusedError: shapes do not fit the skeleton, or a number is not finite or no place or turn.
    """

    skeleton: Skeleton
    time: float
    """On this computer's monotonic clock [s]."""
    arrived: float
    """When the last of it was read, on the same clock [s]."""
    positions: Floats
    """(J, 3) [m]."""
    rotations: Floats | None = None
    """(J, 4) in the world frame, unit w x y z, or None."""
    poses: Mapping[str, Floats] = field(default_factory=dict)
    """(7,) of bodies around by name: x y z [m], quaternion w x y z; the stream checks them."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", self._checked(self.positions, 3))
        if np.abs(self.positions).max() > FARTHEST:
            raise RefusedError(Fault.MALFORMED, f"a joint is more than {FARTHEST:g} m away")
        if self.rotations is None:
            return
        turns = self._checked(self.rotations, 4)
        with np.errstate(over="ignore"):
            lengths = np.sqrt((turns**2).sum(axis=1))
        wrong = ~((lengths > LENGTHS[0]) & (lengths < LENGTHS[1]))
        if wrong.any():
            raise RefusedError(
                Fault.MALFORMED, f"the rotation of {self._named(wrong)} has the length {lengths[wrong][0]:g}"
            )
        object.__setattr__(self, "rotations", frozen(turns / lengths[:, None]))

    def at(self, time: float) -> "Frame":
        """Return the frame at another time [s], without a second check."""
        moved = copy(self)
        object.__setattr__(moved, "time", time)
        return moved

    def _checked(self, values: Floats, width: int) -> Floats:
        try:
            checked = frozen(values)
        except (TypeError, ValueError, OverflowError):
            raise RefusedError(Fault.MALFORMED, "numbers expected") from None
        if checked.shape != (len(self.skeleton), width):
            raise RefusedError(Fault.MALFORMED, f"expected ({len(self.skeleton)}, {width}), got {checked.shape}")
        if not np.isfinite(checked).all():
            raise RefusedError(Fault.NOT_FINITE, self._named(~np.isfinite(checked.sum(axis=1))))
        return checked

    def _named(self, which: np.ndarray) -> str:
        return self.skeleton.names[int(np.argmax(which))]
