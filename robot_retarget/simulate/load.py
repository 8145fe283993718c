"""What the servos have to bear: torque, speed, current, heat, energy."""

from typing import Any

import numpy as np

from robot_retarget.simulate.plant import Plant
from robot_retarget.simulate.stepping import Rollout

SATURATED = 0.99
"""A servo that gives this part of its torque bound gives all it has."""


def load_figures(plant: Plant, rollout: Rollout) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The robot's figures, and those of each driven joint, from the beginning of the trajectory on."""
    playing = rollout.times >= 0
    driven, robot = plant.driven, plant.robot
    if playing.sum() < 2 or not driven.size:
        return {}, {}
    force, speed = rollout.torque[playing][:, driven], rollout.speeds[playing][:, driven]
    drives = plant.drives.of(driven) if plant.drives is not None else None
    torque = force if drives is None else drives.shaft_torque(force, speed)
    full = (np.abs(force) >= SATURATED * plant.bounds[driven]).mean(0)
    top = np.abs(speed).max(0) / (robot.max_speed[driven] if drives is None else drives.no_load_speed)
    dt = float(np.diff(rollout.times[playing]).mean())
    columns: dict[str, Any] = {
        "saturated_share": (full, 4),
        "peak_torque_Nm": (np.abs(torque).max(0), 4),
        "rms_torque_Nm": (np.sqrt((torque**2).mean(0)), 4),
        "speed_share": (top, 4),
    }
    figures: dict[str, Any] = {
        "saturated_share": round(float(full.max()), 4),
        "saturated_joint": robot.joint_names[driven[full.argmax()]] if full.any() else None,
        "work_J": round(float(np.maximum(torque * speed, 0).sum() * dt), 3),
    }
    if drives is not None:
        current, rise = drives.current(force, speed), drives.temperature_rise(force, speed, dt)
        effective = np.sqrt((current**2).mean(0))
        columns |= {
            "rms_current_A": (effective, 4),
            "peak_current_A": (np.abs(current).max(0), 4),
            "heat_ratio": ((effective / drives.continuous_current) ** 2, 3),
            "temperature_rise_K": (rise, 3),
        }
        hottest = int(rise.argmax())
        figures |= {
            "supply_V": drives.voltage,
            "peak_supply_current_A": round(float((drives.power(force, speed).sum(1) / drives.voltage).max()), 3),
            "energy_J": round(float(drives.power(force, speed).sum() * dt), 3),
            "hottest_joint": robot.joint_names[driven[hottest]],
            "heat_ratio": round(float(((effective / drives.continuous_current) ** 2).max()), 3),
            "temperature_rise_K": round(float(rise[hottest]), 3),
        }
    joints = {
        robot.joint_names[joint]: {name: round(float(values[k]), digits) for name, (values, digits) in columns.items()}
        for k, joint in enumerate(driven)
    }
    return figures, joints
