"""The fault matrix: whatever goes wrong, whenever, no goal leaves the limits, and the end is the right one.

Every case plays against an emulator process over a pseudo terminal, whose time goes by ticks: a busy machine changes nothing.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emulated import ARM, QUICK, Emulated, emulated
from shared_files import ROOT

from robot_retarget.actuators.map import TICKS_PER_RADIAN, dump_map, load_map
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.check import require_fit
from robot_retarget.servo.cycle import Judge
from robot_retarget.servo.link import JointScale, Link
from robot_retarget.servo.outcome import COLUMNS, PHASES, PlaybackEnd, PlaybackOptions, PlaybackOutcome, Record
from robot_retarget.servo.performance import take_hold
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import play

START = (0.2, -0.3, 0.1, 0.4)
RATE = 200.0
TIME = np.arange(0, 0.201, 0.01)[:, None]
PLAN = ServoPlan(np.array(START) + 0.3 * np.sin(2 * np.pi * 1.5 * TIME) * np.array([1, -1, 1, 1]), 100.0).resampled(
    RATE
)
PHASE = {"approach": "approaching", "play": "playing", "end": "going"}
OPTIONS = PlaybackOptions(grace=0.15, lockstep=True)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    with emulated(tmp_path_factory.mktemp("bus"), ARM, "--lockstep", f"{RATE:g}") as emulator:
        yield emulator


@pytest.fixture
def emulator(running: Emulated) -> Emulated:
    """A bus as new, the arm near its first frame."""
    running.do("reset")
    running.spread(ARM, START)
    return running


STOPPED = {
    "silent 2": r"j2 \(servo 2\) no longer answers",
    "silent all": "no servo answers any more",
    "supply 9.7": r"supply is 9\.\d V",
    "supply 9": r"hardware error: input voltage|supply is 9\.0 V",
    "heat 2 75": r"j2 \(servo 2\) is 75 °C hot",
    "overload 2": r"j2 \(servo 2\): hardware error: overload",
    "shock 3": r"j3 \(servo 3\): hardware error: electrical shock",
    "limp 2": r"torque is off on j2 \(servo 2\): restarted",
}
ENDURED = ("corrupt 0.05", "corrupt 0.2", "drop 0.2", "noise 0.3", "delay 1")


PROMPT = 0.15
"""From a fault to the state in which it leaves the servos [s]."""


def perform(emulator: Emulated, folder: Path, phase: str, act: Any) -> PlaybackOutcome:
    """Play, and do something as a phase begins."""

    def say(text: str) -> None:
        if text.startswith(PHASE[phase]):
            act()

    return play(PLAN, ARM, emulator.port, OPTIONS, folder / "play.npz", say)


def settling(emulator: Emulated, but: frozenset[int] = frozenset()) -> float:
    """From the last fault until no servo was written to any more or its watchdog stopped it, by the bus' clock [s]."""
    seen = emulator.do("state")
    return max(servo["settled"] for k, servo in seen["servos"].items() if int(k) not in but) - seen["struck"]


def require_harmless(emulator: Emulated, folder: Path) -> None:
    """No goal outside the limits, no step over the cap, a log of every tick."""
    cap = ARM.limits.jump * TICKS_PER_RADIAN + 1
    for servo in ARM.servos:
        seen = emulator.servos()[servo.id]
        low, high = servo.tick_range
        if seen["goals"]:
            assert low <= seen["lowest_goal"] and seen["highest_goal"] <= high
        assert seen["largest_step"] <= cap
    with np.load(folder / "play.npz") as log:
        assert {"time", "goal", "present", "current", "error", "late", "events"} <= set(log.files)
        assert len({len(log[name]) for name in ("time", "goal", "plan", "present", "current", "age", "error")}) == 1
        assert len(log["events"]) == 1
        assert np.isfinite(log["goal"]).all()


