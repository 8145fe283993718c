"""The servos that judge a trajectory are not only those for which its goals were computed."""

from dataclasses import replace

import numpy as np
import pytest
from made_trajectories import swing

from robot_retarget.judge.build import build_plant
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.figures import at_frames
from robot_retarget.judge.playback import roll_out
from robot_retarget.judge.rollout import plant_of, simulate
from robot_retarget.judge.servo_model import drives_of
from robot_retarget.judge.worlds import DRAWN, DRAWN_SPREAD, NOMINAL, other_drives
from robot_retarget.robot import load_robot

OP3 = load_robot("op3")
WAVING = swing(OP3, "l_sho_pitch", 0.5, 0.8, 2.0)


def test_the_toddlerbot_identification_is_the_published_one() -> None:
    nominal = drives_of(OP3)
    assert nominal is not None
    other = other_drives(nominal)["gears as ToddlerBot measured them"]
    for values, published in ((other.damping, 0.0), (other.friction, 0.134), (other.armature, 0.0012)):
        np.testing.assert_allclose(values, published)
    for name in ("stiffness", "stall_torque", "back_emf", "derivative"):
        np.testing.assert_array_equal(getattr(other, name), getattr(nominal, name))


def test_drawn_servos_are_within_the_spread_and_the_same_every_time() -> None:
    nominal = drives_of(OP3)
    assert nominal is not None
    one, again = (other_drives(nominal)[DRAWN] for _ in range(2))
    for name in ("damping", "friction", "armature"):
        ratio = getattr(one, name) / getattr(nominal, name)
        assert 1 / DRAWN_SPREAD <= ratio.min() < 0.9 and 1.1 < ratio.max() <= DRAWN_SPREAD
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))


def test_a_plant_with_other_gears_moves_as_one_built_with_them() -> None:
    nominal = drives_of(OP3)
    assert nominal is not None
    other = other_drives(nominal)["gears as ToddlerBot measured them"]
    plants = plant_of(OP3, "pinned").with_drives(other), build_plant(OP3, "pinned", other)
    one, built = (roll_out(plant, WAVING, "pinned").qpos for plant in plants)
    np.testing.assert_array_equal(one, built)


def test_the_report_has_the_figures_of_the_servos_it_does_worst_on() -> None:
    report, plant = simulate(WAVING, OP3), plant_of(OP3, "pinned")
    goals, found = compensated(plant, WAVING), {}
    nominal = drives_of(OP3)
    assert nominal is not None
    for name, drives in {NOMINAL: nominal, **other_drives(nominal)}.items():
        rolled = roll_out(build_plant(OP3, "pinned", drives), WAVING, "pinned", None, goals)
        found[name] = float(np.sqrt((at_frames(WAVING, OP3, rolled).error ** 2).mean()))
    figures = report.figures
    assert figures["tracking_rms_rad_by_servos"] == pytest.approx(found, abs=2e-5)
    assert figures["nominal_tracking_rms_rad"] == pytest.approx(found[NOMINAL], abs=2e-5)
    assert figures["servos"] != NOMINAL and figures["tracking_rms_rad"] > 2 * figures["nominal_tracking_rms_rad"]


def test_a_robot_with_its_own_actuators_is_judged_on_drawn_ones_too() -> None:
    report = simulate(WAVING, OP3, drives=None)
    assert set(report.figures["tracking_rms_rad_by_servos"]) == {NOMINAL, DRAWN}
    assert replace(report).figures["servos"] in (NOMINAL, DRAWN)
