"""How commands end that do not come to their own end: defects, Ctrl-C, a reader of a pipe that is gone."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from types import FrameType

import forked
import pytest
import typer
from shared_files import ROOT

from robot_retarget.tools.cli.command import Interruptible
from robot_retarget.tools.cli.run import filling

WAVE = ROOT / "samples/wave.bvh"
SHORT = ("--frames", "0:9", "--balance", "off", "--draws", "0")
DEFECTIVE = """
import sys
from robot_retarget.tools.cli import main
def fail(*_, **__): raise ZeroDivisionError("float division by zero\\nand more")
sys.modules["robot_retarget.tools.cli.options"].load = fail
main()
"""


def command(*words: str | Path) -> list[str]:
    return [sys.executable, "-m", "robot_retarget", *map(str, words)]


def heeding_ctrl_c() -> None:
    """Take SIGINT also where the tests run in the background of a shell, which ignores it and hands this down."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def stopped(words: list[str], folder: Path, once: str, number: int = signal.SIGINT) -> subprocess.CompletedProcess[str]:
    """A command that gets a signal as soon as a file or folder is there."""
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, preexec_fn=heeding_ctrl_c
    )
    deadline = time.monotonic() + 600
    while time.monotonic() < deadline and not list(folder.glob(once)) and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(number)
    out, err = process.communicate(timeout=600)
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
    done = stopped(command("run", WAVE, "--robot", "op3", "--out", out), tmp_path, "new/results")
    assert done.returncode == 130, done.stderr
    assert done.stderr.splitlines()[-1] == "stopped: no file was written"
    assert not list(tmp_path.iterdir())


def test_ctrl_c_at_every_moment_of_the_start_leaves_no_folder(tmp_path: Path) -> None:
    """Ctrl-C takes effect when a C function returns: it is pressed at the return of the first, the second, … one."""
    program = typer.Typer(cls=Interruptible, callback=lambda: None)

    @program.command()
    def fill(out: Path) -> None:
        with filling(out):
            sys.setprofile(None)

    whole = typer.main.get_command(program)
    total = pressed_at(-1, lambda: ended(whole, tmp_path / "all/out"))
    assert total >= 50
    for moment in range(total):
        place = tmp_path / f"{moment}"
        place.mkdir()
        codes = list[int]()
        pressed_at(moment, lambda: codes.append(ended(whole, place / "new/out")))  # noqa: B023
        assert codes == [130] and not list(place.iterdir()), moment


def ended(program: Callable[..., object], out: Path) -> int:
    """Fill a folder; return the exit code."""
    with pytest.raises(SystemExit) as stopped:
        program(["fill", str(out)])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def pressed_at(moment: int, run: Callable[[], object]) -> int:
    """Run a function, stopped where it has called so many C functions within `filling`; return how many it called."""
    called, inside = 0, False

    def watch(frame: FrameType, event: str, _: object) -> None:
        nonlocal called, inside
        inside = inside or frame.f_code.co_name == "filling"
        if inside and event == "c_return":
            called += 1
            if called > moment >= 0:
                sys.setprofile(None)
                raise KeyboardInterrupt

    sys.setprofile(watch)
    try:
        run()
    finally:
        sys.setprofile(None)
    return called


def test_ctrl_c_says_what_is_kept(tmp_path: Path) -> None:
    (tmp_path / "older.txt").write_text("not of this run")
    words = command(
        "run",
        WAVE,
        "--robot",
        "op3",
        *SHORT,
        "--out",
        tmp_path,
        "--video",
    )
    done = stopped(words, tmp_path, ".unfinished/report.json")
    assert done.returncode == 130, done.stderr
    kept = {path.name for path in tmp_path.iterdir()} - {"older.txt"}
    assert {"trajectory.npz", "report.json"} <= kept and "video.mp4" not in kept
    assert f"stopped: kept {', '.join(sorted(kept))} in {tmp_path}" in done.stderr


def test_a_refusal_leaves_no_folder(tmp_path: Path) -> None:
    bad = ("run", WAVE, "--robot", "op3", "--legs", "fly", "--out", tmp_path / "new/results")
    assert forked.run(*bad).returncode == 2
    assert not list(tmp_path.iterdir())


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("[!.]*")}


def test_a_killed_run_leaves_the_earlier_results_whole_and_the_next_run_sweeps_it_and_names_what_it_wrote(
    tmp_path: Path,
) -> None:
    earlier = ("trajectory.npz", "report.json", "report.html", "video.mp4", "mine.txt")
    for name in earlier:
        (tmp_path / name).write_text("earlier")
    words = ("run", WAVE, "--robot", "op3", *SHORT, "--json", "--out", tmp_path)
    killed = stopped(command(*words), tmp_path, ".unfinished/report.json", signal.SIGKILL)
    assert killed.returncode == -signal.SIGKILL
    assert contents(tmp_path) == dict.fromkeys(earlier, b"earlier")
    done = forked.run(*words)
    assert done.returncode in (0, 1), done.stderr
    found = contents(tmp_path)
    assert set(json.loads(done.stdout)["files"]) == found.keys() - {"mine.txt"}
    assert {name for name, data in found.items() if data == b"earlier"} == {"mine.txt"} and "video.mp4" not in found
    assert all(path.is_file() for path in tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "reader"),
    [
        *product(["info op3 --json", "--version"], ["| true", "| head -c 1 > /dev/null", ">&-"]),
        ("info op3", "| true"),
        ("--help", "| head -c 1 > /dev/null"),
        ("run --help", ">&-"),
    ],
)
def test_a_reader_that_is_gone_ends_a_command_as_sigpipe_does(words: str, reader: str) -> None:
    line = f"{' '.join(command(words))} {reader}; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, cwd=ROOT)
    assert done.returncode == 141 or (done.returncode == 0 and "head" in reader), done.stderr
    assert not done.stderr


def test_closed_stderr_changes_nothing() -> None:
    done = subprocess.run(["bash", "-c", f"{' '.join(command('info', 'op3'))} 2>&-"], capture_output=True, cwd=ROOT)
    assert done.returncode == 0 and done.stdout


@pytest.mark.parametrize("after", [0.05, 0.2, 0.8])
def test_ctrl_c_while_a_command_loads_leaves_no_traceback(after: float, tmp_path: Path) -> None:
    program = "import robot_retarget.__main__ as m; print(flush=True); m.main()"
    words = [sys.executable, "-c", program, "solve", str(WAVE), "--robot", "op3", "-o", str(tmp_path / "t.npz")]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, preexec_fn=heeding_ctrl_c
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.readline()
        time.sleep(after)
        process.send_signal(signal.SIGINT)
        err = process.stderr.read()
    assert process.returncode in (130, -signal.SIGINT), err
    assert "Traceback" not in err and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("missing", "words", "sentence"),
    [
        ("resource", f"batch {WAVE.parent} --robot op3 --out out", "this command needs Linux: Python has no module 'resource'"),
        ("termios", "servos scan --port /dev/null", "this command needs Linux: Python has no module 'termios'"),
    ],
)  # fmt: skip
def test_what_this_system_lacks_is_named(missing: str, words: str, sentence: str, tmp_path: Path) -> None:
    program = f"import sys; sys.modules[{missing!r}] = None\nfrom robot_retarget.tools.cli import main\nmain()"
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", program, *words.split()], capture_output=True, text=True, cwd=tmp_path, env=env
    )
    assert done.returncode == 2 and done.stderr.startswith(f"error: {sentence}"), done.stderr
