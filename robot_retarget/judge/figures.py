"""Figures of a replay and a rollout. Keys end in their unit: `_rad`, `_m`, `_s`; shares are 0 … 1."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_retarget.actuators.goals import RATE
from robot_retarget.base.arrays import Floats
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.playback import Rollout
from robot_retarget.judge.servo_model import Drives
from robot_retarget.robot.contacts import Contacts, reference_overlaps, replay_contacts, summary
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import feet_of, with_toes
from robot_retarget.robot.timing import joint_velocities, range_excess, resample
from robot_retarget.scores.likeness import AT_LIMIT
from robot_retarget.trajectory import Trajectory

# Load of the servos: torque, speed, current, heat, energy.

Columns = dict[str, tuple[Floats, int]]
"""By figure: a value for each driven joint, and the digits it is worth."""


def load_figures(plant: Plant, rollout: Rollout) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The robot's figures, and those of each driven joint, from the beginning of the trajectory on."""
    playing, driven = rollout.times >= 0, plant.driven
    if playing.sum() < 2 or not driven.size:
        return {}, {}
    names = [plant.robot.joint_names[k] for k in driven]
    force, speed = rollout.torque[playing][:, driven], rollout.speeds[playing][:, driven]
    dt = float(np.diff(rollout.times[playing]).mean())
    if plant.drives is None:
        figures, columns = _mechanical(
            force, force, speed, plant.bounds[driven], plant.robot.max_speed[driven], names, dt
        )
    else:
        drives = plant.drives.of(driven)
        torque, top = drives.shaft_torque(force, speed), drives.no_load_speed
        figures, columns = _mechanical(force, torque, speed, plant.bounds[driven], top, names, dt)
        more, further = _electrical(drives, force, speed, names, dt)
        figures, columns = figures | more, columns | further
    joints = {
        name: {key: round(float(values[k]), digits) for key, (values, digits) in columns.items()}
        for k, name in enumerate(names)
    }
    return figures, joints


def _mechanical(
    force: Floats, torque: Floats, speed: Floats, bound: Floats, top: Floats, names: list[str], dt: float
) -> tuple[dict[str, Any], Columns]:
    """Of actuator forces and shaft torques (N, m) [N m] at speeds (N, m) [rad/s], dt [s] apart."""
    full = (np.abs(force) >= AT_LIMIT * bound).mean(0)
    figures = {
        "saturated_share": round(float(full.max()), 4),
        "saturated_joint": names[full.argmax()] if full.any() else None,
        "work_J": round(float(np.maximum(torque * speed, 0).sum() * dt), 3),
    }
    return figures, {
        "saturated_share": (full, 4),
        "peak_torque_Nm": (np.abs(torque).max(0), 4),
        "rms_torque_Nm": (np.sqrt((torque**2).mean(0)), 4),
        "speed_share": (np.abs(speed).max(0) / top, 4),
    }


def _electrical(
    drives: Drives, force: Floats, speed: Floats, names: list[str], dt: float
) -> tuple[dict[str, Any], Columns]:
    """Current, heat and energy of servos with a datasheet."""
    current, power = drives.current(force, speed), drives.power(force, speed)
    effective, rise = np.sqrt((current**2).mean(0)), drives.temperature_rise(force, speed, dt)
    heat = (effective / drives.continuous_current) ** 2
    figures = {
        "supply_V": drives.voltage,
        "peak_supply_current_A": round(float((power.sum(1) / drives.voltage).max()), 3),
        "energy_J": round(float(power.sum() * dt), 3),
        "hottest_joint": names[rise.argmax()],
        "heat_ratio": round(float(heat.max()), 3),
        "temperature_rise_K": round(float(rise.max()), 3),
    }
    return figures, {
        "rms_current_A": (effective, 4),
        "peak_current_A": (np.abs(current).max(0), 4),
        "heat_ratio": (heat, 3),
        "temperature_rise_K": (rise, 3),
    }


ROOT_DOWN = 0.5
"""A root at less than this share of its planned height is down: lying on back or face it is at 0.21 to 0.27 on the OP3, measured, and at 0.08 to 0.26 on
the G1."""
MOVING = 0.05
"""Lag is not estimated below this mean speed [rad/s]: two units of 0.024 rad/s, in which an XM430 states its speed (data sheet)."""


