"""Simulate poses in real time, as goals of servos under gravity and on a floor."""

import time
from typing import Any

import numpy as np

from robot_retarget.actuators.goals import RATE
from robot_retarget.base.arrays import Floats
from robot_retarget.judge.playback import PlayedPlant
from robot_retarget.judge.rollout import plant_of
from robot_retarget.live.loop import LivePose
from robot_retarget.robot import Robot
from robot_retarget.servo.live import TargetStream
from robot_retarget.servo.twin import ViewerWindow

BEHIND = 0.1
"""Largest lag that the physics makes up for at once [s]; longer lags are dropped."""
FALLEN = 0.5
"""Cosine of the lean of the trunk below which the robot counts as fallen [-]."""


class PhysicsSink:
    """The robot on servos: `pinned` by its root, which goes where the poses have it, or `free` on a floor.

    Raises:
        UsageError: an unknown mode, or `free` for a robot without a free root.
        RobotError: its MJCF cannot be prepared.
        ServoError: a window is requested without a display.
    """

    def __init__(self, robot: Robot, mode: str = "pinned", window: bool = False) -> None:
        self._robot, self._pinned, self._played = robot, mode == "pinned", PlayedPlant(plant_of(robot, mode), RATE)
        self.data: Any = self._played.data
        self._window = ViewerWindow(self._played.plant.model, self.data) if window else None
        self._targets = TargetStream()
        self._began: float | None = None
        self._skipped = 0.0
        self._error, self._ticks = 0.0, 0
        self._fell: float | None = None

    def show(self, pose: LivePose) -> None:
        now = time.monotonic()
        self._targets.set_target(pose.qpos[self._robot.qpos_index], now)
        if self._began is None:
            self._began = now
            self._played.place(pose.qpos, on_floor=not self._pinned)
        if self._pinned:
            self._played.carry(pose.qpos)
        self._go_on(now, self._began)
        if self._window is not None:
            self._window.show()

    def _go_on(self, now: float, began: float) -> None:
        """Step the physics to a time of the clock."""
        self._skipped += max(now - began - self._skipped - self.data.time - BEHIND, 0.0)
        while (at := began + self._skipped + self.data.time) + self._played.seconds <= now:
            target = self._targets.at(at)
            assert target is not None
            self._played.tick(target)
            self._note(target)

    def _note(self, target: Floats) -> None:
        self._error += float(((self.data.qpos[self._robot.qpos_index] - target) ** 2).mean())
        self._ticks += 1
        upright = self.data.xmat[self._robot.root_body][8]
        if self._fell is None and not upright > FALLEN:
            self._fell = self.data.time

    def figures(self) -> dict[str, Any]:
        """What came of it."""
        rms = float(np.sqrt(self._error / max(self._ticks, 1)))
        return {
            "simulated_s": round(self.data.time, 2), "left_out_s": round(self._skipped, 2),
            "tracking_rms_rad": round(rms, 4), "fell_s": None if self._fell is None else round(self._fell, 2),
        }  # fmt: skip

    def close(self) -> None:
        """Shut the window."""
        if self._window is not None:
            self._window.close()