@pytest.mark.parametrize("phase", PHASE)
@pytest.mark.parametrize("fault", STOPPED)
def test_a_fault_on_the_way_stops_with_everybody_holding(
    emulator: Emulated, tmp_path: Path, fault: str, phase: str
) -> None:
    outcome = perform(emulator, tmp_path, phase, lambda: emulator.do(fault))
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.FAULT, "hold", 1)
    assert_match(STOPPED[fault], outcome.reason)
    assert settling(emulator) < PROMPT
    require_harmless(emulator, tmp_path)
    if fault != "silent all":
        dead = {2, 3} if fault.split()[0] in ("overload", "shock", "limp") else set()
        assert all(s["torque_enable"] for k, s in emulator.servos().items() if k not in dead)
        emulator.do("wait 0.3")
        free = {k for k, s in emulator.servos().items() if s["bus_watchdog"] == 0}
        assert free >= ({1, 2, 3, 4} - ({2} if fault == "silent 2" else set()))


@pytest.mark.parametrize("fault", ["limp all", "reset"])
def test_servos_that_lose_torque_on_the_way_stop_the_motion_and_are_called_limp(
    emulator: Emulated, tmp_path: Path, fault: str
) -> None:
    outcome = perform(emulator, tmp_path, "play", lambda: emulator.do(fault))
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.FAULT, "limp", 1)
    assert_match(r"torque is off on j1 .*, j2 .*, j3 .*, j4 \(servo 4\)", outcome.reason)
    assert settling(emulator) < PROMPT
    require_harmless(emulator, tmp_path)


RAMP = ServoPlan(np.array(START) + np.linspace(0, 1, 201)[:, None] * np.array([0.8, 0.8, -0.8, -0.8]), RATE)


def test_a_joint_that_stays_at_its_step_cap_stops_the_motion(emulator: Emulated, tmp_path: Path) -> None:
    patient = replace(ARM, limits=replace(QUICK, current=5.0))  # else the current stops it first

    def say(text: str) -> None:
        if text.startswith("playing"):
            emulator.do("jam 2")

    outcome = play(RAMP, patient, emulator.port, OPTIONS, tmp_path / "play.npz", say)
    assert (outcome.ended, outcome.state) == (PlaybackEnd.FAULT, "hold")
    assert_match(r"j2 \(servo 2\) does not follow: 0\.5 rad from its goal for 0\.3 s", outcome.reason)
    with np.load(tmp_path / "play.npz") as log:
        capped = np.abs(log["plan"] - log["present"])[:, 1] > ARM.limits.jump
        assert 0.29 < log["time"][-1] - log["time"][capped.argmax()] < 0.35
    require_harmless(emulator, tmp_path)


def test_when_one_servo_goes_and_then_the_rest_nobody_is_blamed(emulator: Emulated, tmp_path: Path) -> None:
    def act() -> None:
        emulator.do("silent 1")
        emulator.do(f"after {emulator.do('state')['time'] + 0.04} silent all")

    assert_match(STOPPED["silent all"], perform(emulator, tmp_path, "play", act).reason)


@pytest.mark.parametrize("phase", PHASE)
@pytest.mark.parametrize("fault", ENDURED)
def test_a_bad_cable_is_lived_through(emulator: Emulated, tmp_path: Path, fault: str, phase: str) -> None:
    outcome = perform(emulator, tmp_path, phase, lambda: emulator.do(fault))
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.FINISHED, "hold", 0), outcome.reason
    require_harmless(emulator, tmp_path)


@pytest.mark.parametrize("phase", PHASE)
def test_a_pulled_cable_leaves_the_servos_to_their_watchdog(emulator: Emulated, tmp_path: Path, phase: str) -> None:
    outcome = perform(emulator, tmp_path, phase, lambda: emulator.do("unplug"))
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.LOST, "watchdog", 1)
    assert "is gone" in outcome.reason
    emulator.do("wait 0.3")
    assert all(s["bus_watchdog"] == -1 for s in emulator.servos().values())
    require_harmless(emulator, tmp_path)
    emulator.do("plug")
    again = play(PLAN, ARM, emulator.port, OPTIONS, tmp_path / "play.npz")
    assert again.ended is PlaybackEnd.FINISHED
    require_harmless(emulator, tmp_path)