def replay_figures(trajectory: Trajectory, robot: Robot, contacts: Contacts, penetration: float) -> dict[str, Any]:
    """Self-contacts deeper than `penetration` [m] and all others, joint ranges, joint speeds."""
    excess = np.round(range_excess(trajectory, robot).max(0), 5)
    ratio = (np.abs(joint_velocities(trajectory, robot)) / robot.max_speed).max(0, initial=0)
    deep = contacts.of(contacts.depth > penetration)
    return {
        "self_contact_share": round(len(np.unique(deep.frame)) / len(trajectory), 4),
        "self_contact_depth_m": round(float(contacts.depth.max(initial=0)), 5),
        "range_excess_rad": float(excess.max()),
        "range_excess_joint": robot.joint_names[int(excess.argmax())] if excess.any() else None,
        "speed_ratio": round(float(ratio.max()), 3),
        "speed_ratio_joint": robot.joint_names[int(ratio.argmax())] if ratio.any() else None,
        "self_contacts": summary(contacts, robot, len(trajectory)),
    }


def between_figures(trajectory: Trajectory, robot: Robot) -> dict[str, Any]:
    """The deepest self-contact on the straight way from frame to frame, which servos take and frames do not show."""
    finer = resample(trajectory, robot, max(RATE, trajectory.fps))
    contacts = replay_contacts(robot, finer.qpos)
    if not len(contacts):
        return {"between_frames_depth_m": 0.0, "between_frames_bodies": None, "between_frames_s": None}
    deepest = int(contacts.depth.argmax())
    return {
        "between_frames_depth_m": round(float(contacts.depth[deepest]), 5),
        "between_frames_bodies": [robot.model.body(int(body)).name for body in contacts.bodies[deepest]],
        "between_frames_s": round(float(contacts.frame[deepest] / finer.fps), 3),
    }


@dataclass(frozen=True, eq=False)
class Tracking:
    """The servos' work, frame by frame as far as the simulation came: F frames, n hinges."""

    times: Floats
    """(F,) [s]."""
    wanted: Floats
    measured: Floats
    """(F, n) [rad]."""
    torque: Floats
    """(F, n) [N m]."""

    @property
    def error(self) -> Floats:
        """(F, n) measured less wanted [rad]."""
        return self.measured - self.wanted


def at_frames(trajectory: Trajectory, robot: Robot, rollout: Rollout) -> Tracking:
    """The rollout at the times of the trajectory's frames."""
    times = np.arange(len(trajectory)) / trajectory.fps
    times = times[: np.searchsorted(times, rollout.times[-1] + 1e-9, side="right") if len(rollout.times) else 0]
    wanted = trajectory.qpos[: len(times), robot.qpos_index]
    columns = [_at(times, rollout.times, values) for values in (rollout.hinges, rollout.torque)]
    return Tracking(times, wanted, *columns)


def tracking_figures(tracking: Tracking, plant: Plant, rollout: Rollout, fps: float) -> dict[str, Any]:
    """Errors, lag and load of the driven hinges; None where the simulation broke down before the first frame."""
    driven, robot = plant.driven, plant.robot
    if not len(tracking.times) or not driven.size:
        return {"tracking_rms_rad": None, "worst_joint": None, "joints": {}}
    error, wanted = tracking.error[:, driven], tracking.wanted[:, driven]
    rms, peak = np.sqrt((error**2).mean(0)), np.abs(error).max(0)
    load, loads = load_figures(plant, rollout)
    joints = {}
    for k, (joint, r, m) in enumerate(zip(driven, rms, peak, strict=True)):
        name = robot.joint_names[joint]
        own = {"rms_rad": round(float(r), 5), "max_rad": round(float(m), 5)}
        joints[name] = own | {"lag_s": _lag(error[:, [k]], wanted[:, [k]], fps)} | loads.get(name, {})
    return {
        "tracking_rms_rad": round(float(np.sqrt((error**2).mean())), 5),
        "tracking_max_rad": round(float(peak.max()), 5),
        "worst_joint": robot.joint_names[driven[rms.argmax()]],
        "worst_joint_rms_rad": round(float(rms.max()), 5),
        "lag_s": _lag(error, wanted, fps),
        **load,
        "joints": joints,
    }


def plain_figures(trajectory: Trajectory, plant: Plant, plain: Rollout, compensated: bool) -> dict[str, Any]:
    """Return the tracking error without compensation; None if the goals are not compensated."""
    tracking = at_frames(trajectory, plant.robot, plain)
    error, wanted = tracking.error[:, plant.driven], tracking.wanted[:, plant.driven]
    applies = compensated and error.size
    return {
        "compensated": compensated,
        "plain_tracking_rms_rad": round(float(np.sqrt((error**2).mean())), 5) if applies else None,
        "plain_lag_s": _lag(error, wanted, trajectory.fps) if applies else None,
    }


