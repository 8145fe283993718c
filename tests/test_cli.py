"""The command line: its output, its files, and its errors for bad input."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
import typer
from forked import run
from shared_files import ROOT, SHARED, needs_shared
from typer.testing import CliRunner

import robot_retarget
from robot_retarget.tools.cli import app

WAVE = ROOT / "samples/wave.bvh"


def assert_refused(done: subprocess.CompletedProcess[str], *parts: str) -> None:
    """Exit code 2, one or two lines on stderr that hold the parts, no traceback."""
    assert done.returncode == 2, done.stderr
    lines = [line for line in done.stderr.splitlines() if not line.startswith("note:")]
    assert 1 <= len(lines) <= 2 and lines[0].startswith("error: "), done.stderr
    assert "Traceback" not in done.stderr
    for part in parts:
        assert part in done.stderr, done.stderr


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("solved") / "wave.npz"
    done = run("solve", WAVE, "--robot", "op3", "--frames", "0:12", "--balance", "off", "-o", path)
    assert done.returncode == 0, done.stderr
    return path


def test_solve_writes_the_trajectory_of_the_contract(solved: Path) -> None:
    with np.load(solved, allow_pickle=False) as archive:
        assert archive["qpos"].shape == (12, 27) and archive["qpos"].dtype == np.float64
        assert float(archive["fps"]) == 30.0 and archive["joint_names"].shape == (20,)
        assert {"robot", "source", "format_version"} <= {*archive.files}


def test_a_servo_robot_gets_a_stand_before_and_after_unless_balance_is_off(tmp_path: Path) -> None:
    path = tmp_path / "wave.npz"
    done = run("solve", WAVE, "--robot", "op3", "--frames", "0:12", "--legs", "stand", "-o", path)
    assert done.returncode == 0 and "with a stand before and after" in done.stderr
    with np.load(path, allow_pickle=False) as archive:
        assert len(archive["qpos"]) > 12 + 2 * 30


def test_the_version_is_that_of_the_package() -> None:
    done = run("--version")
    assert done.returncode == 0 and done.stdout == f"{robot_retarget.__version__}\n" and not done.stderr


def test_info_prints_the_map_of_a_motion_and_of_a_robot() -> None:
    motion, robot = run("info", WAVE), run("info", "op3")
    assert motion.returncode == robot.returncode == 0
    assert "RightWrist" in motion.stdout and "a human of 1.7" in motion.stdout
    assert "r_el_link" in robot.stdout and "20 hinges, free joint" in robot.stdout


def test_info_as_json_holds_every_keypoint_with_its_confidence() -> None:
    facts = json.loads(run("info", WAVE, "--json").stdout)
    assert facts["human"] and len(facts["keypoints"]) == 18
    assert all(0 <= v["confidence"] <= 1 for v in facts["keypoints"].values())


def test_simulate_takes_thresholds_and_writes_a_page(solved: Path, tmp_path: Path) -> None:
    (tmp_path / "strict.toml").write_text("tracking_rms = 1e-6\n", encoding="utf-8")
    options = "--thresholds", tmp_path / "strict.toml", "--page", tmp_path / "report.html", "--no-compensate"
    done = run("simulate", solved, "--robot", "op3", *options)
    assert done.returncode == 1 and "more than 5.73e-05°" in done.stdout
    assert "limits kept" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_simulate_prints_the_report_of_the_contract(solved: Path) -> None:
    done = run("simulate", solved, "--robot", "op3", "--json")
    report = json.loads(done.stdout)
    assert {
        "verdict",
        "reasons",
        "cures",
        "figures",
        "trajectory_sha256",
        "robot",
        "version",
        "format_version",
        "unlike",
        "badge",
        "mode",
        "thresholds",
        "model",
        "report_sha256",
    } == {*report}
    assert done.returncode == (0 if report["verdict"] == "pass" else 1)


def test_export_writes_names_and_units(solved: Path, tmp_path: Path) -> None:
    done = run("export", solved, "--robot", "op3", "--format", "csv", "-o", tmp_path / "wave.csv")
    assert done.returncode == 0, done.stderr
    header = (tmp_path / "wave.csv").read_text().splitlines()[0]
    assert "root_x [m]" in header and "r_el [rad]" in header


def test_graph_names_the_edges_that_lost_most(tmp_path: Path) -> None:
    done = run("graph", WAVE, "--robot", "op3", "--frames", "0:6", "--solve")
    assert done.returncode == 0 and "Edges that lost most" in done.stdout and " – " in done.stdout


def test_run_fills_the_folder(tmp_path: Path) -> None:
    done = run("run", WAVE, "--robot", "op3", "--frames", "0:6", "--balance", "off", "--out", tmp_path / "out")
    assert done.returncode in (0, 1), done.stderr
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"trajectory.npz", "report.json", "report.html"} <= names


HEAD = (
    "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n"
)
BAD_BVH = {
    "empty file": ("", ()),
    "no HIERARCHY": ("hello", ("HIERARCHY",)),
    "truncated MOTION": (HEAD + "MOTION\nFrames: 2\nFrame Time: 0.1\n0 0 0\n0 0\n", ("bad.bvh:15",)),
    "NaN": (HEAD + "MOTION\nFrames: 1\nFrame Time: 0.1\n0 nan 0\n", ("bad.bvh:14",)),
    "infinite": (HEAD + "MOTION\nFrames: 1\nFrame Time: 0.1\n0 inf 0\n", ("bad.bvh:14",)),
    "zero frame time": (HEAD + "MOTION\nFrames: 1\nFrame Time: 0\n0 0 0\n", ("Frame Time", "bad.bvh:13")),
}


@pytest.mark.parametrize("case", BAD_BVH, ids=str)
def test_a_broken_motion_is_refused_by_file_and_line(case: str, tmp_path: Path) -> None:
    text, parts = BAD_BVH[case]
    (tmp_path / "bad.bvh").write_text(text)
    assert_refused(run("solve", "bad.bvh", "--robot", "op3", "-o", "out.npz", cwd=tmp_path), "bad.bvh", *parts)
    assert [p.name for p in tmp_path.iterdir()] == ["bad.bvh"]


def test_bad_names_and_frames_are_refused_with_what_is_known(tmp_path: Path) -> None:
    (tmp_path / "clip.txt").write_text("x")
    (tmp_path / "robot.xml").write_text("<mujoco><worldbody><body></worldbody></mujoco>")
    out = ("-o", tmp_path / "out.npz")
    assert_refused(
        run("solve", "clip.txt", "--robot", "op3", *out, cwd=tmp_path), "'.txt'", "joint positions (.npy, .npz)"
    )
    assert_refused(
        run("solve", WAVE, "--robot", "op4", *out), "unknown robot 'op4'", "did you mean 'op3'? known: g1_class, op3"
    )
    assert_refused(run("solve", WAVE, "--robot", tmp_path / "robot.xml", *out), "robot.xml", "XML parse error")
    assert_refused(run("solve", WAVE, "--robot", "op3", "--frames", "10:9999", *out), "frames 10:9999", "0:169")
    assert_refused(run("solve", WAVE, "--robot", "op3", "--frames", "a:b", *out), "--frames takes START:STOP")
    assert_refused(run("solve", tmp_path / "none.bvh", "--robot", "op3", *out), "no such file")
    assert_refused(run("demo", "--clip", "jump", "--out", tmp_path / "d"), "no shipped clip 'jump'", "wave")
    assert {p.name for p in tmp_path.iterdir()} == {"clip.txt", "robot.xml"}


def test_an_unwritable_place_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for place in (tmp_path / "none/out.npz", tmp_path / "file/out.npz", tmp_path):
        assert_refused(run("solve", WAVE, "--robot", "op3", "-o", place), "cannot write")
    assert_refused(run("run", WAVE, "--robot", "op3", "--out", tmp_path / "file/out"), "cannot make the folder")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_disk_that_fills_up_leaves_nothing_half_written(tmp_path: Path) -> None:
    done = run("solve", WAVE, "--robot", "op3", "--frames", "0:12", "-o", tmp_path / "out.npz", file_size=1000)
    assert_refused(done, "cannot write", "out.npz")
    assert not list(tmp_path.iterdir())


def test_a_broken_trajectory_and_a_foreign_one_are_refused(solved: Path, tmp_path: Path) -> None:
    (tmp_path / "t.npz").write_bytes(b"no archive")
    assert_refused(run("simulate", tmp_path / "t.npz", "--robot", "op3"), "not a readable .npz")
    assert_refused(run("export", solved, "--robot", "op3", "-f", "xyz", "-o", tmp_path / "o"), "xyz", "csv", "unitree")
    assert not (tmp_path / "o").exists()


@needs_shared
def test_a_dog_is_described_and_not_solved(tmp_path: Path) -> None:
    dog = SHARED / "motions/bvh/nonhuman_negative/dog_walk_Bip01.bvh"
    told = run("info", dog)
    assert told.returncode == 2 and "not a human" in told.stdout and "quadruped" in told.stdout
    assert_refused(run("solve", dog, "--robot", "op3", "-o", tmp_path / "out.npz"), "quadruped")


@needs_shared
def test_a_trajectory_of_another_robot_is_refused(solved: Path) -> None:
    other = SHARED / "robots/unitree_g1/unitree_g1.xml"
    assert_refused(run("simulate", solved, "--robot", other), "unitree_g1")


def test_a_trajectory_keeps_the_name_of_its_format(tmp_path: Path) -> None:
    done = run("solve", WAVE, "--robot", "op3", "-o", tmp_path / "wave.csv")
    assert_refused(done, "wave.csv: its name has to end in .npz", "`export` writes trajectories in other formats")
    assert not list(tmp_path.iterdir())


def test_warn_writes_a_file_only_if_asked(solved: Path, tmp_path: Path) -> None:
    done = run("warn", solved.resolve(), "--robot", "op3", cwd=tmp_path)
    assert done.returncode == 0 and "warnings in 12 frames" in done.stdout
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("fps", ["1000", "1", "nan", "-3"])
def test_an_implausible_rate_is_refused_with_the_plausible_ones(fps: str, tmp_path: Path) -> None:
    done = run("solve", WAVE, "--robot", "op3", "--fps", fps, "-o", tmp_path / "wave.npz")
    assert_refused(done, f"--fps {fps} is outside 5 to 120 frames a second")
    assert not list(tmp_path.iterdir())


def test_a_rate_above_the_motions_own_is_said_to_be_interpolated(tmp_path: Path) -> None:
    done = run(
        "solve", WAVE, "--robot", "op3", "--frames", "0:9", "--fps", "60", "--balance", "off", "-o", tmp_path / "w.npz"
    )
    assert done.returncode == 0 and "those between the motion's own 30 are interpolated" in done.stderr


def test_mistakes_are_told_in_the_words_of_the_command_line(tmp_path: Path) -> None:
    out = "-o", tmp_path / "w.npz"
    assert_refused(
        run("solve", WAVE, "--robot", "op3", "--legs", "stand", "--balance", "off", *out), "--legs stand needs balance"
    )
    unknown = run("solve", WAVE, "--robot", "op3", "--legs", "fly", *out)
    assert unknown.returncode == 2 and "'--legs'" in unknown.stderr
    assert "'fly' is not one of 'auto', 'follow', 'stand'" in unknown.stderr
    assert not list(tmp_path.iterdir())


def commands_below(command: object, words: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    inner = getattr(command, "commands", {})
    return [words] if not inner else [name for k, v in inner.items() for name in commands_below(v, (*words, k))]


def test_every_command_has_a_short_help_with_an_example() -> None:
    everything = commands_below(typer.main.get_command(app))
    assert len(everything) >= 14
    for words in everything:
        done = CliRunner().invoke(app, [*words, "-h"])
        assert done.exit_code == 0 and f"Example: robot-retarget {' '.join(words)} " in done.stdout, words
