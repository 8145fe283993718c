"""A playback that is asked to stop goes on to the next branch, takes it and ends in its stand."""

import json
import os
import pty
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from emulated import ARM, Emulated, emulated
from typer.testing import CliRunner

from robot_retarget.actuators.goals import Goals
from robot_retarget.base.errors import ServoError, UsageError
from robot_retarget.base.untrusted.documents import sealed
from robot_retarget.servo.host import Interrupts
from robot_retarget.servo.judgement import Piece, Playlist, judged_ways, read_playlist, require_same_stands
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions, PlaybackOutcome
from robot_retarget.servo.plan import Course, ServoPlan, goal_plan, parting
from robot_retarget.servo.play import play
from robot_retarget.tools.cli import app
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory

RATE = 100.0
START = np.array([0.2, -0.3, 0.1, 0.4])
STAND = np.zeros(4)
ROWS = np.arange(201)[:, None] / RATE
PLAN = ServoPlan(START + 0.3 * np.sin(2 * np.pi * 0.5 * ROWS), RATE)
OPTIONS = PlaybackOptions(grace=0.1)


def way(row: int) -> ServoPlan:
    """The plan up to a row, then straight to the stand within half a second."""
    share = np.linspace(0, 1, 51)[1:, None]
    here = PLAN.angles[row - 1]
    return ServoPlan(np.concatenate([PLAN.angles[:row], here + share * (STAND - here)]), RATE)


WAYS = [way(row) for row in (60, 120)]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    with emulated(tmp_path_factory.mktemp("bus")) as emulator:
        yield emulator


def played(emulator: Emulated, folder: Path, stops: tuple[float, ...], ways: list[ServoPlan]) -> PlaybackOutcome:
    """Play, with a Ctrl-C at times of the playback [s]."""
    emulator.do("reset")
    emulator.spread(ARM, START.tolist())

    def say(text: str) -> None:
        if text.startswith("playing"):
            for time in stops:
                threading.Timer(time, signal.raise_signal, [signal.SIGINT]).start()

    return play([Piece(PLAN, ways)], ARM, emulator.port, OPTIONS, folder / "play.npz", say)


def rows_played(folder: Path) -> np.ndarray:
    """(N, n) targets of the phase `play`."""
    with np.load(folder / "play.npz") as log:
        return log["plan"][log["phase"] == list(log["phases"]).index("play")]


@pytest.mark.parametrize(("time", "row"), [(0.3, 60), (0.8, 120)])
def test_ctrl_c_takes_the_next_branch_and_ends_in_its_stand(
    running: Emulated, tmp_path: Path, time: float, row: int
) -> None:
    outcome = played(running, tmp_path, (time,), WAYS)
    assert (outcome.ended, outcome.state, outcome.reason) == (PlaybackEnd.INTERRUPTED, "hold", "interrupted, standing")
    made, planned = rows_played(tmp_path), way(row).angles
    np.testing.assert_allclose(made[-1], STAND, atol=1e-9)
    nearest = np.abs(made[:, None] - planned[None]).max(axis=2).min(axis=1)
    assert nearest.max() < 1e-9, "every goal is one of the branch"
    assert np.abs(np.diff(made, axis=0)).max() < 5 * np.abs(np.diff(planned, axis=0)).max()


def test_a_hot_servo_leads_into_a_stand_and_a_dead_one_holds_at_once(running: Emulated, tmp_path: Path) -> None:
    for fault, reason in (("heat 2 75", "j2 (servo 2) is 75 °C hot; standing"), ("limp 2", "torque is off on j2 ")):
        running.do("reset")
        running.spread(ARM, START.tolist())

        def say(text: str, fault: str = fault) -> None:
            if text.startswith("playing"):
                running.do(fault)

        outcome = play([Piece(PLAN, WAYS)], ARM, running.port, OPTIONS, tmp_path / "play.npz", say)
        assert outcome.ended is PlaybackEnd.FAULT and outcome.reason.startswith(reason)
        stands = np.abs(rows_played(tmp_path)[-1] - STAND).max() < 1e-9
        assert stands == ("standing" in reason)


def test_after_the_last_branch_the_plan_goes_on_to_its_end(running: Emulated, tmp_path: Path) -> None:
    outcome = played(running, tmp_path, (1.5,), WAYS)
    assert outcome.ended is PlaybackEnd.INTERRUPTED
    np.testing.assert_allclose(rows_played(tmp_path)[-1], PLAN.angles[-1], atol=1e-9)


def test_a_second_ctrl_c_holds_at_once(running: Emulated, tmp_path: Path) -> None:
    outcome = played(running, tmp_path, (0.2, 0.35), WAYS)
    assert (outcome.ended, outcome.reason) == (PlaybackEnd.INTERRUPTED, "interrupted, holding")
    assert len(rows_played(tmp_path)) < 60


def test_without_branches_ctrl_c_holds_at_once(running: Emulated, tmp_path: Path) -> None:
    outcome = played(running, tmp_path, (0.3,), [])
    assert outcome.reason == "interrupted, holding"
    assert len(rows_played(tmp_path)) < 60


def test_the_course_parts_where_the_branch_differs_and_never_turns_back() -> None:
    assert [parting(PLAN, branch) for branch in WAYS] == [60, 120]
    course = Course(PLAN, WAYS)
    assert not course.reach(59) and course.stop(61) and not course.stop(62)
    assert course.remaining(61) == pytest.approx((120 + 50 - 1 - 61) / RATE)
    assert not course.reach(119)
    assert course.reach(121) and course.plan is WAYS[1] and course.last == 169
    assert not course.reach(122)