@pytest.mark.parametrize("phase", PHASE)
@pytest.mark.parametrize(("signals", "state"), [((2,), "hold"), ((15,), "hold"), ((2, 2), "release")])
def test_one_ctrl_c_holds_and_a_second_lets_go(
    emulator: Emulated, tmp_path: Path, phase: str, signals: Any, state: str
) -> None:
    asked: list[int] = []

    def say(text: str) -> None:
        if text.startswith("holding" if asked else PHASE[phase]) and len(asked) < len(signals):
            asked.append(signals[len(asked)])
            os.kill(os.getpid(), asked[-1])

    outcome = play(PLAN, ARM, emulator.port, OPTIONS, tmp_path / "play.npz", say)
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.INTERRUPTED, state, 1)
    assert all(s["torque_enable"] == (state == "hold") for s in emulator.servos().values())
    assert all(s["bus_watchdog"] == 0 for s in emulator.servos().values())
    with np.load(tmp_path / "play.npz") as log:
        names = log["phases"][log["phase"]]
        assert np.count_nonzero(names == phase) == 1, "the tick at which it was asked"
        held, grace = np.count_nonzero(names == "hold"), RATE * OPTIONS.grace
        assert held in (grace, grace + 1) if signals == (2,) else held == 0, "to the tick"
    require_harmless(emulator, tmp_path)


REFUSED = {
    "silent 3": "j3 .* does not answer",
    "silent all": "j1 .* does not answer.*j4 .* does not answer",
    "model 2 1060": "j2 .* is a XL430-W250, the map says XM430-W350",
    "supply 9.2": "supply is 9.2 V, allowed 10",
    "heat 4 72": "j4 .* is 72 °C hot, 70 at most",
    "overload 1": "j1 .* hardware error: overload",
    "place 1 4000": "j1 .* stands at .* outside .* turn it by hand",
    "duplicate 2 3": "j2 .*two servos share|j3 .* does not answer",
}


@pytest.mark.parametrize("fault", REFUSED)
def test_a_robot_that_is_not_fit_is_not_moved(emulator: Emulated, tmp_path: Path, fault: str) -> None:
    emulator.do(fault)
    before = emulator.servos()
    with pytest.raises(ServoError, match=REFUSED[fault]):
        play(PLAN, ARM, emulator.port, OPTIONS, tmp_path / "play.npz")
    after = emulator.servos()
    assert all(after[k]["goals"] == before[k]["goals"] and not after[k]["torque_enable"] for k in after)


@pytest.mark.parametrize("fault", [*ENDURED, "torque 2", "far away"])
def test_what_can_be_lived_with_before_the_start_is(emulator: Emulated, tmp_path: Path, fault: str) -> None:
    emulator.spread(ARM, (1.4, -1.4, -1.4, 1.4) if fault == "far away" else START)
    if fault != "far away":
        emulator.do(fault)
    before = emulator.servos()[2]
    outcome = play(PLAN, ARM, emulator.port, OPTIONS, tmp_path / "play.npz")
    assert outcome.ended is PlaybackEnd.FINISHED, outcome.reason
    if fault == "torque 2":
        assert before["torque_enable"]
        return
    require_harmless(emulator, tmp_path)


def test_ticks_too_slow_for_the_watchdog_are_refused(emulator: Emulated) -> None:
    with pytest.raises(ServoError, match=r"12 ticks a second do not feed a watchdog of 0\.1 s; 20 do"):
        play(PLAN.resampled(12.0), ARM, emulator.port, OPTIONS)
    assert not any(servo["torque_enable"] for servo in emulator.servos().values())


@pytest.mark.parametrize("fault", ["heat 17 75", "silent 20", "supply 9.7"])
def test_a_fault_of_one_of_twenty_servos_stops_all_as_soon_at_any_rate(tmp_path: Path, fault: str) -> None:
    swing = ServoPlan(0.1 * np.sin(3 * TIME) * np.ones(20), 20.0)
    with emulated(tmp_path, "op3", "--lockstep", "20") as twenty:

        def say(text: str) -> None:
            if text.startswith("playing"):
                twenty.do(f"after {twenty.do('state')['time'] + 0.3} {fault}")

        outcome = play(swing, replace(load_map("op3"), limits=QUICK), twenty.port, OPTIONS, say=say)
        assert (outcome.ended, outcome.state) == (PlaybackEnd.FAULT, "hold")
        assert settling(twenty) <= PROMPT + 1e-9


