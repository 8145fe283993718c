"""MX and AX servos under Protocol 1: registers, frames, the faults of a playback, and the public map of Poppy.

Every playback is against an emulator process over a pseudo terminal, whose time goes by ticks.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dynamixel_sdk import GroupSyncWrite, PortHandler, Protocol1PacketHandler, port_handler
from emulated import QUICK, Emulated, emulated
from shared_files import ROOT
from test_servo_play import OPTIONS, PHASE, PLAN, RATE, START, assert_match, settling

import robot_retarget as rr
from robot_retarget.actuators.control_tables import model_named
from robot_retarget.actuators.map import MapError, Servo, ServoMap, dump_map
from robot_retarget.base.errors import ServoError
from robot_retarget.servo import protocol1
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.check import check
from robot_retarget.servo.foreign import read_foreign
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions, PlaybackOutcome
from robot_retarget.servo.plan import goal_plan
from robot_retarget.servo.play import play

BENCH = ServoMap(
    "bench",
    tuple(
        Servo(f"j{k}", k, model, sign, model_named(model).centre + 10 * k, lower=-1.5, upper=1.5)
        for k, model, sign in ((1, "MX-28", -1), (2, "MX-64", 1), (3, "MX-106", -1), (4, "AX-12", 1))
    ),
    1_000_000,
    replace(QUICK, current=6.0),
)
"""Four servos of three encoders and two ways to be read."""


def test_the_registers_are_those_of_two_public_sources() -> None:
    """Addresses of dynamixel-workbench's `items_AX`, `items_MX` and `items_EXTMX`; pypot's `DxlIO` has the same."""
    both = "0:2 2:1 3:1 4:1 5:1 6:2 8:2 11:1 12:1 13:1 14:2 16:1 17:1 18:1 24:1 25:1 30:2 32:2 34:2 36:2 38:2 40:2 42:1 43:1 44:1"
    both += " 46:1 47:1 48:2"
    mx = both + " 20:2 22:1 26:1 27:1 28:1 73:1"
    theirs = {
        "AX-12": both + " 26:1 27:1 28:1 29:1",
        "MX-28": mx,
        "MX-64": mx + " 68:2 70:1 71:2",
        "MX-106": mx + " 68:2 70:1 71:2 10:1",
    }
    for name, text in theirs.items():
        registers = model_named(name).registers
        places = {f"{r.address}:{r.size}" for key, r in registers.items() if key != "realtime_tick"}
        assert places == set(text.split()), name
    assert (
        model_named("XL-320").registers["goal_pwm"].address == 35
    )  # the manual, pypot and the SDK against the workbench


@pytest.mark.parametrize(
    ("made", "manual"),
    [
        (protocol1.frame(1, 1), "FF FF 01 02 01 FB"),
        (protocol1.read(1, 43, 1), "FF FF 01 04 02 2B 01 CC"),
        (protocol1.status(1, 0, b"\x20"), "FF FF 01 03 00 20 DB"),
        (protocol1.status(1, 0, hardware=0x24), "FF FF 01 02 24 D8"),
        (
            protocol1.sync_write(30, 4, [(0, bytes.fromhex("10005001")), (1, bytes.fromhex("20026003"))]),
            "FF FF FE 0E 83 1E 04 00 10 00 50 01 01 20 02 60 03 67",
        ),
        (
            protocol1.frame(254, 0x92, bytes((0, 2, 1, 30, 2, 2, 36))),
            "FF FF FE 09 92 00 02 01 1E 02 02 24 1D",
        ),
    ],
)
def test_frames_are_those_of_the_manual_and_come_back(made: bytes, manual: str) -> None:
    assert made == bytes.fromhex(manual)
    noisy = b"\x00\xff" + made[:-2] + made + b"\xff"
    assert [frame.id for frame in protocol1.parser().feed(noisy)][-1:] == [made[2]]
    assert protocol1.answered(made) == (made[4] != 0x83)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    with emulated(tmp_path_factory.mktemp("bus"), BENCH, "--lockstep", f"{RATE:g}") as emulator:
        yield emulator


@pytest.fixture
def emulator(running: Emulated) -> Emulated:
    """A bus as new, the arm near its first frame."""
    running.do("reset")
    running.spread(BENCH, START)
    return running


def test_the_sdk_s_own_handler_pings_reads_writes_and_reads_in_bulk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_handler, "LATENCY_TIMER", 2000.0)  # a busy machine answers late
    with emulated(tmp_path, BENCH) as emulator:
        port, packets = PortHandler(emulator.port), Protocol1PacketHandler()
        assert port.setBaudRate(BENCH.baud)
        assert [packets.ping(port, k)[:2] for k in (1, 2, 3, 4)] == [(29, 0), (310, 0), (320, 0), (12, 0)]
        writing = GroupSyncWrite(port, packets, 30, 2)
        assert all(writing.addParam(k, [0x00, 0x02]) for k in (1, 4)) and writing.txPacket() == 0
        assert packets.read2ByteTxRx(port, 4, 30) == (0x200, 0, 0)
        assert packets.write2ByteTxRx(port, 1, 30, 5000)[1] == 2, "the bit of an angle beyond the limits"
        # `GroupBulkRead` of 4.1.0 hands one argument too many to this handler.
        assert packets.bulkReadTx(port, [2, 1, 36, 2, 2, 36, 2, 3, 36], 9) == 0
        assert [packets.readRx(port, k, 2)[0] for k in (1, 2, 3)][2] == list(BENCH["j3"].zero.to_bytes(2, "little"))
        assert packets.read1ByteTxRx(port, 1, 24)[0] == 1, "a goal switches torque on"
        port.closePort()


def test_a_bulk_read_ends_at_a_missing_servo_and_single_reads_do_not(emulator: Emulated) -> None:
    with Bus(emulator.port, BENCH.baud, True, 1) as bus:
        emulator.do("silent 2")
        assert set(bus.read_all(36, 6, BENCH.ids, (1, 2, 3))) == {1, 4}
        assert set(bus.read_all(36, 6, BENCH.ids)) == {1, 3, 4}
        emulator.do("heard all")
        assert list(bus.scan(range(6))) == [(1, 29, 41), (2, 310, 41), (3, 320, 41), (4, 12, 41)]
        emulator.do("echo 1")
        assert set(bus.read_all(36, 6, BENCH.ids)) == {1, 2, 3, 4}


def perform(emulator: Emulated, folder: Path, phase: str, fault: str) -> PlaybackOutcome:
    def say(text: str) -> None:
        if text.startswith(PHASE[phase]):
            emulator.do(fault)

    return play(PLAN, BENCH, emulator.port, OPTIONS, folder / "play.npz", say)


def require_harmless(emulator: Emulated) -> None:
    for servo in BENCH.servos:
        seen, (low, high) = emulator.servos()[servo.id], servo.tick_range
        assert low <= seen["lowest_goal"] and seen["highest_goal"] <= high
        assert seen["largest_step"] <= BENCH.limits.jump * abs(servo.scale) + 1


STOPPED = {
    "silent 2": (r"j2 \(servo 2\) no longer answers", "hold"),
    "silent 4": (r"j4 \(servo 4\) no longer answers", "hold"),
    "silent all": ("no servo answers any more", "hold"),
    "supply 9.7": (r"supply is 9\.\d V", "hold"),
    "supply 16.4": (r"hardware error: input voltage|supply is 16\.4 V", "hold"),
    "heat 2 75": (r"j2 \(servo 2\) is 75 °C hot", "hold"),
    "heat 4 75": (r"j4 \(servo 4\)(: hardware error: overheating| is 75 °C hot)", "hold"),
    "overload 2": (r"j2 \(servo 2\): hardware error: overload", "hold"),
}


@pytest.mark.parametrize("fault", STOPPED)
def test_a_fault_on_the_way_stops_with_everybody_holding(emulator: Emulated, tmp_path: Path, fault: str) -> None:
    outcome = perform(emulator, tmp_path, "play", fault)
    reason, state = STOPPED[fault]
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.FAULT, state, 1), outcome.reason
    assert_match(reason, outcome.reason)
    assert settling(emulator) < 0.2
    require_harmless(emulator)


def test_a_limp_servo_gets_its_torque_back_with_the_next_goal(emulator: Emulated, tmp_path: Path) -> None:
    assert perform(emulator, tmp_path, "play", "limp all").ended is PlaybackEnd.FINISHED
    assert all(servo["torque_enable"] for servo in emulator.servos().values())
    require_harmless(emulator)


def test_a_jammed_joint_is_noticed(emulator: Emulated, tmp_path: Path) -> None:
    outcome = perform(emulator, tmp_path, "play", "jam 2")
    assert outcome.exit_code == 1
    assert_match(r"j2 (was .* rad off|stood still|.*does not follow)", outcome.reason)
    require_harmless(emulator)


@pytest.mark.parametrize("fault", ["corrupt 0.05", "drop 0.1", "noise 0.3", "delay 1", "echo 1"])
def test_a_bad_cable_is_lived_through(emulator: Emulated, tmp_path: Path, fault: str) -> None:
    outcome = perform(emulator, tmp_path, "play", fault)
    assert (outcome.ended, outcome.state) == (PlaybackEnd.FINISHED, "hold"), outcome.reason
    require_harmless(emulator)


REFUSED = {
    "silent 3": "j3 .* does not answer",
    "model 2 12": "j2 .* is a AX-12, the map says MX-64",
    "duplicate 2 3": "j2 .*two servos share|j3 .* does not answer",
    "overload 1": "j1 .* hardware error: overload; switch its supply off and on",
    "supply 9.2": "supply is 9.2 V, allowed 10",
}


@pytest.mark.parametrize("fault", REFUSED)
def test_a_robot_that_is_not_fit_is_not_moved(emulator: Emulated, tmp_path: Path, fault: str) -> None:
    emulator.do(fault)
    with pytest.raises(ServoError, match=REFUSED[fault]):
        play(PLAN, BENCH, emulator.port, OPTIONS, tmp_path / "play.npz")
    assert not any(servo["torque_enable"] for servo in emulator.servos().values())


def test_a_pulled_cable_leaves_servos_without_a_watchdog_holding_and_says_so(
    emulator: Emulated, tmp_path: Path
) -> None:
    outcome = perform(emulator, tmp_path, "play", "unplug")
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.LOST, "hold", 1)
    assert_match("is gone.*; the servos have no watchdog and hold their last goals", outcome.reason)
    assert all(servo["torque_enable"] for servo in emulator.servos().values())
    require_harmless(emulator)
    emulator.do("plug")


@pytest.mark.parametrize(("signals", "state"), [((2,), "hold"), ((15,), "hold"), ((2, 2), "release")])
def test_ctrl_c_and_sigterm_hold_and_a_second_ctrl_c_lets_go(
    emulator: Emulated, tmp_path: Path, signals: tuple[int, ...], state: str
) -> None:
    asked: list[int] = []

    def say(text: str) -> None:
        if text.startswith("holding" if asked else "playing") and len(asked) < len(signals):
            asked.append(signals[len(asked)])
            os.kill(os.getpid(), asked[-1])

    outcome = play(PLAN, BENCH, emulator.port, OPTIONS, tmp_path / "play.npz", say)
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.INTERRUPTED, state, 1)
    assert all(s["torque_enable"] == (state == "hold") for s in emulator.servos().values())
    require_harmless(emulator)


def test_when_the_player_is_killed_the_servos_hold_their_last_goals(emulator: Emulated, tmp_path: Path) -> None:
    code = (
        "import sys; sys.path[:0] = ['tests/servo', 'tests']\n"
        "from test_servo_protocol1 import *\nfrom robot_retarget.servo.outcome import Record\n"
        "add = Record.add\n"
        "def watched(self, **row):\n"
        "    add(self, **row)\n"
        "    if list(self.column('phase')).count(1) == 9: os.kill(os.getpid(), signal.SIGKILL)\n"
        "Record.add = watched\n"
        f"play(PLAN, BENCH, {emulator.port!r}, OPTIONS, {str(tmp_path / 'play.npz')!r})"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == -signal.SIGKILL
    emulator.do("wait 0.5")
    rows, seen = np.load(tmp_path / "play.part.npy"), emulator.servos()
    assert all(servo["torque_enable"] for servo in seen.values())
    for k, servo in enumerate(BENCH.servos):
        assert servo.radians(seen[servo.id]["goal_position"]) == pytest.approx(rows["goal"][-1][k], abs=0.02)
        assert seen[servo.id]["present_position"] == pytest.approx(seen[servo.id]["goal_position"], abs=12)


def test_protocols_do_not_share_a_bus() -> None:
    x = Servo("x", 9, "XM430-W350", lower=-1, upper=1)
    with pytest.raises(
        MapError, match=r"j1 \(MX-28\) and x \(XM430-W350\) cannot share a bus: Protocol 1 and Protocol 2"
    ):
        replace(BENCH, servos=(*BENCH.servos, x))
    small = Servo("s", 9, "XL-320", zero=512, lower=-1, upper=1)
    with pytest.raises(MapError, match=r"cannot share a bus: other addresses"):
        replace(BENCH, servos=(x, small))


def test_wheel_mode_is_refused_and_put_right(emulator: Emulated) -> None:
    with Bus(emulator.port, BENCH.baud, True, 1) as bus:
        bus.write(4, model_named("AX-12").registers["max_position_limit"], 0)
        (found,) = [finding for finding in check(bus, BENCH)[1] if finding.grave]
    assert "wheel or multi-turn mode" in str(found) and found.fix == ("max_position_limit", 1023)


def test_an_xl_320_is_read_at_its_own_addresses_and_its_errors_have_their_own_bits(tmp_path: Path) -> None:
    small = ServoMap(
        "small",
        tuple(Servo(f"j{k}", k, "XL-320", 1, 512, lower=-1.5, upper=1.5) for k in (1, 2, 3, 4)),
        1_000_000,
        replace(QUICK, min_voltage=6.0, max_voltage=9.0),
    )
    with emulated(tmp_path, small, "--lockstep", f"{RATE:g}") as emulator:
        emulator.spread(small, START)
        outcome = play(PLAN, small, emulator.port, OPTIONS, tmp_path / "play.npz")
        assert outcome.ended is PlaybackEnd.FINISHED, outcome.reason
        assert outcome.figures["worst_joint_rms_rad"] < 0.2
        emulator.do("overload 2")
        with pytest.raises(ServoError, match=r"j2 .* hardware error: overload; reboot it"):
            play(PLAN, small, emulator.port, OPTIONS, tmp_path / "play.npz")


def test_a_map_of_slopes_has_no_gain() -> None:
    with pytest.raises(MapError, match="an AX-12 has no p_gain: it has slopes of compliance, got 32"):
        replace(BENCH["j4"], p_gain=32)
    assert "MX-64" in dump_map(BENCH)


POPPY = """l_hip_x MX-28 11 0 + -30 28.5; l_hip_z MX-28 12 0 - -25 90; l_hip_y MX-64 13 2 + -104 84; l_knee_y MX-28 14 0 + -3.5 134;
l_ankle_y MX-28 15 0 + -45 45; r_hip_x MX-28 21 0 + -28.5 30; r_hip_z MX-28 22 0 - -90 25; r_hip_y MX-64 23 0 - -85 105;
r_knee_y MX-28 24 0 - -134 3.5; r_ankle_y MX-28 25 0 - -45 45; abs_y MX-64 31 0 - -50 12; abs_x MX-64 32 0 - -45 45;
abs_z MX-28 33 0 + -90 90; bust_y MX-28 34 0 - -67 27; bust_x MX-28 35 0 - -40 40; head_z AX-12 36 0 + -90 90;
head_y AX-12 37 20 - -45 6; l_shoulder_y MX-28 41 90 + -120 155; l_shoulder_x MX-28 42 -90 - -105 110;
l_arm_z MX-28 43 0 - -105 105; l_elbow_y MX-28 44 0 + -148 1; r_shoulder_y MX-28 51 90 - -155 120;
r_shoulder_x MX-28 52 90 - -110 105; r_arm_z MX-28 53 0 - -105 105; r_elbow_y MX-28 54 0 - -1 148"""
"""Motors of `poppy_humanoid.json` of github.com/poppy-project/poppy-humanoid: type, id, offset, direct or not, limits [°]."""


def poppy(folder: Path) -> tuple[ServoMap, Path]:
    """Poppy's map as imported from its configuration, and a body of 25 links of 100 g on a pole with its joints."""
    rows = [row.split() for row in POPPY.split(";")]
    motors = {
        name: {
            "id": int(identity),
            "type": model,
            "offset": float(offset),
            "orientation": "direct" if sense == "+" else "indirect",
            "angle_limit": [float(low), float(high)],
        }
        for name, model, identity, offset, sense, low, high in rows
    }
    ports = {"controllers": {"upper": {}, "lower": {}}, "motorgroups": {}, "motors": motors}
    (folder / "poppy.json").write_text(json.dumps(ports))
    servo_map = replace(read_foreign(folder / "poppy.json"), limits=QUICK)
    bodies, axes = "", {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    for k, servo in enumerate(servo_map.servos):
        joint = f'name="{servo.joint}" axis="{axes[servo.joint[-1]]}" range="{servo.lower} {servo.upper}"'
        bodies += (
            f'<body pos="0 {k} 1"><joint {joint}/><geom type="capsule" size=".02 .05" pos="0 0 -.05" mass=".1"/></body>'
        )
    model = f'<mujoco model="poppy"><compiler angle="radian"/><worldbody>{bodies}</worldbody></mujoco>'
    (folder / "poppy.xml").write_text(model)
    (folder / "poppy.toml").write_text(dump_map(servo_map))
    return servo_map, folder / "poppy.xml"


def test_poppy_s_public_map_plays_as_judged(tmp_path: Path) -> None:
    servo_map, model = poppy(tmp_path)
    assert [s.joint for s in servo_map.servos if s.range_exceeds_turn] == []
    assert servo_map["r_knee_y"].upper == servo_map["l_knee_y"].upper == pytest.approx(np.radians(134)), (
        "both bend alike"
    )
    robot = rr.load_robot(model, servos=tmp_path / "poppy.toml")
    lower, upper = np.array([(servo_map[j].lower, servo_map[j].upper) for j in robot.joint_names]).T
    swing = np.sin(2 * np.pi * 0.5 * np.arange(31)[:, None] / 30 + np.arange(25))
    angles = (lower + upper) / 2 + 0.2 * (upper - lower) * swing
    trajectory = rr.Trajectory(angles, 30.0, robot.joint_names, robot.name)
    report = rr.simulate(trajectory, robot, mode="pinned", draws=0, others=False)
    assert report.trajectory is not None and report.trajectory.goals is not None
    plan, goals = goal_plan(report.trajectory, servo_map), report.trajectory.goals
    options = ("--physics", "--model", str(model), "--lockstep", str(plan.rate))
    with emulated(tmp_path, servo_map, *options) as emulator:
        outcome = play(plan, servo_map, emulator.port, PlaybackOptions(lockstep=True), tmp_path / "play.npz")
    assert outcome.ended is PlaybackEnd.FINISHED, outcome.reason
    with np.load(tmp_path / "play.npz") as log:
        playing = log["phase"] == list(log["phases"]).index("play")
        order = [list(log["joint_names"]).index(joint) for joint in robot.joint_names]
        present = log["present"][playing][:, order]
    seen = np.stack([np.interp(report.series["time"], goals.times, column) for column in present.T], axis=1)
    off = np.sqrt(((seen - report.series["measured"]) ** 2).mean(axis=0))
    steps = np.array([1 / abs(servo_map[joint].scale) for joint in robot.joint_names])
    print("largest [°]", np.degrees(off).max(), np.degrees(off - steps).max())
    assert np.degrees(off - steps).max() < 0.3


PAGE = ROOT / "docs" / "how-to" / "my-servo.md"
UNLISTED = """
from pathlib import Path
import numpy as np
from robot_retarget.actuators.map import Servo, ServoMap
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.outcome import PlaybackOptions
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import emulator_process, play
own = ServoMap("own", (Servo("j1", 1, NAME, lower=-1.0, upper=1.0),))
with emulator_process(own, "--lockstep", "50") as port:
    with Bus(port, own.baud, lockstep=True) as bus:
        assert [number for _, number, _ in bus.scan(range(3))] == [NUMBER]
    plan = ServoPlan(0.3 * np.sin(np.linspace(0, 6, 100))[:, None], 50.0)
    print(play(plan, own, port, PlaybackOptions(lockstep=True)).exit_code)
"""


def test_the_row_of_the_page_makes_an_unlisted_servo_play(tmp_path: Path) -> None:
    row = PAGE.read_text(encoding="utf-8").split("```csv\n")[1].split("\n")[0]
    name, number = row.split(",")[:2]
    with pytest.raises(ServoError, match=f"no servo model '{name}'"):
        model_named(name)
    package = tmp_path / "robot_retarget"
    package.mkdir()
    for part in (ROOT / "robot_retarget").iterdir():
        if part.name != "actuators":
            (package / part.name).symlink_to(part)
    shutil.copytree(ROOT / "robot_retarget" / "actuators", package / "actuators")
    with (package / "actuators" / "servos.csv").open("a") as table:
        table.write(row + "\n")
    code = UNLISTED.replace("NAME", repr(name)).replace("NUMBER", number)
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout.strip() == "0", done.stderr
