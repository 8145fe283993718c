"""A servo on a pendulum is identified from a playback: hidden parameters of the emulated one come back within 5 %."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emulated import QUICK, emulated
from forked import run as call

from robot_retarget.actuators.map import Identified, Servo, ServoMap, dump_map, load_map
from robot_retarget.actuators.motors import IDENTIFIED, MOTORS, Pendulum
from robot_retarget.base.errors import ServoError
from robot_retarget.judge.servo_model import drives_of
from robot_retarget.robot import load_robot
from robot_retarget.robot.model import with_servos
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.identify import SWING, excitation, from_log, identify
from robot_retarget.servo.outcome import PlaybackOptions
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import play
from robot_retarget.servo.played import read_play_log
from robot_retarget.servo.twin import limb_torques

HIDDEN = (0.931, 0.012, 0.134)
"""Joint damping with the back-EMF [N m s/rad], armature [kg m²], dry friction [N m]."""
SOFTER = 720
"""Register of the P gain; 800 by default."""
BENCH = ServoMap("bench", (Servo("j1", 1, "XM430-W350", lower=-1.5, upper=1.5),), 1_000_000, replace(QUICK, speed=8.0))
PENDULUM = Pendulum(0.3, 0.1)
MODEL = """<mujoco><option timestep="0.002"/><worldbody><body><joint name="j1" axis="0 1 0"
solreffriction="0.004 1" solimpfriction="0.999 0.9999 0.001"/>
<geom type="sphere" size=".001" mass=".3" pos="0 0 -.1" contype="0"/></body></worldbody></mujoco>"""


def test_hidden_parameters_of_an_emulated_servo_are_found_within_5_percent(tmp_path: Path) -> None:
    damping, armature, friction = HIDDEN
    real = Identified(damping - MOTORS["XM430-W350"].back_emf, friction, armature)
    (tmp_path / "pendulum.xml").write_text(MODEL)
    words = ("--physics", "--model", str(tmp_path / "pendulum.xml"), "--lockstep", "125")
    with emulated(tmp_path, replace(BENCH, identified={"XM430-W350": real}), *words) as emulator:
        with Bus(emulator.port, BENCH.baud) as bus:
            bus.write(1, BENCH["j1"].type.registers["position_p_gain"], SOFTER)
        found = identify(BENCH, "j1", PENDULUM, emulator.port, tmp_path / "play.npz", PlaybackOptions(lockstep=True))
    servo = found.servo
    drag = servo.damping + MOTORS["XM430-W350"].back_emf
    assert [drag, servo.armature, servo.friction] == [pytest.approx(value, rel=0.05) for value in HIDDEN]
    assert servo.gain == pytest.approx(SOFTER / 800, rel=0.05)
    assert abs(found.delay) <= 1 / 125 and found.error < 1e-3


ARM = """<mujoco model="arm"><option timestep="0.002"/><worldbody><body name="upper" pos="0 0 1"><joint name="j1" axis="0 1 0"
solreffriction="0.004 1" solimpfriction="0.999 0.9999 0.001"/><geom type="capsule" fromto="0 0 0 0 0 -.12" size=".02" mass=".15"/>
<body name="fore" pos="0 0 -.12"><joint name="j2" axis="0 1 0" solreffriction="0.004 1" solimpfriction="0.999 0.9999 0.001"/>
<geom type="capsule" fromto="0 0 0 0 0 -.12" size=".02" mass=".15"/></body></body></worldbody></mujoco>"""


def test_a_servo_is_found_from_a_playback_of_the_robot_with_its_limb_as_the_load(tmp_path: Path) -> None:
    """Two joints move at once; the elbow carries a limb that is swung by the shoulder."""
    real = Identified(0.12, 0.1, 0.02)
    arm = replace(BENCH, servos=tuple(replace(BENCH["j1"], joint=f"j{k}", id=k) for k in (1, 2)))
    (tmp_path / "arm.xml").write_text(ARM)
    times = np.arange(1500)[:, None] / 125
    swing = 0.5 * np.sin(2 * np.pi * (0.35 + 0.03 * times) * times) * [1, -1] + 0.2 * np.sin(
        2 * np.pi * 1.7 * times + [0, 1]
    )
    words = ("--physics", "--model", str(tmp_path / "arm.xml"), "--lockstep", "125")
    with emulated(tmp_path, replace(arm, identified={"XM430-W350": real}), *words) as emulator:
        options = PlaybackOptions(lockstep=True, end_pose=False)
        play(ServoPlan(swing * np.minimum(times, 1), 125.0), arm, emulator.port, options, tmp_path / "play.npz")
    log = read_play_log(tmp_path / "play.npz")
    loads = limb_torques(tmp_path / "arm.xml", log)
    found = from_log(log, arm, "j1", loads[:, 0])
    require_real(vars(found.servo), found.spread, real)
    (tmp_path / "arm.toml").write_text(dump_map(arm), encoding="utf-8")
    words = (
        "--map",
        tmp_path / "arm.toml",
        "--joint",
        "j2",
        "--from",
        tmp_path / "play.npz",
        "--robot",
        tmp_path / "arm.xml",
    )
    done = call("servos", "identify", *words, "-o", tmp_path / "new.toml", "--picture", tmp_path / "j2.svg", "--json")
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    require_real(facts, facts["standard_errors"], real)
    assert (tmp_path / "j2.svg").read_text().startswith("<svg")
    assert load_map(tmp_path / "new.toml").identified["XM430-W350"].friction == facts["friction"]
    with pytest.raises(ServoError, match=r"j1 moves by 0\.0. rad in the log: 0\.4 are needed"):
        from_log(replace(log, angles=0.05 * log.angles), arm, "j1", loads[:, 0])


def require_real(found: dict[str, float], spread: Mapping[str, float], real: Identified) -> None:
    """Within 5 % (friction and armature 10 %), and within two standard errors."""
    for name, share in (("damping", 0.05), ("friction", 0.1), ("armature", 0.1), ("gain", 0.05)):
        off = found[name] - getattr(real, name)
        assert abs(off) < share * getattr(real, name) and abs(off) < 2 * spread[name], name


def test_the_emulator_carries_a_pendulum_and_the_supply_is_accounted_for(tmp_path: Path) -> None:
    words = ("--pendulum", "0.3,0.1", "--lockstep", "125", "--fault", "supply 10.8")
    with emulated(tmp_path, BENCH, *words) as emulator:
        found = identify(BENCH, "j1", PENDULUM, emulator.port, tmp_path / "play.npz", PlaybackOptions(lockstep=True))
    true, servo = IDENTIFIED["XM430-W350"], found.servo
    back_emf, near = MOTORS["XM430-W350"].back_emf, 0.05
    assert servo.damping + back_emf == pytest.approx(true.damping + back_emf, rel=near)
    assert [servo.armature, servo.friction] == [pytest.approx(x, rel=near) for x in (true.armature, true.friction)]
    assert servo.gain == pytest.approx(1.0, rel=near) and found.weight == pytest.approx(1.0, rel=0.1)
    assert found.voltage == pytest.approx(10.8, abs=0.2)
    for name in ("friction", "armature", "gain"):
        assert 0 < found.spread[name] < 0.05 * getattr(servo, name)


def test_a_pendulum_that_is_not_there_is_refused(tmp_path: Path) -> None:
    refused = pytest.raises(ServoError, match=r"weight that fits best is .* times the|moves so")
    with emulated(tmp_path, BENCH, "--lockstep", "125") as emulator, refused:
        identify(BENCH, "j1", PENDULUM, emulator.port, tmp_path / "play.npz", PlaybackOptions(lockstep=True))


def test_what_was_identified_stands_in_the_map_and_is_simulated(tmp_path: Path) -> None:
    own = replace(BENCH, identified={"XM430-W350": Identified(0.3, 0.1, 0.01, 0.9)})
    (tmp_path / "own.toml").write_text(dump_map(own), encoding="utf-8")
    assert load_map(tmp_path / "own.toml") == own and own.fingerprint != BENCH.fingerprint
    op3 = load_robot("op3")
    assert op3.servo_map is not None
    usual, drives = drives_of(op3), drives_of(with_servos(op3, replace(op3.servo_map, identified=own.identified)))
    assert usual is not None and drives is not None
    np.testing.assert_allclose(
        [drives.damping, drives.friction, drives.armature], np.outer([0.3, 0.1, 0.01], np.ones(20))
    )
    np.testing.assert_allclose(drives.stiffness, 0.9 * usual.stiffness)


@pytest.mark.parametrize("wrong", [{"mass": 0}, {"length": -1}, {"inertia": float("nan")}])
def test_a_pendulum_that_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ServoError, match=f"pendulum's {next(iter(wrong))}"):
        Pendulum(**({"mass": 0.5, "length": 0.1} | wrong))


def test_a_range_that_does_not_hold_the_excitation_is_refused(tmp_path: Path) -> None:
    narrow = replace(BENCH, servos=(replace(BENCH["j1"], upper=0.5),))
    with pytest.raises(ServoError, match=r"needs the range −0\.8…0\.8 rad"):
        identify(narrow, "j1", PENDULUM, "/dev/null", tmp_path / "play.npz")


def test_the_excitation_begins_and_ends_where_the_pendulum_hangs() -> None:
    path = excitation().angles
    assert path[0] == path[-1] == 0 and np.abs(path).max() == pytest.approx(SWING)
