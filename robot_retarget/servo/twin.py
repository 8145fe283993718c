"""The digital twin: MuJoCo's model of the robot behind the emulated servos, standing on its floor."""

import sys
import threading
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from robot_retarget.actuators.balance_tables import Imu
from robot_retarget.actuators.goals import RATE
from robot_retarget.actuators.inertial import LEVEL, BodyMotion, Reading, VirtualImu
from robot_retarget.actuators.map import ServoMap
from robot_retarget.actuators.motors import MOTORS, mechanics_of
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError, known
from robot_retarget.scene.geoms import add_floor
from robot_retarget.servo.played import ServoLog
from robot_retarget.servo.recording import HandTake

# MuJoCo's viewer of the digital twin, on a display.

PERIOD = 1 / 60
"""Of the twin's time between two pictures [s]: 1/60, that of a screen."""
CLOSING = 2.0
"""Timeout for closing a window [s]."""


class ViewerWindow:
    """An open viewer; closing it by hand leaves the twin running.

    Args:
        model: what to show.
        data: its state, read at each `show`.

    Raises:
        ServoError: there is no display to open a window on.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        _require_display()
        import mujoco.viewer

        others = set(threading.enumerate())
        try:
            self._handle = mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
        except RuntimeError as error:
            raise ServoError(f"--view: {error}") from error
        self._threads = set(threading.enumerate()) - others
        self._data, self._shown = data, data.time

    def show(self) -> None:
        """Bring the window up to date, if it is time and it is still open."""
        if self._data.time - self._shown >= PERIOD and self._handle.is_running():
            self._shown = self._data.time
            self._handle.sync()

    def close(self) -> None:
        """Shut the window. Its thread must be over before the process ends: it draws until then."""
        self._handle.close()
        for thread in self._threads:
            thread.join(CLOSING)


def _require_display() -> None:
    """Check for a display first: without one the viewer ends the process."""
    if sys.platform == "darwin":
        return
    import glfw

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if glfw.init():
            return
    reason = "; ".join(str(w.message) for w in caught) or "GLFW does not start"
    raise ServoError(f"--view needs a display: {reason}; leave it out, or set DISPLAY")


SUPPORT = 0.3
"""Time with torque on and joints still after which the trunk is released [s]."""
STILL_JOINT = 0.01
"""Largest movement of a joint that counts as still [rad]."""
JAM = 100 * max(motor.stall_torque for motor in MOTORS.values())
"""Friction of a jammed joint [N m]."""
LOWERING = 0.2
"""A held robot whose feet are off the floor is lowered at this speed [m/s]: that after a fall of 2 mm."""


class Twin:
    """A body of hinges moved by torques; free to fall once its servos hold it.

    Args:
        source: MJCF of the robot, or its specification (`Robot.spec`); a model with a free root and without a floor gets one, as in `simulate`.
        servo_map: names the hinge of every servo and its direction, zero and gear.
        support: how long the trunk stays held after torque is on everywhere and the joints are still [s].

    Raises:
        ServoError: the model cannot be read, or has not the joints of the map.
    """

    def __init__(self, source: str | Path | mujoco.MjSpec, servo_map: ServoMap, support: float = SUPPORT) -> None:
        self.model: Any = _compiled(source)
        self.data: Any = mujoco.MjData(self.model)
        self.support = support
        self.step: Any = self.model.opt.timestep
        joints = [_hinge(self.model, joint, source) for joint in servo_map.joints]
        self._qpos = np.array([self.model.jnt_qposadr[j] for j in joints])
        self._dof = np.array([self.model.jnt_dofadr[j] for j in joints])
        gear = np.array([servo.sign * servo.gear for servo in servo_map.servos])
        self._gear, self._scale = gear, np.array([servo.scale for servo in servo_map.servos])
        self._zero = np.array([float(servo.zero) for servo in servo_map.servos])
        found = [servo_map.identified.get(s.type.name) or mechanics_of(s.motor) for s in servo_map.servos]
        ratio, back_emf = np.abs(gear), np.array([servo.motor.back_emf for servo in servo_map.servos])
        self.model.dof_damping[self._dof] = ratio**2 * (back_emf + [m.damping for m in found])
        self.model.dof_armature[self._dof] = ratio**2 * [m.armature for m in found]
        self._friction = ratio * [m.friction for m in found]
        free = np.flatnonzero(self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self._root = int(self.model.jnt_qposadr[free[0]]) if free.size else None
        self._held_for, self._landed = 0.0, False
        mujoco.mj_forward(self.model, self.data)
        self._rest = self.data.qpos.copy()
        self._place = self.data.qpos[self._qpos].copy()
        self._window: ViewerWindow | None = None
        self._imu: VirtualImu | None = None
        self._motion = BodyMotion(self.model.opt.gravity)
        self._until_sensed = 0
        self.reading: Reading = LEVEL
        """Of the inertial sensor that it carries."""

    def carry(self, imu: Imu) -> None:
        """Fix an inertial sensor to the trunk."""
        self._imu = VirtualImu(imu, self._sensing * self.step)

    def watch(self) -> None:
        """Show it in a window from now on.

        Raises:
            ServoError: there is no display.
        """
        self._window = ViewerWindow(self.model, self.data)

    def close(self) -> None:
        """Shut the window, if there is one."""
        if self._window is not None:
            self._window.close()

    @property
    def held(self) -> bool:
        """Whether the trunk is held: until it has been set down, and its servos have held it for a while."""
        return self._root is not None and not (self._landed and self._held_for > self.support)

    def advance(self, torques: Sequence[float], holding: Sequence[bool], jammed: Sequence[bool] = ()) -> None:
        """One step under the servos' torques [N m]; something holds the joints that are `jammed`."""
        self.data.qfrc_applied[self._dof] = self._gear * np.asarray(torques)
        self.model.dof_frictionloss[self._dof] = np.where(jammed, JAM, self._friction) if jammed else self._friction
        if self.held:
            self._wait(all(holding))
            self._set_down()
        stuck = np.flatnonzero(jammed)
        places = self.data.qpos[self._qpos[stuck]].copy()
        mujoco.mj_step(self.model, self.data)
        self.data.qpos[self._qpos[stuck]], self.data.qvel[self._dof[stuck]] = places, 0.0
        if self._imu is not None and self._root is not None:
            self._sense(self._imu, self._root)
        if self._window is not None:
            self._window.show()

    @property
    def _sensing(self) -> int:
        """Steps between two readings: a sensor's own filter averages over about a tick."""
        return max(1, round(1 / (RATE * self.step)))

    def _sense(self, imu: VirtualImu, root: int) -> None:
        self._until_sensed -= 1
        if self._until_sensed > 0:
            return
        self._until_sensed = self._sensing
        turn, (velocity, spin) = self.data.qpos[root + 3 : root + 7], self.data.qvel[:6].reshape(2, 3)
        if self.held:
            velocity, spin = np.zeros((2, 3))
        self.reading = imu.read(self._motion.reading(turn, velocity, spin, self._sensing * self.step))

    def _wait(self, holding: bool) -> None:
        """Count for how long the joints have been still under torque."""
        here = self.data.qpos[self._qpos]
        if holding and np.abs(here - self._place).max() < STILL_JOINT:
            self._held_for += self.step
        else:
            self._held_for, self._place = 0.0, here.copy()

    def _set_down(self) -> None:
        """Keep the trunk upright in its place, with the feet just on the floor."""
        assert self._root is not None
        contact, scene = self.data.contact, self.model.geom_bodyid == 0
        depths = -contact.dist[scene[contact.geom].any(axis=1)] if self.data.ncon else np.zeros(0)
        self._landed |= bool(depths.size)
        self._rest[self._root + 2] += depths.max() / 2 if depths.size else -LOWERING * self.step
        self.data.qpos[self._root : self._root + 7] = self._rest[self._root : self._root + 7]
        self.data.qvel[:6] = 0.0

    def shafts(self) -> tuple[list[float], list[float]]:
        """Encoder positions [ticks] and velocities [ticks/s]."""
        ticks = self._zero + self._scale * self.data.qpos[self._qpos]
        return ticks.tolist(), (self._scale * self.data.qvel[self._dof]).tolist()

    def state(self) -> dict[str, Any]:
        """Where the trunk is: place and height [m], and how upright, 1 to −1."""
        if self._root is None:
            return {}
        w, x, y, z = self.data.qpos[self._root + 3 : self._root + 7]
        del w, z
        return {
            "place": self.data.qpos[self._root : self._root + 2].tolist(),
            "height": float(self.data.qpos[self._root + 2]),
            "upright": float(1 - 2 * (x * x + y * y)),
            "held": self.held,
        }