def goal_figures(trajectory: Trajectory, plant: Plant, rollout: Rollout, until: float | None) -> dict[str, Any]:
    """Return the top speed of the goals, their distance from the joints, and the limit of that distance, up to a fall.

    Empty without goals, or if the simulation broke down at once.
    """
    goals, driven = trajectory.goals, plant.driven
    ends = len(rollout.times) if until is None else int(np.searchsorted(rollout.times, until))
    if goals is None or not ends or not driven.size:
        return {}
    ahead = np.abs(goals.angles[1 : ends + 1, driven] - rollout.hinges[: len(goals) - 1, driven][:ends])
    step = ahead.max(0, initial=0)
    servo_map = plant.servo_map
    return {
        "goal_speed_rad_s": round(float(np.abs(np.diff(goals.angles, axis=0)).max(initial=0) * goals.rate), 3),
        "goal_step_rad": round(float(step.max()), 4),
        "goal_step_joint": plant.robot.joint_names[driven[step.argmax()]],
        "goal_step_limit_rad": None if servo_map is None else servo_map.limits.jump,
    }


def rollout_figures(rollout: Rollout, robot: Robot, until: float | None) -> dict[str, Any]:
    """Self-contacts up to a fall at `until` [s], breakdown, speed of the simulation."""
    contacts = own_contacts(rollout, robot, until)
    states = max(len(rollout.times), 1)
    return {
        "tracked_self_contact_share": round(len(np.unique(contacts.frame)) / states, 4),
        "tracked_self_contact_depth_m": round(float(contacts.depth.max(initial=0)), 5),
        "unstable_s": None if rollout.unstable is None else round(rollout.unstable, 4),
        "steps_per_second": round(rollout.steps_per_second),
        "tracked_self_contacts": summary(contacts, robot, states),
        **({"objects": rollout.bodies} if rollout.bodies else {}),
    }


def own_contacts(rollout: Rollout, robot: Robot, until: float | None) -> Contacts:
    """Contacts of the robot with itself up to a fall, less the `reference_overlaps` ones."""
    contacts = rollout.contacts.own.without(reference_overlaps(robot))
    return contacts if until is None else contacts.of(rollout.times[contacts.frame] < until)


def fall_figures(rollout: Rollout, robot: Robot, trajectory: Trajectory) -> dict[str, Any]:
    """When the robot fell (negative: before the trajectory began), and which body touched the floor.

    A fall is a body other than a foot on the floor; or, where the model lets few bodies touch it, a root at less than
    `ROOT_DOWN` of its planned height.
    """
    contacts = rollout.contacts.scene
    wrong = contacts.of(~np.isin(contacts.bodies[:, 1], _feet(robot, contacts)))
    collapsed = np.flatnonzero(_collapsed(rollout, robot, trajectory))
    first, low = (int(at.min(initial=len(rollout.times))) for at in (wrong.frame, collapsed))
    if min(first, low) == len(rollout.times):
        return {"fall_s": None, "fall_body": None}
    touched = robot.model.body(int(wrong.bodies[wrong.frame.argmin(), 1])).name if first <= low else None
    return {"fall_s": round(float(rollout.times[min(first, low)]), 3), "fall_body": touched}


def _collapsed(rollout: Rollout, robot: Robot, trajectory: Trajectory) -> np.ndarray:
    """(N,) whether the root is at less than `ROOT_DOWN` of its planned height, both above where the plan has the floor: z = 0.

    Both are taken where the centre of mass is at first, because a model may have its root's frame on the floor.
    """
    height = robot.root_address + 2
    planned = np.interp(rollout.times, np.arange(len(trajectory)) / trajectory.fps, trajectory.qpos[:, height])
    lift, middle = planned[:1] - rollout.qpos[:1, height], rollout.com[:1, 2] - rollout.qpos[:1, height]
    return rollout.qpos[:, height] + lift + middle < ROOT_DOWN * (planned + middle)


def _feet(robot: Robot, contacts: Contacts) -> list[int]:
    """Return the bodies that may stand on the floor: the recognised feet and their toes, or the bodies that touch it first."""
    feet = feet_of(robot).all_bodies
    if not feet and len(contacts):
        return sorted(with_toes(robot, set(contacts.bodies[contacts.frame == contacts.frame.min(), 1].tolist())))
    return feet


def _at(times: Floats, known: Floats, values: Floats) -> Floats:
    return np.stack([np.interp(times, known, column) for column in values.T], 1) if len(known) else values[:0]


def _lag(error: Floats, wanted: Floats, fps: float) -> float | None:
    """The delay τ [s] that explains the errors best: e = −τ dq/dt in the least squares."""
    if len(wanted) < 3:
        return None
    speed = np.gradient(wanted, 1 / fps, axis=0)
    power = (speed**2).sum()
    return round(float(-(error * speed).sum() / power), 4) if power > MOVING**2 * len(wanted) else None
