"""Friction of gears under load: where an arm sticks, and what it does to a robot's simulation."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_trajectories import hold

import robot_retarget as rr
from robot_retarget.actuators.map import Identified, dump_map, load_map
from robot_retarget.judge.playback import roll_out
from robot_retarget.judge.rollout import plant_of
from robot_retarget.judge.servo_model import GearFriction

OP3 = rr.load_robot("op3")
MASS, LENGTH, DRY = 1.0, 0.1, 0.02
CREEP = 0.02
"""An arm that sticks in MuJoCo sinks by up to this angle in half a second [rad]."""
ARM = f"""<mujoco><option timestep="0.001"/><worldbody><body><joint name="j" axis="0 -1 0"/>
    <inertial pos="0 0 {-LENGTH}" mass="{MASS}" diaginertia="1e-6 1e-6 1e-6"/></body></worldbody></mujoco>"""


def gears(static: float = 0.0, load: float = 0.0, static_load: float = 0.0, speed: float = 1.0) -> GearFriction:
    return GearFriction(*(np.array([x]) for x in (static, load, static_load, speed, 1.0)))


def swings(friction: GearFriction, angle: float) -> float:
    """How far an arm without torque falls in half a second from an angle [rad]."""
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    data.qpos[0] = angle
    mujoco.mj_forward(model, data)
    for _ in range(500):
        friction.apply(model, data, np.array([0]), np.array([DRY]), np.zeros(1))
        mujoco.mj_step(model, data)
    return abs(float(data.qpos[0]) - angle)


@pytest.mark.parametrize(
    "form", [{"load": 0.5}, {"static_load": 0.5}, {"load": 0.2, "static_load": 0.3}, {"static": 0.3}]
)
def test_an_arm_sticks_up_to_the_angle_at_which_its_weight_is_its_friction(form: dict[str, float]) -> None:
    """m g L sin θ = f_c + f_s + (l + l_s) m g L sin θ."""
    load = form.get("load", 0.0) + form.get("static_load", 0.0)
    limit = np.arcsin((DRY + form.get("static", 0.0)) / ((1 - load) * MASS * 9.81 * LENGTH))
    below, above = (swings(gears(**form), share * limit) for share in (0.9, 1.15))
    assert below < CREEP and above > 5 * below


def test_friction_of_rest_fades_with_speed() -> None:
    one, speeds = gears(static=0.3, static_load=0.2, speed=0.5), np.array([0.0, 0.5, 50.0])
    found = [float(one.more(np.array([1.0]), np.array([0.0]), np.array([speed]))[0]) for speed in speeds]
    assert found == pytest.approx([0.5, 0.5 / np.e, 0.0], abs=1e-12)


def test_identified_load_acts_in_the_simulation_and_leaves_the_plant_alone(tmp_path) -> None:
    assert OP3.servo_map is not None
    heavy = Identified(0.233, 0.03, 0.045, load=0.1, static_load=0.1, static=0.05, rest_speed=0.2)
    servo_map = replace(OP3.servo_map, identified={"XM430-W350": heavy})
    path = tmp_path / "map.toml"
    path.write_text(dump_map(servo_map), encoding="utf-8")
    assert load_map(path).identified == servo_map.identified
    plain, loaded = (plant_of(replace(OP3, servo_map=m), "free") for m in (OP3.servo_map, servo_map))
    stand, before = hold(OP3, 0.2), loaded.model.dof_frictionloss.copy()
    rollouts = [roll_out(plant, stand, "free") for plant in (plain, loaded)]
    assert np.array_equal(loaded.model.dof_frictionloss, before)
    sag = [np.abs(rollout.hinges[-1] - stand.qpos[0, OP3.qpos_index]).max() for rollout in rollouts]
    assert sag[1] < 0.9 * sag[0]