def limb_torques(source: str | Path | mujoco.MjSpec, log: ServoLog) -> Floats:
    """Return the torques (N, n) that the limbs of a log need at their recorded angles, gears and rotors left out [N m].

    The trunk is still; contacts are left out. Angles are smoothed as takes are (`HandTake.smoothed`).

    Raises:
        ServoError: the model cannot be read, or has not the joints of the log.
    """
    model = _compiled(source)
    data = mujoco.MjData(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for passive in (model.dof_damping, model.dof_frictionloss, model.dof_armature):
        passive[:] = 0.0
    joints = [_hinge(model, joint, source) for joint in log.joints]
    place, dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    angles = HandTake(log.angles, log.rate).smoothed().angles
    speeds = np.gradient(angles, 1 / log.rate, axis=0)
    pulls = np.gradient(speeds, 1 / log.rate, axis=0)
    torques = np.zeros_like(angles)
    for k in range(len(angles)):
        data.qpos[place], data.qvel[dof], data.qacc[dof] = angles[k], speeds[k], pulls[k]
        mujoco.mj_inverse(model, data)
        torques[k] = data.qfrc_inverse[dof]
    return torques


def _compiled(source: str | Path | mujoco.MjSpec) -> mujoco.MjModel:
    """The model on a floor, without its own actuators: the emulated servos take their place."""
    try:
        spec = source if isinstance(source, mujoco.MjSpec) else mujoco.MjSpec.from_file(str(source))
        model = spec.compile()
        if (model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any():
            add_floor(spec, model)
        for element in [*spec.actuators, *spec.sensors, *spec.keys]:
            spec.delete(element)
        return spec.compile()
    except (ValueError, OSError) as error:
        raise ServoError(f"{_named(source)}: no model for physics: {' '.join(str(error).split())}") from error


def _named(source: str | Path | mujoco.MjSpec) -> str:
    return source.modelname if isinstance(source, mujoco.MjSpec) else str(source)


def _hinge(model: mujoco.MjModel, joint: str, source: str | Path | mujoco.MjSpec) -> int:
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    if found < 0:
        names = [model.joint(j).name for j in range(model.njnt)]
        raise ServoError(f"{_named(source)}: no joint {joint!r} as the servo map has; {known(names, typed=joint)}")
    return int(found)
