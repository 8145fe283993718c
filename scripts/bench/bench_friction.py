"""Compare the friction of gears with BAM's own simulation: `python scripts/bench/bench_friction.py --bam FOLDER`.

FOLDER holds the package `bam` (`pip install --no-deps --target FOLDER better-actuator-models`, Python 3.12). A pendulum is driven along BAM's four
trajectories by the servos of BAM's M4 parameters, once by BAM's simulator and once by MuJoCo with `judge/servo_model.py`. The table has the mean
absolute difference of the angles [mrad], and the same for dry friction alone.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.judge.servo_model import GearFriction

TRAJECTORIES = ("lift_and_drop", "sin_time_square", "up_and_down", "sin_sin")
STEP = 0.001
"""Of both simulations [s]."""
GRAVITY = 9.80665
"""As in BAM [m/s²]."""
SERVOS = {"xl330": (0.15, 0.1), "mx64": (1.0, 0.15)}
"""Mass [kg] and length [m] of the pendulum that each servo turns: a third to a quarter of its stall torque."""


@dataclass(frozen=True)
class Servo:
    """A servo at BAM's parameters: a voltage controller, a motor and gears."""

    stiffness: float
    """[N m/rad]."""
    most: float
    """[N m]."""
    back_emf: float
    """[N m s/rad]."""
    viscous: float
    dry: float
    armature: float
    gears: GearFriction


def servo_of(model: Any) -> Servo:
    """The parameters of a BAM model, at the joint."""
    actuator, value = model.actuator, lambda name: float(getattr(model, name).value)
    per_volt = value("kt") / value("R")
    names = ("friction_stribeck", "load_friction_base", "load_friction_stribeck", "dtheta_stribeck", "alpha")
    return Servo(
        stiffness=actuator.kp * actuator.error_gain * actuator.vin * per_volt, most=actuator.vin * actuator.max_pwm * per_volt,
        back_emf=value("kt") * per_volt, viscous=value("friction_viscous"), dry=value("friction_base"), armature=value("armature"),
        gears=GearFriction(*(np.array([value(name)]) for name in names)),
    )  # fmt: skip


def pendulum(servo: Servo, mass: float, length: float) -> mujoco.MjModel:
    """A point mass on a massless arm, hanging at 0, with the servo on its hinge."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{STEP}" gravity="0 0 {-GRAVITY}" integrator="implicitfast"/>
        <worldbody><body><joint name="j" axis="0 -1 0" armature="{servo.armature}" damping="{servo.viscous + servo.back_emf}"
        frictionloss="{servo.dry}"/><inertial pos="0 0 {-length}" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
        <actuator><position joint="j" kp="{servo.stiffness}" forcerange="{-servo.most} {servo.most}"/></actuator></mujoco>""")


def ours(servo: Servo, mass: float, length: float, goals: Floats, on: Floats, varies: bool) -> Floats:
    """Angles (N,) [rad] in MuJoCo for goals (N,) [rad] with torque on or off (N,)."""
    model = pendulum(servo, mass, length)
    data, dofs, found = mujoco.MjData(model), np.array([0]), np.zeros(len(goals))
    gain, bias = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()
    for k, (goal, powered) in enumerate(zip(goals, on, strict=True)):
        found[k], data.ctrl[0] = data.qpos[0], goal
        model.actuator_gainprm[:], model.actuator_biasprm[:] = powered * gain, powered * bias
        model.dof_damping[0] = servo.viscous + powered * servo.back_emf
        if varies:
            back_emf = np.array([powered * servo.back_emf])
            servo.gears.apply(model, data, dofs, np.array([servo.dry]), back_emf)
        mujoco.mj_step(model, data)
    return found


def theirs(model: Any, mass: float, length: float, goals: Floats, on: Floats) -> Floats:
    """Angles (N,) [rad] in BAM's simulator."""
    from bam.simulate import Simulator  # type: ignore[import-not-found]

    entries = [
        {"position": 0.0, "speed": 0.0, "goal_position": goal, "torque_enable": bool(powered)}
        for goal, powered in zip(goals.tolist(), on, strict=True)
    ]
    actuator = model.actuator
    log = {
        "dt": STEP,
        "mass": mass,
        "arm_mass": 0.0,
        "length": length,
        "kp": actuator.kp,
        "vin": actuator.vin,
        "entries": entries,
    }
    positions, _, _ = Simulator(model).rollout_log(log, simulate_control=True)
    return np.array(positions)


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--bam", type=Path, required=True, help="folder with the package bam")
    arg = ap.parse_args()
    sys.path.insert(0, str(arg.bam))
    from bam.model import load_model  # type: ignore[import-not-found]
    from bam.trajectory import trajectories  # type: ignore[import-not-found]

    print("| servo | trajectory | M4 [mrad] | dry friction alone [mrad] |\n|---|---|---|---|")
    for name, (mass, length) in SERVOS.items():
        for title in TRAJECTORIES:
            model, path = load_model(motor_name=name, model="m4"), trajectories[title]
            model.q_offset.value = 0.0  # of BAM's test bench
            goals, on = np.array([path(k * STEP) for k in range(round(path.duration / STEP))]).T
            truth, servo = theirs(model, mass, length, goals, on), servo_of(model)
            errors = [np.abs(ours(servo, mass, length, goals, on, varies) - truth).mean() for varies in (True, False)]
            print(f"| {name} | {title} | {1000 * errors[0]:.2f} | {1000 * errors[1]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
