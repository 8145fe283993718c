"""`score` on the command line, and on files that other retargeters write."""

import json
from pathlib import Path

import numpy as np
import pytest
from judged_files import numbers
from made_trajectories import swing
from shared_files import ROOT, needs_shared
from typer.testing import CliRunner

import robot_retarget as rr
from robot_retarget.tools.cli import app

WAVE = ROOT / "samples/wave.bvh"
PEERS = {"gmr": "clip.pkl", "unitree": "clip.csv", "phc": "clip.pkl", "omniretarget": "clip.npz"}


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    return result.exit_code, result.output if not result.exception or result.exit_code in (0, 1) else str(
        result.exception
    )


@needs_shared
@pytest.mark.parametrize("format", PEERS)
def test_files_of_other_retargeters_score_as_the_trajectory_they_hold(format: str, tmp_path: Path) -> None:
    robot = rr.load_robot(str(ROOT.parent / "shared/robots/unitree_g1/unitree_g1.xml"))
    moves = swing(robot, robot.joint_names[3], 0.4, 0.5, 1.0, fps=30.0)
    written = rr.export(moves, robot, format, tmp_path / PEERS[format])
    again = rr.load_trajectory(written, robot, format)
    own, theirs = numbers(rr.score(moves, robot).figures), numbers(rr.score(again, robot).figures)
    assert theirs == pytest.approx(own, rel=1e-3, abs=0.02)


def test_the_command_prints_the_figures_as_json(tmp_path: Path) -> None:
    robot = rr.load_robot("op3")
    moves = swing(robot, robot.joint_names[0], 0.2, 0.5, 1.0, fps=30.0)
    moves.save(tmp_path / "t.npz")
    code, said = run(
        "score", tmp_path / "t.npz", "--robot", "op3", "--motion", WAVE, "-o", tmp_path / "s.json", "--json", "-q"
    )
    assert code == 0
    found = json.loads((tmp_path / "s.json").read_text())
    assert found == json.loads(said)
    assert found["figures"]["limb_deg_mean"] > 0
    assert found["figures"] == dict(rr.score(moves, robot, rr.read_motion(WAVE, repair=False)).figures)


def test_without_a_motion_figures_of_likeness_do_not_apply(tmp_path: Path) -> None:
    robot = rr.load_robot("op3")
    swing(robot, robot.joint_names[0], 0.2, 0.5, 1.0).save(tmp_path / "t.npz")
    code, said = run("score", tmp_path / "t.npz", "--robot", "op3")
    assert code == 0 and "do not apply: limb_deg_mean" in said


def test_a_file_that_is_no_motion_of_a_robot_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", something=np.zeros(3))
    with pytest.raises(rr.RobotRetargetError, match="no known format"):
        CliRunner().invoke(app, ["score", str(tmp_path / "t.npz"), "--robot", "op3"], catch_exceptions=False)
