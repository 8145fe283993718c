"""How commands end that do not come to their own end: defects, Ctrl-C, a reader of a pipe that is gone."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from shared_files import ROOT

WAVE = ROOT / "samples/wave.bvh"
DEFECTIVE = """
import sys
from robot_retarget.cli import main, stages
def fail(*_): raise ZeroDivisionError("float division by zero\\nand more")
stages.load = sys.modules["robot_retarget.cli.info"].load = fail
main()
"""


def command(*words: str | Path) -> list[str]:
    return [sys.executable, "-m", "robot_retarget", *map(str, words)]


def heeding_ctrl_c() -> None:
    """Take SIGINT also where the tests run in the background of a shell, which ignores it and hands this down."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted(words: list[str], once: Path) -> subprocess.CompletedProcess[str]:
    """A command that gets SIGINT as soon as a file or folder is there."""
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, preexec_fn=heeding_ctrl_c
    )
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not once.exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    return subprocess.CompletedProcess(words, process.returncode, out, err)


@pytest.mark.parametrize("debug", ["", "1"])
def test_a_defect_has_a_sentence_and_an_exit_code_of_its_own(debug: str) -> None:
    env = os.environ | {"ROBOT_RETARGET_DEBUG": debug}
    words = [sys.executable, "-c", DEFECTIVE, "info", "op3"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, env=env)
    assert done.returncode == 70 and not done.stdout
    assert "a defect of robot-retarget ended this command (ZeroDivisionError: float division by zero)." in done.stderr
    assert "Please report it" in done.stderr and "ROBOT_RETARGET_DEBUG=1" in done.stderr
    assert ("Traceback" in done.stderr) == bool(debug)
    assert len(done.stderr.splitlines()) == 1 or debug


def test_ctrl_c_before_anything_is_written_leaves_no_folder(tmp_path: Path) -> None:
    out = tmp_path / "new/results"
    done = interrupted(command("run", WAVE, "--robot", "op3", "--out", out), once=out)
    assert done.returncode == 130, done.stderr
    assert done.stderr.splitlines()[-1] == "stopped: no file was written"
    assert not list(tmp_path.iterdir())


def test_ctrl_c_says_what_is_kept(tmp_path: Path) -> None:
    (tmp_path / "older.txt").write_text("not of this run")
    words = command("run", WAVE, "--robot", "op3", "--frames", "0:40", "--legs", "stand", "--out", tmp_path, "--video")
    done = interrupted(words, once=tmp_path / "report.json")
    assert done.returncode == 130, done.stderr
    kept = {path.name for path in tmp_path.iterdir()} - {"older.txt"}
    assert {"trajectory.npz", "report.json"} <= kept and "video.mp4" not in kept
    assert f"stopped: kept {', '.join(sorted(kept))} in {tmp_path}" in done.stderr


def test_a_refusal_leaves_no_folder(tmp_path: Path) -> None:
    bad = command("run", WAVE, "--robot", "op3", "--legs", "fly", "--out", tmp_path / "new/results")
    assert subprocess.run(bad, capture_output=True, cwd=ROOT).returncode == 2
    assert not list(tmp_path.iterdir())


def test_a_pipe_that_nobody_reads_ends_without_a_word() -> None:
    words = " ".join(command("info", "op3", "--json"))
    done = subprocess.run(["bash", "-c", f"{words} | true; exit ${{PIPESTATUS[0]}}"], capture_output=True, cwd=ROOT)
    assert done.returncode in (0, 141) and not done.stderr
