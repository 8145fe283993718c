"""Close the loop in simulation: the plan's tilt as the feedback's reference, a virtual sensor, and the law between them.

A leg whose foot stands turns the trunk by −a Δq when a joint with axis a (in the root body's axes) turns by Δq. Against a tilt e
every joint therefore answers with gain · (a · e).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.actuators.balance_tables import Balance, Imu
from robot_retarget.actuators.feedback import Feedback, Law
from robot_retarget.actuators.goals import Goals
from robot_retarget.actuators.inertial import BodyMotion, VirtualImu, calibrated, tilt_of, vertical_in
from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Floats
from robot_retarget.contact.soles import contacts_of
from robot_retarget.judge.plant import Plant
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.robot.kinematics import carrying
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import feet_of
from robot_retarget.robot.timing import sample
from robot_retarget.trajectory import Trajectory


def has_feedback(plant: Plant) -> bool:
    """Whether the robot's servo map has a sensor and gains, and the robot a root that can tilt."""
    servo_map = plant.robot.servo_map
    return plant.robot.floating and servo_map is not None and servo_map.balance is not None


def with_feedback(plant: Plant, trajectory: Trajectory, goals: Goals) -> Goals:
    """The same goals with the feedback of the robot's servo map."""
    robot, servo_map = plant.robot, plant.robot.servo_map
    assert servo_map is not None and servo_map.balance is not None and servo_map.imu is not None
    balance, (low, high, top_speed) = servo_map.balance, _bounds(plant, goals)
    rate, tilt = gain_matrices(robot, balance)
    feedback = Feedback(
        rate=rate, tilt=tilt, lower=low, upper=high, reference=planned_tilt(robot, trajectory, goals),
        bound=balance.bound, speed=balance.speed, top_speed=top_speed, lag=round(servo_map.imu.delay * goals.rate),
        fusion=balance.fusion, fade=balance.fade, stop=np.array([balance.stop_roll, balance.stop_pitch]),
        crouch=_crouch(robot, servo_map, goals), lean=lean_over_feet(robot, trajectory.qpos[0]),
        legs=joints_of_legs(robot), air=planned_air(robot, trajectory, goals),
    )  # fmt: skip
    return replace(goals, feedback=feedback)


def _bounds(plant: Plant, goals: Goals) -> tuple[Floats, Floats, float]:
    """Return the range (n,) [rad] and the top speed [rad/s] of goals with feedback.

    They are those of the servo map. A model's own actuators have those of its joints, or of the goals where these exceed them.
    """
    robot, servo_map, angles = plant.robot, plant.servo_map, goals.angles
    if servo_map is not None:
        low, high = np.array([servo_map[joint].reach for joint in robot.joint_names]).T
        return low, high, servo_map.limits.speed
    fastest = np.abs(np.diff(angles, axis=0)).max(initial=robot.max_speed.max() / goals.rate) * goals.rate
    return np.minimum(robot.lower, angles.min(0)), np.maximum(robot.upper, angles.max(0)), float(fastest)


def gain_matrices(robot: Robot, balance: Balance) -> tuple[Floats, Floats]:
    """Gains (n, 2) for speed and for tilt in roll and pitch, with the signs of the joints' axes in the standing pose."""
    data = mujoco.MjData(robot.model)
    data.qpos[:] = robot.standing()
    mujoco.mj_kinematics(robot.model, data)
    axes = data.xaxis[robot.joint_ids] @ data.xmat[robot.root_body].reshape(3, 3)
    gains = [balance.joints.get(joint) for joint in robot.joint_names]
    rate, tilt = (np.array([getattr(gain, name, 0.0) for gain in gains]) for name in ("rate", "tilt"))
    return rate[:, None] * axes[:, :2], tilt[:, None] * axes[:, :2]


def joints_of_legs(robot: Robot) -> Floats:
    """(n, F) 1 for the joints that move one foot alone."""
    moves = carrying(robot.model)[:, robot.dof_index]
    carried = np.array([moves[min(bodies)] for bodies in feet_of(robot).bodies], dtype=float)
    return (carried * (carried.sum(axis=0) == 1)).reshape(-1, len(robot.joint_names)).T


