"""What a newcomer meets first: guidance, defaults, wrong files, names mistyped, one spelling of outputs, the doctor."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import typer
from forked import run
from made_trajectories import wander
from shared_files import ROOT
from typer.testing import CliRunner

from robot_retarget.base.errors import UsageError, known
from robot_retarget.base.mujoco_setup import unusable
from robot_retarget.human.motion import span_of
from robot_retarget.robot import load_robot
from robot_retarget.tools.cli import app, console
from robot_retarget.tools.cli.info import examine, ports
from robot_retarget.tools.cli.options import kind_of
from robot_retarget.tools.cli.run import first_page

WAVE = ROOT / "samples/wave.bvh"


def test_the_command_alone_says_what_to_do_next() -> None:
    done = run()
    assert done.returncode == 0 and not done.stderr
    assert "robot-retarget run CLIP.bvh" in done.stdout and "robot-retarget doctor" in done.stdout


def test_without_a_robot_the_op3_is_used_and_named(tmp_path: Path) -> None:
    done = run("solve", WAVE, "--frames", "0s:0.2s", "--balance", "off", "--out", tmp_path / "w.npz")
    assert done.returncode == 0 and "no --robot given: op3 is used" in done.stderr
    assert (tmp_path / "w.npz").is_file()


@pytest.mark.parametrize(
    ("text", "span"),
    [
        ("3:9", (3, 9)),
        ("1s:3s", (30, 90)),
        ("0.5s:", (15, 100)),
        (":2s", (0, 60)),
        ("7", (7, 8)),
        ("10:1s", (10, 30)),
    ],
)
def test_frames_are_given_by_number_or_time(text: str, span: tuple[int, int]) -> None:
    assert span_of(text, 100, 30.0) == span


@pytest.mark.parametrize("text", ["a:b", "1s:3q", "nans:", "infs:", "1:2:3", "s", "1s"])
def test_other_frames_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--frames takes START:STOP"):
        span_of(text, 100, 30.0)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results, as `run` leaves it."""
    folder = tmp_path_factory.mktemp("results")
    wander(load_robot("op3")).save(folder / "trajectory.npz")
    return folder


@pytest.mark.parametrize(
    "words",
    [
        "score RESULTS/trajectory.npz",
        "export RESULTS -f core -o OUT.npz",
        "edit mirror RESULTS/trajectory.npz -o OUT.npz",
        "edit cut RESULTS -o OUT.npz --trim 0:0.2",
        "warn RESULTS",
        "simulate RESULTS --no-store --no-compensate --draws 0",
        "view RESULTS --static OUT.html",
    ],
)
def test_commands_take_the_robot_and_the_trajectory_that_results_name(
    words: str, results: Path, tmp_path: Path
) -> None:
    done = run(*words.replace("RESULTS", str(results)).replace("OUT", str(tmp_path / "out")).split())
    assert done.returncode in (0, 1) and "error" not in done.stderr, done.stderr


def test_a_file_that_names_no_robot_or_an_unknown_one_says_which_option_does(tmp_path: Path) -> None:
    (tmp_path / "moves.csv").write_text("1,2\n")
    replace(wander(load_robot("op3")), robot="nobody").save(tmp_path / "moves.npz")
    for name, said in (
        ("moves.csv", "names no robot: --robot is missing"),
        ("moves.npz", "is of the robot 'nobody'; --robot"),
    ):
        done = run("score", tmp_path / name)
        assert done.returncode == 2 and said in done.stderr, done.stderr


def test_an_exported_file_is_scored_by_the_robot_beside_it(results: Path, tmp_path: Path) -> None:
    assert run("export", results, "-f", "unitree", "-o", tmp_path / "moves.csv").returncode == 0
    done = run("score", tmp_path / "moves.csv", "--json")
    assert done.returncode == 0 and json.loads(done.stdout)["robot"] == "op3"


def test_info_describes_a_trajectory(results: Path) -> None:
    done = run("info", results / "trajectory.npz")
    assert done.returncode == 0 and "a trajectory of" in done.stdout and "on op3" in done.stdout


