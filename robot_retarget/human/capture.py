"""The content of a motion file, before units and axes are converted."""

from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.human.skeleton import Skeleton

FARTHEST = 1e7
"""A joint farther from the origin is a mistake [file units]: 10 km in millimetres."""


@dataclass(frozen=True)
class Capture:
    """A skeleton over time in the unit and the axes of its file. `upright.upright` makes a `Motion` of it."""

    skeleton: Skeleton
    positions: Floats
    """(T, J, 3) of every joint [file units]."""
    rotations: Floats | None
    """(T, J, 4) of every joint in the file's world frame, unit w x y z, or None."""
    fps: float
    """Frames per second [1/s]."""
    source: str
    notes: tuple[str, ...] = ()
    contacts: Bools | None = None
    """(T, 4) as `Motion.contacts`, where the file says them."""
    up: str | None = None
    """The signed axis that points up, such as `+y`, where the format fixes it; else it is inferred from the poses."""
    camera: bool = False
    """Whether positions are in the frame of a camera, whose up axis may be tilted."""

    def __post_init__(self) -> None:
        for values in (self.positions, self.rotations):
            if values is not None and not np.isfinite(values).all():
                frame, joint = np.argwhere(~np.isfinite(values))[0, :2]
                raise MotionError(f"frame {frame}, joint {self.skeleton.names[joint]!r} is not finite", self.source)
        if not np.ptp(self.positions, axis=1).any() and len(self.skeleton) > 1:
            raise MotionError("all joints are at one place in every frame", self.source)
        far = np.abs(self.positions) > FARTHEST
        if far.any():
            frame, joint, axis = np.argwhere(far)[0]
            raise MotionError(
                f"frame {frame}, joint {self.skeleton.names[joint]!r} is at {self.positions[frame, joint, axis]:.3g}, "
                f"farther than {FARTHEST:g} from the origin",
                self.source,
            )

    def part(self, frames: slice) -> "Capture":
        """Some of the frames."""
        rotations, contacts = (None if v is None else v[frames] for v in (self.rotations, self.contacts))
        return replace(self, positions=self.positions[frames], rotations=rotations, contacts=contacts)
