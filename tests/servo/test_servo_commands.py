"""The commands for servos, against an emulator process."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emulated import ARM, emulated, until
from forked import run as call

from robot_retarget.actuators.goals import Goals
from robot_retarget.actuators.map import dump_map, load_map
from robot_retarget.base.untrusted.documents import sealed
from robot_retarget.servo.bus import Bus
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory


def swing(folder: Path, joints: tuple[str, ...] = ARM.joints) -> Path:
    times = np.arange(0, 0.31, 0.02)[:, None]
    return Trajectory(0.2 * np.sin(3 * times) * np.ones(len(joints)), 50, joints, "arm").save(folder / "swing.npz")


def test_servos_are_found_checked_put_right_and_calibrated(tmp_path: Path) -> None:
    with emulated(tmp_path) as emulator:
        servo_map = tmp_path / "servos.toml"
        found = json.loads(
            call("servos", "scan", "--port", emulator.port, "--baud", 1000000, "--last", 9, "--json").stdout
        )
        assert [row["id"] for row in found] == [1, 2, 3, 4]
        again = [call("servos", "check", "--map", servo_map, "--port", emulator.port, *fix) for fix in ([], ["--fix"])]
        assert [run.returncode for run in again] == [0, 0]
        emulator.do("place 1 1900")
        made = call("servos", "calibrate", "--map", servo_map, "--port", emulator.port, "-o", tmp_path / "new.toml")
        assert "j1: zero 2088 -> 1900" in made.stdout
        assert load_map(tmp_path / "new.toml")["j1"].zero == 1900


def test_a_trajectory_plays_only_with_a_passing_report_of_its_own(tmp_path: Path) -> None:
    plain, report = load_trajectory(swing(tmp_path)), tmp_path / "report.json"
    angles = np.pad(plain.qpos, ((10, 10), (0, 0)), mode="edge")
    path = replace(plain, goals=Goals(angles, 50.0, 0.2, 0.2, ARM.fingerprint)).save(tmp_path / "swing.npz")
    with emulated(tmp_path) as emulator:
        command = ("play", path, "--servos", tmp_path / "servos.toml", "--port", emulator.port)
        command = (*command, "--log", tmp_path / "play.npz")
        refused = call(*command)
        assert refused.returncode == 2 and "no report at" in refused.stderr
        assert not (tmp_path / "play.npz").exists()
        content = {"verdict": "pass", "robot": "arm", "mode": "free", "thresholds": {}, "format_version": 3}
        report.write_text(json.dumps(sealed(content | {"trajectory_sha256": fingerprint(path)})))
        played = call(*command, "--json")
        assert played.returncode == 0, played.stderr
        told = json.loads(played.stdout)
        assert told["ended"] == "finished" and told["figures"]["limited"] == {}
    with np.load(tmp_path / "play.npz") as log:
        playing = log["phase"] == list(log["phases"]).index("play")
        np.testing.assert_allclose(log["goal"][playing], angles, atol=1e-12)


def test_a_map_with_numbers_that_cannot_be_moves_nothing(tmp_path: Path) -> None:
    path, well = swing(tmp_path), dump_map(ARM)
    with emulated(tmp_path) as emulator:
        before = emulator.servos()
        for name, old, new in (("speed", "speed = 4.0", "speed = nan"), ("j1", "j1 = 0.0", 'j1 = "0.0"')):
            bad = tmp_path / f"{name}.toml"
            bad.write_text(well.replace(old, new), encoding="utf-8")
            line = well[: well.index(old)].count("\n") + 1
            refused = call("play", path, "--servos", bad, "--port", emulator.port, "--unsafe")
            assert refused.returncode == 2 and f"{bad}:{line}: " in refused.stderr.replace("\n", "")
        refused = call(
            "play", path, "--servos", tmp_path / "servos.toml", "--port", emulator.port, "--unsafe", "--grace", "nan"
        )
        assert refused.returncode == 2 and "grace nan is not in 0…3600" in refused.stderr
        assert emulator.servos() == before


def test_a_dry_run_moves_nothing_and_a_map_must_cover_the_joints(tmp_path: Path) -> None:
    (tmp_path / "servos.toml").write_text(dump_map(ARM), encoding="utf-8")
    path = swing(tmp_path)
    dry = call("play", path, "--servos", tmp_path / "servos.toml", "--unsafe", "--dry-run", "--json")
    assert dry.returncode == 0 and json.loads(dry.stdout)["duration_s"] == pytest.approx(0.3, abs=0.008)
    other = call("play", swing(tmp_path, ("knee",)), "--servos", tmp_path / "servos.toml", "--unsafe", "--dry-run")
    assert other.returncode == 2 and "does not cover knee; it has j1, j2" in other.stderr


def test_an_emulator_says_ready_first_and_leaves_nothing_behind(tmp_path: Path) -> None:
    with emulated(tmp_path) as emulator:
        assert Path(emulator.port).is_symlink()
        process = emulator.process
    assert process.exitcode == 0
    assert not Path(emulator.port).is_symlink()


@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="needs Xvfb")
def test_the_twin_in_a_window_stays_on_the_bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with screen() as display:
        monkeypatch.setenv("DISPLAY", display)
        with emulated(tmp_path, "op3", "--physics", "--view") as emulator:
            until(lambda: emulator.do("state")["time"] > 0.3, seconds=10)
            with Bus(emulator.port, 2_000_000) as bus:
                assert bus.ping(1) == (1020, 48)
        assert emulator.process.exitcode == 0


@contextmanager
def screen() -> Iterator[str]:
    """The name of a display that nobody sees."""
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "320x240x24"]
    process = subprocess.Popen(command, pass_fds=(writing,), stderr=subprocess.DEVNULL)
    os.close(writing)
    try:
        with os.fdopen(reading) as lines:
            yield f":{lines.readline().strip()}"
    finally:
        process.terminate()
        process.wait()


def test_mistakes_end_in_a_sentence_and_exit_code_2(tmp_path: Path) -> None:
    for arguments, sentence in (
        (("servos", "emulate", "--map", "nobody"), "cannot read nobody: No such file"),
        (("servos", "emulate", "--map", "op3", "--fault", "explode 3"), "no fault 'explode 3'; known: silent"),
        (("servos", "scan", "--port", tmp_path / "none"), "cannot open"),
        (("servos", "scan", "--port", "/dev/null"), "cannot open /dev/null: it is not a serial port"),
        (("servos", "emulate", "--map", "op3", "--view"), "--view needs --physics"),
        (("servos", "emulate", "--map", "op3", "--physics", "--view"), "--view needs a display"),
    ):
        run = call(*arguments)
        assert run.returncode == 2 and sentence in run.stderr and "Traceback" not in run.stderr