def test_progress_is_a_line_now_and_then_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(range(0, 10_000, 4))  # a clip in eight seconds: the clock is read twice or more for each
    monkeypatch.setattr(console, "monotonic", lambda: float(next(clock)))
    with console.tally(40, lambda: False) as report:
        for k in range(40):
            report(k % 10 > 0)
    lines = capsys.readouterr().err.splitlines()
    assert 5 <= len(lines) <= 20 and lines[-1].startswith("40/40 clips") and "4 failed" in lines[-1]
    assert all("clips/s" in line and " s left" in line for line in lines)


def test_a_wrong_kind_of_file_says_which_command_takes_it(tmp_path: Path) -> None:
    trajectory = wander(load_robot("op3")).save(tmp_path / "t.npz")
    for words, message in (
        (("run", trajectory), "a trajectory, not a motion; robot-retarget view, simulate, export and play take it"),
        (("simulate", WAVE, "-r", "op3"), f"a motion, not a trajectory; robot-retarget run {WAVE} makes"),
        (
            ("solve", ROOT / "models/op3/op3.xml", "-o", tmp_path / "x.npz"),
            "a robot, not a motion; robot-retarget info",
        ),
        (("graph", ROOT / "models/op3/limits.toml"), "settings, not a motion"),
        (("run", "-"), "is read from a file, not from stdin"),
    ):
        done = run(*words)
        assert done.returncode == 2 and message in done.stderr, done.stderr


def test_an_archive_of_positions_may_be_a_motion(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"PK")
    assert kind_of(tmp_path / "a.npz") == "" and kind_of(tmp_path / "absent.npz") == ""


@pytest.mark.parametrize("words", [("info", "-r", "opp3"), ("solv", WAVE), ("run", WAVE, "--robott", "op3")])
def test_a_mistyped_name_gets_the_nearest_one(words: tuple[object, ...]) -> None:
    done = run(*words)
    assert done.returncode == 2 and any(said in done.stderr.lower() for said in ("did you mean", "possible options"))


def test_only_a_near_name_is_suggested() -> None:
    assert known(["posture", "touch"], typed="Posture") == "did you mean 'posture'? known: posture, touch"
    assert known(["posture", "touch"], typed="xyz") == "known: posture, touch"


def test_every_output_is_spelt_alike() -> None:
    group = typer.main.get_command(app)
    commands = {**group.commands, **group.commands["servos"].commands, **group.commands["edit"].commands}  # type: ignore[attr-defined]
    spelt = {}
    for name, command in commands.items():
        for option in command.params:
            if {"-o", "--out", "--output"} & set(option.opts):
                spelt[name] = set(option.opts)
    assert {"run", "demo", "solve", "cut", "export", "import", "calibrate"} <= spelt.keys()
    assert {name for name, opts in spelt.items() if not {"-o", "--out", "--output"} <= opts} == set()


def test_the_doctor_examines_each_part_and_cures_what_is_missing() -> None:
    done = run("doctor", "--json")
    found = {finding["part"]: finding for finding in json.loads(done.stdout)}
    assert {"Python", "MuJoCo", "OpenGL", "C compiler", "ffmpeg"} <= found.keys()
    assert done.returncode == any(f["state"] == "missing" for f in found.values())
    bare = {f.part: f for f in examine() if f.state != "ok"}
    assert all(f.cure or f.part == "serial port" for f in bare.values())


def test_the_doctor_finds_a_port_without_rights_and_a_slow_adapter(tmp_path: Path) -> None:
    timer = tmp_path / "sys/bus/usb-serial/devices/ttyUSB0/latency_timer"
    for path, text in ((tmp_path / "dev/ttyUSB0", ""), (timer, "16\n")):
        path.parent.mkdir(parents=True)
        path.write_text(text)
    found = {f.part: f for f in ports(tmp_path)}
    assert found["port ttyUSB0"].state == "ok"
    assert found["latency of ttyUSB0"].state == "missing" and "echo 1 | sudo tee" in found["latency of ttyUSB0"].cure
    timer.write_text("1\n")
    assert {f.state for f in ports(tmp_path)} == {"ok"}


@pytest.mark.parametrize(
    ("asked", "system", "usable"),
    [("", "Linux", True), ("off", "Linux", True), ("glfw", "Darwin", True), ("cgl", "Darwin", True),
     ("rubbish", "Linux", False), ("wgl", "Linux", False), ("egl", "Darwin", False)],
)  # fmt: skip
def test_ways_to_render_are_known_by_system(asked: str, system: str, usable: bool) -> None:
    assert (unusable(asked, system) == "") == usable


