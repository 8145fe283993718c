"""Simulate poses in real time, as goals of servos under gravity and on a floor."""

import time
from typing import Any

import mujoco
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.goals import RATE
from robot_retarget.live.loop import LivePose
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.servo.live import TargetStream
from robot_retarget.servo.window import ViewerWindow
from robot_retarget.simulate.plant import root_coordinates
from robot_retarget.simulate.rollout import plant_of
from robot_retarget.simulate.stepping import set_on_floor

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

    data: Any

    def __init__(self, robot: Robot, mode: str = "pinned", window: bool = False) -> None:
        self._robot, self._pinned, self._plant = robot, mode == "pinned", plant_of(robot, mode)
        self.data = mujoco.MjData(self._plant.model)
        self._window = ViewerWindow(self._plant.model, self.data) if window else None
        self._targets, self._roots, self._held = TargetStream(), root_coordinates(robot), root_dofs(robot)
        self._began: float | None = None
        self._skipped = 0.0
        self._error, self._ticks = 0.0, 0
        self._fell: float | None = None

    def show(self, pose: LivePose) -> None:
        now = time.monotonic()
        self._targets.set_target(pose.qpos[self._robot.qpos_index], now)
        if self._began is None:
            self._stand(pose.qpos, now)
        if self._pinned:
            self.data.qpos[self._roots], self.data.qvel[self._held] = pose.qpos[self._roots], 0.0
        self._go_on(now)
        if self._window is not None:
            self._window.show()

    def _stand(self, qpos: Floats, now: float) -> None:
        self._began = now
        self.data.qpos[:] = qpos
        if not self._pinned:
            set_on_floor(self._plant.model, self.data)

    def _go_on(self, now: float) -> None:
        """Step the physics to a time of the clock."""
        assert self._began is not None
        model, data = self._plant.model, self.data
        steps = max(1, round(1 / (RATE * model.opt.timestep)))
        lag = now - self._began - self._skipped - data.time
        self._skipped += max(lag - BEHIND, 0.0)
        while (at := self._began + self._skipped + data.time) + steps * model.opt.timestep <= now:
            target = self._targets.at(at)
            assert target is not None
            data.ctrl[:] = self._plant.controls(target[None])[0]
            mujoco.mj_step(model, data, steps)
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