def test_the_space_bar_of_a_terminal_asks_once_and_the_terminal_is_restored() -> None:
    import termios

    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    heard = Interrupts(slave)
    with heard.listening():
        assert heard.requests == 0
        for keys, count in ((b"x", 0), (b" ", 1), (b"  ", 1)):
            os.write(master, keys)
            assert heard.requests == count
        signal.raise_signal(signal.SIGINT)
        assert heard.requests == 2
    assert termios.tcgetattr(slave) == before
    os.close(master)
    os.close(slave)


def test_a_playlist_plays_its_clips_with_idle_motion_between(running: Emulated, tmp_path: Path) -> None:
    """Every goal of every piece, in order; a pause without idle motion rests in the first pose."""
    running.do("reset")
    running.spread(ARM, STAND.tolist())
    nod = ServoPlan(0.1 * np.sin(np.pi * ROWS[:51] / 0.5) * np.ones(4), RATE)
    back = ServoPlan(-nod.angles, RATE)
    idle = ServoPlan(nod.angles / 2, RATE)
    files = {Path(name): Piece(plan, name=name) for name, plan in (("nod", nod), ("back", back), ("idle", idle))}
    order = Playlist((Path("nod"), Path("back")), (1.1, 0.0), Path("idle")).pieces(files)
    assert [piece.name for piece in order] == ["nod", "idle", "idle", "back"]
    require_same_stands(order, ARM.joints)
    outcome = play(order, ARM, running.port, OPTIONS, tmp_path / "play.npz")
    assert outcome.ended is PlaybackEnd.FINISHED
    made, planned = rows_played(tmp_path), np.concatenate([piece.plan.angles for piece in order])
    assert len(made) >= len(planned) - 2 * outcome.figures.get("skipped_ticks", 4)
    assert np.abs(made[:, None] - planned[None]).max(axis=2).min(axis=1).max() < 1e-9


def test_clips_that_do_not_meet_in_a_stand_are_refused() -> None:
    pieces = [Piece(PLAN, name="a"), Piece(ServoPlan(PLAN.angles + np.array([0, 0.3, 0, 0]), RATE), name="b")]
    with pytest.raises(ServoError, match=r"b begins 0\.30 rad \(j2\) from the stand in which a ends: .*join"):
        require_same_stands(pieces, ARM.joints)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"table \[\[clip\]\]"),
        ("[[clip]]\nfile = 'a.npz'\npuase = 1", "clip 1 has no 'puase'; .*pause"),
        ("[[clip]]\nfile = 'a.npz'\npause = -1", "clip 1: .*pause a time"),
        ("repeat = 0\n[[clip]]\nfile = 'a.npz'", "repeat is a number from 1"),
    ],
)
def test_mistakes_in_a_playlist_name_the_key(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "list.toml").write_text(text)
    with pytest.raises(ServoError, match=message):
        read_playlist(tmp_path / "list.toml")


def test_files_of_a_playlist_are_beside_it(tmp_path: Path) -> None:
    (tmp_path / "list.toml").write_text("idle = 'i.npz'\nrepeat = 2\n[[clip]]\nfile = 'a/t.npz'\npause = 2\n")
    found = read_playlist(tmp_path / "list.toml")
    assert found == Playlist((tmp_path / "a/t.npz",) * 2, (2.0, 2.0), tmp_path / "i.npz")


def test_a_playlist_is_never_played_unjudged(tmp_path: Path) -> None:
    (tmp_path / "list.toml").write_text("[[clip]]\nfile = 'a.npz'\n")
    for option in ("--unsafe", "--plain"):
        done = CliRunner().invoke(app, ["play", str(tmp_path / "list.toml"), "--servos", "op3", option, "--dry-run"])
        assert isinstance(done.exception, UsageError) and "plays judged goals" in str(done.exception)


def kept(folder: Path, angles: np.ndarray, passed: bool = True) -> Path:
    """A trajectory file of the arm with goals, and the report beside it."""
    folder.mkdir(parents=True)
    goals = Goals(angles, RATE, 0.0, 0.0, ARM.fingerprint)
    path = Trajectory(angles, RATE, ARM.joints, "arm", goals=goals).save(folder / "trajectory.npz")
    content = {"verdict": "pass" if passed else "fail", "reasons": ["fell"], "robot": "arm", "mode": "free"}
    content |= {"thresholds": {}, "format_version": 3, "trajectory_sha256": fingerprint(path)}
    (folder / "report.json").write_text(json.dumps(sealed(content)))
    return path


def test_only_branches_of_the_trajectory_that_passed_are_taken(tmp_path: Path) -> None:
    path = kept(tmp_path / "a", PLAN.angles)
    kept(tmp_path / "a/stops/0.600", WAYS[0].angles)
    kept(tmp_path / "a/stops/1.200", WAYS[1].angles, passed=False)
    kept(tmp_path / "a/stops/1.500", WAYS[0].angles + 0.01)
    ways, refused = judged_ways(path, goal_plan(load_trajectory(path), ARM), ARM, "arm.toml")
    assert [parting(PLAN, found) for found in ways] == [60]
    assert len(refused) == 2 and "it did not pass: fell" in refused[0] and "belongs to another trajectory" in refused[1]