def planned_air(robot: Robot, trajectory: Trajectory, goals: Goals) -> Floats:
    """(N, F) 1 where a foot is off the ground at a goal."""
    frames = np.round(goals.times * trajectory.fps).astype(int).clip(0, len(trajectory) - 1)
    return (~contacts_of(trajectory, robot).down[frames]).astype(np.float64)


def planned_tilt(robot: Robot, trajectory: Trajectory, goals: Goals) -> Floats:
    """(N, 4) roll and pitch of the root body [rad] and its angular velocity about its own x and y [rad/s] at the goals."""
    address = robot.root_address + 3
    turns = sample(trajectory, robot, goals.times)[:, address : address + 4]
    rotations = Rotation.from_quat(turns, scalar_first=True)
    spin = np.zeros((len(turns), 3))
    spin[:-1] = (rotations[:-1].inv() * rotations[1:]).as_rotvec() * goals.rate
    return np.concatenate([tilt_of(vertical_in(turns)), spin[:, :2]], axis=1)


def lean_over_feet(robot: Robot, qpos: Floats) -> Floats:
    """Change of the hinges (n, 2) per roll and pitch of the root body while the feet stay: −J_hinges⁺ J_root.

    The root body turns about its origin. Zeros for a robot without recognised feet.
    """
    model, data, root = robot.model, mujoco.MjData(robot.model), root_dofs(robot)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    feet = sorted(set(feet_of(robot).soles.bodies.tolist()))
    if not feet:
        return np.zeros((len(robot.joint_names), 2))
    rows = np.zeros((len(feet), 2, 3, model.nv))
    for (place, turn), foot in zip(rows, feet, strict=True):
        mujoco.mj_jacBody(model, data, place, turn, foot)
    feet_move = rows.reshape(-1, model.nv)
    return -np.linalg.pinv(feet_move[:, robot.dof_index]) @ feet_move[:, root[3:5]]


def _crouch(robot: Robot, servo_map: ServoMap, goals: Goals) -> Floats:
    """The map's stop pose; joints that it does not name keep their first goal."""
    pose = servo_map.stop.pose
    first = zip(robot.joint_names, goals.angles[0], strict=True)
    return np.array([pose.get(joint, float(angle)) for joint, angle in first])


def closed_loop(plant: Plant, goals: Goals, seed: int) -> "ClosedLoop | None":
    """Return the loop of goals with feedback; None without a sensor in the robot's servo map."""
    servo_map = plant.robot.servo_map
    if goals.feedback is None or servo_map is None or servo_map.imu is None:
        return None
    return ClosedLoop(plant, goals, servo_map.imu, seed)


class ClosedLoop:
    """The law in the simulation: reads the state, gives the goals of each row.

    Args:
        imu: the sensor; the bias of its gyroscope is subtracted before the motion.
        seed: of the sensor's noise and bias.
    """

    def __init__(self, plant: Plant, goals: Goals, imu: Imu, seed: int = 0) -> None:
        assert goals.feedback is not None
        self._angles, self._dt = goals.angles, 1 / goals.rate
        self._law = Law(goals.feedback, self._dt)
        self._motion, self._imu = BodyMotion(plant.model.opt.gravity), VirtualImu(calibrated(imu), self._dt, seed)
        self._turn, self._root = plant.places.qpos[plant.robot.root_address + 3 :][:4], plant.root_dofs
        self.added: Floats = np.zeros_like(goals.angles)
        """(N, n) [rad]."""
        self.stopped: int | None = None
        """The row at which the robot leaned too far and began to crouch."""

    def goal(self, row: int, data: mujoco.MjData) -> Floats:
        """(n,) [rad] for a row, after the state has been read."""
        velocity, spin = data.qvel[self._root[:3]], data.qvel[self._root[3:]]
        turn = data.qpos[self._turn]
        reading = self._imu.read(self._motion.reading(turn, velocity, spin, self._dt))
        goal = self._law.step(row, self._angles[row], reading)
        self.added[row] = goal - self._angles[row]
        if self._law.stopped and self.stopped is None:
            self.stopped = row
        return goal