def test_a_way_to_render_without_its_library_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    assert unusable("osmesa", "Linux") == "the library libOSMesa is not installed"


def test_a_wrong_way_to_render_is_ignored_with_a_note() -> None:
    command = [sys.executable, "-m", "robot_retarget", "info", "op3", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"MUJOCO_GL": "rubbish"})
    assert done.returncode == 0 and "note: MUJOCO_GL=rubbish is ignored" in done.stderr


EVIL = "\x1b]0;title\x07\x1b[31mred \x9b5m[bold]arm[/] =1+1"


def test_names_in_files_of_others_give_the_terminal_no_commands(capsys: pytest.CaptureFixture[str]) -> None:
    console.say(EVIL)
    console.note(EVIL)
    console.table(EVIL, (EVIL, "value"), [(EVIL, 1.0)])
    console.dump({EVIL: EVIL})
    console.dump({EVIL: EVIL}, side=True)
    console.err.print(EVIL)
    said = "".join(capsys.readouterr())
    assert said.count("[bold]arm[/]") == 10
    assert all(c.isprintable() or c == "\n" for c in said)


def test_every_command_is_said_in_one_line_of_help() -> None:
    for group in ((), ("edit",), ("servos",)):
        told = CliRunner().invoke(app, [*group, "--help"]).stdout.split("Commands:")[1]
        assert "..." not in told, told


def test_a_command_without_its_group_gets_the_whole_name() -> None:
    done = run("join", "a.npz", "b.npz")
    assert done.returncode == 2 and "robot-retarget edit join a.npz b.npz" in done.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("view", WAVE), f"a motion, not a trajectory; robot-retarget run {WAVE}"),
        ((WAVE,), f"a file, not a command; robot-retarget run {WAVE}"),
        (("info", "-r", ROOT / "models/op3"), f"is a folder; models in it: {ROOT / 'models/op3/op3.xml'}"),
        (("info", "-r", "op3", "--limits", "LIMITS"), "limits.toml: op3.xml has no joint 'l_ell'; "),
        (("retarget", WAVE), "no command 'retarget'; did you mean 'run'? known: "),
        (("visualize",), "did you mean 'view'?"),
        (("simulat",), "did you mean 'simulate'?"),
        (("view", ROOT / "models"), "is a folder without trajectory.npz; trajectories in it: none"),
        (("info", "-r", "op3", "--limits", "LIMITS"), "did you mean 'l_el'?"),
        (("solve", WAVE, "--fps", "abc", "-o", "x.npz"), "'--fps': it takes a number\n"),
        (("batch", WAVE, "--jobs", "0", "--out", "x"), "it must be greater than or equal to 1\n"),
        (("solve", WAVE, "--performer", "Anna", "-o", "x.npz"), "none is called 'Anna'"),
        (("view", "x.npz", "--frames", "3:9"), "--frames is a part of --motion"),
        (("solve", WAVE, "--legs", "fly", "-o", "x.npz"), "'--legs': 'fly' is not one of 'auto', 'follow', 'stand'"),
    ],
)
def test_a_wrong_word_is_answered_with_what_to_do(words: tuple[object, ...], said: str, tmp_path: Path) -> None:
    (tmp_path / "limits.toml").write_text("[range]\nl_ell = [0, 1]\n")
    done = run(*(tmp_path / "limits.toml" if word == "LIMITS" else word for word in words))
    assert done.returncode == 2 and said in done.stderr, done.stderr


def test_a_trajectory_is_looked_at_on_the_robot_that_it_names(tmp_path: Path) -> None:
    wander(load_robot("op3")).save(tmp_path / "moves.npz")
    done = run("view", tmp_path / "moves.npz", "--static", tmp_path / "page.html")
    assert done.returncode == 0 and (tmp_path / "page.html").is_file(), done.stderr


def test_the_page_to_open_is_one_that_was_written() -> None:
    """Without matplotlib there is no report."""
    out = Path("out")
    assert first_page(out, ["report.html", "viewer.html"]).startswith(str(out / "report.html"))
    assert "report.html" not in first_page(out, ["trajectory.npz", "viewer.html"])
