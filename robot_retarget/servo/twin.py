"""The digital twin: MuJoCo's model of the robot behind the emulated servos, standing on its floor."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from robot_retarget.errors import ServoError, known
from robot_retarget.servo.map import TICKS_PER_RADIAN, ServoMap
from robot_retarget.servo.window import Window

SUPPORT = 2.0
"""The trunk is held for so long after the last servo has got torque, as by a hand [s]."""


class Twin:
    """A body of hinges moved by torques; free to fall once its servos hold it.

    Args:
        path: MJCF of the robot, with a floor if it is to stand on one.
        servo_map: names the hinge of every servo and its direction, zero and gear.
        support: how long the trunk stays held after torque is on everywhere [s].

    Raises:
        ServoError: the model cannot be read, or has not the joints of the map.
    """

    def __init__(self, path: str | Path, servo_map: ServoMap, support: float = SUPPORT) -> None:
        self.model = _without_actuators(path)
        self.data = mujoco.MjData(self.model)
        self.support = support
        self.step = self.model.opt.timestep
        joints = [_hinge(self.model, joint, path) for joint in servo_map.joints]
        self._qpos = np.array([self.model.jnt_qposadr[j] for j in joints])
        self._dof = np.array([self.model.jnt_dofadr[j] for j in joints])
        gear = np.array([servo.sign * servo.gear for servo in servo_map.servos])
        self._gear, self._scale = gear, gear * TICKS_PER_RADIAN
        self._zero = np.array([float(servo.zero) for servo in servo_map.servos])
        free = np.flatnonzero(self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self._root = int(self.model.jnt_qposadr[free[0]]) if free.size else None
        self._held_for = 0.0
        mujoco.mj_forward(self.model, self.data)
        self._rest = self.data.qpos.copy()
        self._window: Window | None = None

    def watch(self) -> None:
        """Show it in a window from now on.

        Raises:
            ServoError: there is no display.
        """
        self._window = Window(self.model, self.data)

    def close(self) -> None:
        """Shut the window, if there is one."""
        if self._window is not None:
            self._window.close()

    @property
    def held(self) -> bool:
        """Whether the trunk is still held by hand."""
        return self._root is not None and self._held_for <= self.support

    def advance(self, torques: Sequence[float], holding: Sequence[bool]) -> None:
        """One step under the servos' torques [N m]."""
        self.data.qfrc_applied[self._dof] = self._gear * np.asarray(torques)
        if self.held:
            self._held_for = self._held_for + self.step if all(holding) else 0.0
            self.data.qpos[self._root : self._root + 7] = self._rest[self._root : self._root + 7]  # type: ignore[operator]
            self.data.qvel[:6] = 0.0
        mujoco.mj_step(self.model, self.data)
        if self._window is not None:
            self._window.show()

    def shafts(self) -> tuple[list[float], list[float]]:
        """Encoder positions [ticks] and velocities [ticks/s]."""
        ticks = self._zero + self._scale * self.data.qpos[self._qpos]
        return ticks.tolist(), (self._scale * self.data.qvel[self._dof]).tolist()

    def state(self) -> dict[str, Any]:
        """Where the trunk is: height [m], and how upright, 1 to −1."""
        if self._root is None:
            return {}
        w, x, y, z = self.data.qpos[self._root + 3 : self._root + 7]
        del w, z
        return {
            "height": float(self.data.qpos[self._root + 2]),
            "upright": float(1 - 2 * (x * x + y * y)),
            "held": self.held,
        }


def _without_actuators(path: str | Path) -> mujoco.MjModel:
    """The model with its own actuators taken out: the emulated servos take their place, damping and armature stay."""
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        for element in [*spec.actuators, *spec.sensors, *spec.keys]:
            spec.delete(element)
        return spec.compile()
    except (ValueError, OSError) as error:
        raise ServoError(f"{path}: no model for physics: {' '.join(str(error).split())}") from error


def _hinge(model: mujoco.MjModel, joint: str, path: str | Path) -> int:
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    if found < 0:
        names = [model.joint(j).name for j in range(model.njnt)]
        raise ServoError(f"{path}: no joint {joint!r} as the servo map has; {known(names)}")
    return int(found)