# Figures of the balance feedback in a rollout, and a test for oscillating gains.

ACTIVE = 0.01
"""Feedback is active where it adds more than this to a joint [rad]: half a degree."""
WINDOW = 1.0
"""Oscillations are looked for in windows of this length [s] ..."""
SLOWEST = 2.0
"""... at this frequency and above [Hz]: twice the 1 Hz of a pendulum as high as the OP3's centre of mass, at which a lean comes and goes."""
SUSTAINED = 0.03
"""Amplitude of an oscillation that is refused [rad]: backlash and rounding of an XM430 excite less than a third of it."""
PURE = 0.5
"""An oscillation has at least this part of the power of its window in one frequency and its neighbours."""


class Oscillation(NamedTuple):
    """A joint whose additions swing by themselves."""

    joint: str
    frequency: float
    """[Hz]."""
    amplitude: float
    """[rad]."""


def feedback_figures(
    added: Floats | None, stopped: float | None, times: Floats, joints: Sequence[str], until: float | None
) -> dict[str, Any]:
    """How much was added and how often, up to a fall at `until` [s]; empty for open-loop playback.

    Args:
        added: (N, n) correction of the goals [rad].
        stopped: when the feedback gave up on a lean [s].
        times: (N,) of the goals [s].
        joints: n names.
        until: time of a fall [s].
    """
    if added is None or not len(times):
        return {}
    added = added[: len(times)]
    if until is not None:
        added = added[: max(1, int(np.searchsorted(times, until)))]
    size = np.abs(added)
    worst = int(size.max(axis=0).argmax())
    swing = oscillation(added, joints, 1 / float(np.diff(times[:2])[0])) if len(times) > 1 else None
    figures: dict[str, Any] = {
        "feedback": True,
        "feedback_max_rad": round(float(size.max()), 4),
        "feedback_max_joint": joints[worst],
        "feedback_rms_rad": round(float(np.sqrt((added**2).mean(axis=0)).max()), 4),
        "feedback_active_share": round(float((size.max(axis=1) > ACTIVE).mean()), 4),
        "feedback_stopped_s": None if stopped is None else round(stopped, 3),
    }
    if swing is not None:
        figures |= {
            "feedback_oscillation_joint": swing.joint,
            "feedback_oscillation_Hz": round(swing.frequency, 2),
            "feedback_oscillation_rad": round(swing.amplitude, 4),
        }
    return figures


def oscillation(added: Floats, joints: Sequence[str], rate: float) -> Oscillation | None:
    """The strongest sustained swing of additions (N, n) at `rate` [1/s]: in two windows in a row, at one frequency."""
    window = round(WINDOW * rate)
    found = [_swings(added[k : k + window], rate) for k in range(0, len(added) - window + 1, window)]
    strongest = None
    for (before, first), (after, second) in pairwise(found):
        lasting = np.where(np.abs(before - after) <= 1.0 / WINDOW, np.minimum(first, second), 0.0)
        joint = int(lasting.argmax())
        if lasting[joint] > (SUSTAINED if strongest is None else strongest.amplitude):
            strongest = Oscillation(joints[joint], float(after[joint]), float(lasting[joint]))
    return strongest


def _swings(added: Floats, rate: float) -> tuple[Floats, Floats]:
    """Return the frequency (n,) [Hz] at which each joint swings most in a window, and the amplitude (n,) [rad] of that."""
    centred = (added - added.mean(axis=0)) * np.hanning(len(added))[:, None]
    spectrum = np.abs(np.fft.rfft(centred, axis=0)) * 4 / len(added)
    frequency = np.arange(len(spectrum)) * rate / len(added)
    power = (spectrum**2).sum(axis=0) + 1e-12
    spectrum[frequency < SLOWEST] = 0.0
    row, columns = spectrum.argmax(axis=0), np.arange(spectrum.shape[1])
    near = np.abs(np.arange(len(spectrum))[:, None] - row) <= 1
    share = np.where(near, spectrum**2, 0.0).sum(axis=0) / power
    return frequency[row], np.where(share > PURE, spectrum[row, columns], 0.0)
