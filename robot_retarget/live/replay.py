"""A motion file as a real-time source; bodies around the human move as they did."""

import time
from math import floor

from robot_retarget.base.errors import UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.faults import FaultCounter
from robot_retarget.live.frame import Frame


class Replay:
    """Return the frames of a motion when they are due, starting with the first call; drop overdue ones.

    Raises:
        UsageError: the speed is not positive.
    """

    motion: Motion
    faults: FaultCounter
    dropped: int

    def __init__(self, motion: Motion, faults: FaultCounter, speed: float = 1.0) -> None:
        if not 0 < speed < float("inf"):
            raise UsageError(f"--speed must be positive, got {speed:g}")
        self.motion, self.faults, self.dropped = motion, faults, 0
        self._rate, self._next = motion.fps * speed, 0
        self.began: float | None = None
        """Due time of the first frame [s]."""

    @property
    def skeleton(self) -> Skeleton:
        return self.motion.skeleton

    @property
    def ended(self) -> bool:
        return self._next >= len(self.motion)

    def newest(self, timeout: float) -> Frame | None:
        if self.ended:
            return None
        if self.began is None:
            self.began = time.monotonic()
        ahead = self.began + self._next / self._rate - time.monotonic()
        if ahead > timeout:
            time.sleep(max(timeout, 0.0))
            return None
        time.sleep(max(ahead, 0.0))
        due = min(floor((time.monotonic() - self.began) * self._rate + 1e-6), len(self.motion) - 1)
        t = max(due, self._next)
        self.dropped += t - self._next
        self._next = t + 1
        made, motion = self.began + t / self._rate, self.motion
        turns = None if motion.rotations is None else motion.rotations[t]
        arrived = max(time.monotonic(), made)
        return Frame(motion.skeleton, made, arrived, motion.positions[t], turns, motion.poses_at(t))

    def close(self) -> None:
        """Do nothing: no port is held."""
