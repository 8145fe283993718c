"""Goals on the wire are ticks in range and near the shafts, for any input and after any fault."""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from emulated import ARM, Emulated, emulated
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from shared_files import ROOT

from robot_retarget.actuators.control_tables import XM430_W350
from robot_retarget.actuators.map import TICKS_PER_RADIAN, ServoMap
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.check import require_fit
from robot_retarget.servo.cycle import Cycle, Judge, Step
from robot_retarget.servo.link import Gate, JointScale, Link
from robot_retarget.servo.outcome import FaultError, Record
from robot_retarget.servo.performance import leave_holding, take_hold

BAD = [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e308, 5e-324]
ANGLES = st.floats(-9, 9) | st.sampled_from(BAD)
WISHES = arrays(float, (3, 4), elements=ANGLES)
BROKEN = st.sampled_from([np.nan, np.inf, -4.0, 0.0, 1e300])


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Emulated, Link]]:
    """A held arm."""
    with emulated(tmp_path_factory.mktemp("bus")) as emulator, Bus(emulator.port, ARM.baud) as bus:
        link = Link(bus, ARM, require_fit(bus, ARM)[0])
        link.fast = False
        take_hold(link, Judge(link))
        yield emulator, link


def require_harmless(emulator: Emulated, servo_map: ServoMap = ARM) -> None:
    """By what the servos themselves have seen."""
    seen = emulator.servos()
    for servo in servo_map.servos:
        low, high = servo.tick_range
        assert low <= seen[servo.id]["lowest_goal"] and seen[servo.id]["highest_goal"] <= high
        assert seen[servo.id]["largest_step"] <= servo_map.limits.jump * TICKS_PER_RADIAN * servo.gear + 1


@settings(max_examples=60, deadline=None)
@given(WISHES)
def test_goals_of_any_value_are_refused_or_harmless(running: tuple[Emulated, Link], wishes: np.ndarray) -> None:
    emulator, link = running
    for wish in wishes:
        link.read()
        try:
            link.exchange(link.goals(wish))
            link.listen(0.02)
        except FaultError as error:
            assert "not sent" in str(error)
        else:
            assert np.isfinite(wish).all()
        link.command(wish)
    require_harmless(emulator)


@settings(max_examples=40, deadline=None)
@given(WISHES, BROKEN, BROKEN, st.floats(0.001, 0.1))
def test_limits_that_went_wrong_after_all_send_nothing_wrong(
    running: tuple[Emulated, Link], wishes: np.ndarray, speed: float, jump: float, dt: float
) -> None:
    """A guard whose limits are no numbers, or negative, as no map that was read can have them."""
    emulator, link = running
    judge, record = Judge(link), Record(ARM.joints)
    guard = take_hold(link, judge)
    limits: Any = replace(ARM.limits)
    for name, value in (("speed", speed), ("jump", jump)):
        object.__setattr__(limits, name, value)
    guard.limits = limits
    cycle = Cycle(link, guard, judge, record, 0.0)
    try:
        for wish in wishes:
            cycle.tick(Step(wish, "play", wish), dt, 0.0)
    except FaultError:
        leave_holding(link, guard.goal)
    require_harmless(emulator)


@given(st.one_of(st.floats(), st.sampled_from([*BAD, "12", None, 4096.0, 1 << 40, -(1 << 40)])))
def test_a_register_takes_whole_numbers_of_its_range_only(value: Any) -> None:
    """Bytes are refused before they are made; an integer in a float's clothes is none."""
    with pytest.raises(ServoError, match="no value of the register"):
        XM430_W350["goal_position"].checked(value)


def test_goals_leave_through_the_link_and_its_gate_alone() -> None:
    senders = {
        path.name
        for folder in ("actuators", "servo")
        for path in (ROOT / "robot_retarget" / folder).glob("*.py")
        if re.search(r'"goal_position"|layout\.goal\b', path.read_text(encoding="utf-8"))
    }
    assert senders == {"link.py", "control_tables.py"}, "and the table, which names the register"


@pytest.mark.parametrize("end", ["low", "high"])
def test_goals_at_both_ends_of_a_range_pass_and_a_tick_beyond_does_not(end: str) -> None:
    scale = JointScale(ARM)
    gate, edge = Gate(ARM, scale), getattr(scale, end)
    beyond = edge + (1 if end == "high" else -1)
    assert gate.allowed(edge, edge).all() and not gate.allowed(beyond, edge).any()
