"""Poses that come live move the servos softly: approach, follow, rest in silence, return; never beyond a limit."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emulated import ARM, QUICK, Emulated, emulated
from hypothesis import given
from hypothesis import strategies as st

from robot_retarget.actuators.map import Limits
from robot_retarget.base.arrays import Floats
from robot_retarget.servo.cycle import Guard
from robot_retarget.servo.link import JointScale
from robot_retarget.servo.live import LONGEST_BLEND, SILENCE, Approach, TargetFollower, TargetStream, follow
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions, PlaybackOutcome

RATE = 125.0
PATIENT = replace(QUICK, watchdog=2.0, silence=1.0)
"""A busy machine pauses for tenths of a second."""


@given(st.lists(st.tuples(st.floats(1e-3, 0.3), st.floats(-2, 2)), min_size=2, max_size=20))
def test_wishes_are_joined_without_a_jump(given_: list[tuple[float, float]]) -> None:
    targets, now, path = TargetStream(), 100.0, []
    for wait, angle in given_:
        before = targets.at(now)
        targets.set_target(np.array([angle]), now)
        if before is not None:
            assert targets.at(now) == pytest.approx(before, abs=1e-12)
        path.append(targets.at(now + LONGEST_BLEND))
        now += wait
    assert [float(p[0]) for p in path if p is not None] == pytest.approx([angle for _, angle in given_])


def test_a_wish_that_is_no_number_is_none() -> None:
    targets = TargetStream()
    targets.set_target(np.array([np.nan]), 1.0)
    assert targets.at(1.0) is None
    targets.set_target(np.array([0.5]), 2.0)
    targets.set_target(np.array([np.inf]), 3.0)
    assert targets.at(4.0) == pytest.approx([0.5])


def test_an_approach_ends_on_a_wish_that_moves_and_is_no_faster_than_it_may_be() -> None:
    limits, period = Limits(), 1 / RATE
    approach = Approach(np.array([-1.0]), np.array([0.5]), 10.0, limits)
    moving = lambda now: np.array([0.5 + 0.1 * np.sin(now)])  # noqa: E731
    times = 10 + np.arange(0, approach.duration + 2 * period, period)
    path = np.array([approach.at(moving(now), now) for now in times])
    assert path[0] == pytest.approx([-1.0]) and path[-1] == pytest.approx(moving(times[-1]))
    assert np.abs(np.diff(path, axis=0)).max() / period <= limits.approach_speed * 1.15 + 0.1


@contextmanager
def giving(targets: TargetStream, pose: Callable[[float], Floats | None], seconds: float) -> Iterator[None]:
    """Sixty targets a second for so long; where the pose is None there is none."""

    def put() -> None:
        began = time.monotonic()
        while (now := time.monotonic() - began) < seconds:
            target = pose(now)
            if target is not None:
                targets.set_target(target)
            time.sleep(1 / 60)
        targets.over.set()

    thread = threading.Thread(target=put, daemon=True)
    thread.start()
    yield
    thread.join()


def followed(
    folder: Path, arm: Emulated, pose: Callable[[float], Floats | None], seconds: float, limits: Limits = PATIENT
) -> tuple[PlaybackOutcome, dict[str, np.ndarray]]:
    """What became of it, and its log."""
    targets = TargetStream()
    with giving(targets, pose, seconds):
        outcome = follow(
            targets, replace(ARM, limits=limits), arm.port, PlaybackOptions(end_pose=False), log=folder / "log.npz"
        )
    with np.load(folder / "log.npz") as log:
        return outcome, dict(log)


def require_gentle(log: dict[str, np.ndarray], limits: Limits) -> None:
    """No goal outside a range, faster than it may be or too far from its joint."""
    goal, present = log["goal"], log["present"]
    assert (np.abs(goal) <= 1.5 + 1e-9).all()
    ahead = np.abs(goal[1:] - present[:-1]).max()
    assert ahead <= limits.jump + 1e-9
    assert np.abs(np.diff(goal, axis=0)).max() <= limits.speed / RATE + 1e-9


def swinging(now: float) -> Floats:
    return np.array([0.4, -0.3, 0.2, 0.1]) + 0.3 * np.sin(2 * now)


def test_the_arm_approaches_follows_and_is_left_holding(tmp_path: Path) -> None:
    with emulated(tmp_path) as arm:
        outcome, log = followed(tmp_path, arm, swinging, 2.0)
        assert all(servo["torque_enable"] for servo in arm.servos().values())
    assert outcome.ended is PlaybackEnd.FINISHED and outcome.state == "hold"
    phases = [str(log["phases"][k]) for k in log["phase"]]
    assert phases.index("approach") < phases.index("play") and phases.count("play") > 100
    require_gentle(log, QUICK)
    played = np.array(phases) == "play"
    assert np.abs(log["goal"][played] - log["plan"][played]).max() < 1e-6, "nothing was held back"


def test_another_thread_may_follow_and_the_readings_are_those_of_the_log(tmp_path: Path) -> None:
    targets, ended = TargetStream(), []
    options, log = PlaybackOptions(end_pose=False), tmp_path / "log.npz"
    with emulated(tmp_path) as arm:
        thread = threading.Thread(
            target=lambda: ended.append(follow(targets, replace(ARM, limits=PATIENT), arm.port, options, log=log))
        )
        thread.start()
        with giving(targets, swinging, 1.5):
            thread.join(1.0)
            read = targets.present
        thread.join()
    assert ended[0].ended is PlaybackEnd.FINISHED
    with np.load(log) as found:
        assert read is not None and (np.abs(found["present"] - read).max(axis=1) == 0).any()


def test_in_silence_the_goals_rest_and_the_return_is_approached(tmp_path: Path) -> None:
    silent = lambda now: None if 0.8 < now < 0.8 + SILENCE + 0.4 else swinging(now)  # noqa: E731
    with emulated(tmp_path) as arm:
        outcome, log = followed(tmp_path, arm, silent, 3.0)
    assert outcome.ended is PlaybackEnd.FINISHED
    phases = np.array([str(log["phases"][k]) for k in log["phase"]])
    changes = phases[np.flatnonzero(phases[1:] != phases[:-1]) + 1].tolist()
    assert changes[-4:] == ["play", "hold", "approach", "play"]
    still = log["goal"][phases == "hold"][-20:]
    assert np.ptp(still, axis=0).max() == 0
    require_gentle(log, QUICK)


def test_a_wish_that_jumps_or_leaves_every_range_is_approached_and_clamped(tmp_path: Path) -> None:
    jumping = lambda now: swinging(now) + (2.5 if 0.8 < now < 3.0 else 0.0)  # noqa: E731
    with emulated(tmp_path) as arm:
        outcome, log = followed(tmp_path, arm, jumping, 4.0)
    assert outcome.ended is PlaybackEnd.FINISHED
    assert log["plan"].max() > 2 and log["goal"].max() <= 1.5 + 1e-9
    require_gentle(log, QUICK)


@pytest.mark.parametrize("silence", [0.1, 1.0, 10.0])
def test_after_a_silence_of_any_length_no_goal_jumps(silence: float) -> None:
    guard, targets, said = Guard(JointScale(ARM), QUICK, np.zeros(4)), TargetStream(), []
    follower = TargetFollower(targets, guard, QUICK, said.append)
    now, goals, phases = 50.0, [], []

    def go(seconds: float, pose: Callable[[float], Floats] | None) -> None:
        nonlocal now
        for k in range(round(seconds * RATE)):
            now += 1 / RATE
            if pose is not None and k % 2 == 0:
                targets.set_target(pose(now), now)
            step = follower.step(now)
            assert step is not None
            goal = guard.aim(step.target, 1 / RATE)
            guard.record(goal, step.target, goal, 1 / RATE)
            goals.append(goal)
            phases.append(step.phase)

    go(2.0, swinging)
    go(silence, None)
    go(3.0, lambda now: swinging(now) + 0.5)
    assert len(said) == (1 if silence < SILENCE else 2)
    assert np.abs(np.diff(goals, axis=0)).max() <= QUICK.speed / RATE + 1e-9
    after = np.array(goals[round((2 + silence) * RATE) :])
    if silence > SILENCE:
        assert phases[-1] == "play" and "hold" in phases
        assert np.abs(np.diff(after, axis=0)).max() * RATE <= QUICK.approach_speed + 0.7, "the swing itself takes 0.6"


def test_a_thread_that_stalls_for_good_leaves_the_robot_under_watch_until_somebody_asks(tmp_path: Path) -> None:
    with emulated(tmp_path) as arm:
        targets = TargetStream()
        targets.set_target(np.zeros(4))
        threading.Timer(1.5, lambda: signal.raise_signal(signal.SIGINT)).start()
        outcome = follow(
            targets,
            replace(ARM, limits=PATIENT),
            arm.port,
            PlaybackOptions(end_pose=False, grace=0.1),
            log=tmp_path / "log.npz",
        )
        assert all(servo["torque_enable"] for servo in arm.servos().values())
    assert outcome.ended is PlaybackEnd.INTERRUPTED and outcome.state == "hold"
    with np.load(tmp_path / "log.npz") as log:
        assert len(log["time"]) > 0.5 * RATE and log["age"].max() < PATIENT.silence


def test_ctrl_c_leads_a_stream_into_its_stand_as_gently_as_it_began(tmp_path: Path) -> None:
    stand = np.array([0.1, -0.1, 0.2, 0.0])
    with emulated(tmp_path) as arm:
        targets = TargetStream()
        with giving(targets, swinging, 3.0):
            threading.Timer(1.5, lambda: signal.raise_signal(signal.SIGINT)).start()
            outcome = follow(
                targets,
                replace(ARM, limits=PATIENT),
                arm.port,
                PlaybackOptions(),
                log=tmp_path / "log.npz",
                stand=stand,
            )
    assert (outcome.ended, outcome.reason, outcome.state) == (PlaybackEnd.INTERRUPTED, "interrupted, standing", "hold")
    with np.load(tmp_path / "log.npz") as log:
        require_gentle(log, QUICK)
        np.testing.assert_allclose(log["goal"][-1], stand, atol=2e-3)


def test_a_servo_that_falls_silent_stops_it_as_in_any_playback(tmp_path: Path) -> None:
    with emulated(tmp_path, ARM, "--fault", "after 1.2 silent 3") as arm:
        outcome, _ = followed(tmp_path, arm, swinging, 4.0)
    assert outcome.ended is PlaybackEnd.FAULT and "j3" in outcome.reason


def test_the_log_of_hours_holds_the_end(tmp_path: Path) -> None:
    from robot_retarget.servo.outcome import Record

    record = Record(("a",), most=10)
    for k in range(100):
        row = np.full(1, float(k))
        record.add(
            time=k, phase=1, busy=0.0, late=0.0, goal=row, plan=row, motion=row, present=row, velocity=row, current=row, age=row,
            error=row, voltage=row, temperature=row,
        )  # fmt: skip
    assert record.column("goal")[:, 0].tolist() == list(range(90, 100))