def test_a_port_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(ServoError, match=r"cannot open .*tty"):
        play(PLAN, ARM, tmp_path / "tty", OPTIONS)


@pytest.mark.parametrize("phase", ["approach", "play"])
def test_when_the_player_is_killed_the_servos_stop_by_themselves(
    emulator: Emulated, tmp_path: Path, phase: str
) -> None:
    (tmp_path / "arm.toml").write_text(dump_map(ARM), encoding="utf-8")
    code = (
        "import sys; sys.path.insert(0, 'tests/servo'); sys.path.insert(0, 'tests')\n"
        "from test_servo_play import *\n"
        "add = Record.add\n"
        "def watched(self, **row):\n"
        "    add(self, **row)\n"
        f"    if list(self.column('phase')).count({PHASES.index(phase)}) == 9: os.kill(os.getpid(), signal.SIGKILL)\n"
        "Record.add = watched\n"
        f"play(PLAN, ARM, {emulator.port!r}, OPTIONS, {str(tmp_path / 'play.npz')!r})"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == -signal.SIGKILL
    emulator.do("wait 0.3")
    assert all(s["bus_watchdog"] == -1 and s["torque_enable"] for s in emulator.servos().values())
    left = np.load(tmp_path / "play.part.npy")
    assert left.dtype["goal"].shape == (4,) and (np.diff(left["time"]) > 0).all()
    assert np.count_nonzero(left["phase"] == PHASES.index(phase)) == 9
    seen = {s.id: s.radians(emulator.servos()[s.id]["goal_position"]) for s in ARM.servos}
    assert left["goal"][-1] == pytest.approx([seen[s.id] for s in ARM.servos], abs=0.02), "the last tick is in it"


def test_a_saved_log_leaves_no_rows_behind_and_the_rows_are_those_of_the_log(tmp_path: Path) -> None:
    record = Record(("a",), most=3)
    row = dict.fromkeys((*COLUMNS, "voltage", "temperature"), np.zeros(1))
    with record.kept(tmp_path / "play.npz"):
        for k in range(5):
            record.add(**row, time=float(k), phase=1, busy=0.0, late=0.0)
        rows = np.load(tmp_path / "play.part.npy")
    assert sorted(rows["time"]) == [2, 3, 4]
    with np.load(tmp_path / "play.npz") as log:
        assert log["time"].tolist() == [2, 3, 4]
    assert [path.name for path in tmp_path.iterdir()] == ["play.npz"]


def test_taking_hold_moves_nothing_from_250_random_poses(emulator: Emulated) -> None:
    """The largest step at torque on is at most what the cap allows; here it is a tick of rounding."""
    rng = np.random.default_rng(5)
    scale = JointScale(ARM)
    with Bus(emulator.port, ARM.baud, lockstep=True) as bus:
        link = Link(bus, ARM, require_fit(bus, ARM)[0])
        for _ in range(250):
            emulator.spread(ARM, rng.uniform(scale.lower + 0.01, scale.upper - 0.01).tolist())
            take_hold(link, Judge(link))
            link.set_all("torque_enable", 0)
        seen = emulator.servos()
    assert max(s["largest_step"] for s in seen.values()) <= 2


def test_taking_hold_writes_the_gains_of_the_map(emulator: Emulated) -> None:
    chosen = replace(ARM, servos=(*ARM.servos[:-1], replace(ARM.servos[-1], p_gain=1234)))
    with Bus(emulator.port, ARM.baud, lockstep=True) as bus:
        link = Link(bus, chosen, require_fit(bus, chosen)[0])
        take_hold(link, Judge(link))
        found = [bus.value(servo.id, servo.type.registers["position_p_gain"]) for servo in ARM.servos]
    assert found == [*(servo.type.motor.p_gain for servo in ARM.servos[:-1]), 1234]


def assert_match(pattern: str, text: str) -> None:
    with pytest.raises(ServoError, match=pattern):
        raise ServoError(text)
