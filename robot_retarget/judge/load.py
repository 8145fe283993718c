"""Load of the servos: torque, speed, current, heat, energy."""

from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.servo_model import Drives
from robot_retarget.judge.stepping import Rollout

SATURATED = 0.99
"""A servo is at its torque limit from this share of it on."""
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
    full = (np.abs(force) >= SATURATED * bound).mean(0)
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
