"""What passed is what plays: everything else is refused with the command that judges it anew, and that command works."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emulated import ARM
from made_trajectories import hold
from test_servo_commands import call

from robot_retarget.errors import ServoError
from robot_retarget.goals import Goals
from robot_retarget.robot import load_robot
from robot_retarget.servo.judgement import require_judged
from robot_retarget.servo.map import Servo, ServoMap
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory

QPOS = np.zeros((11, 4))
GOALS = Goals(0.1 * np.sin(np.arange(151)[:, None] / 20) * np.ones(4), 125.0, 0.5, 0.5, ARM.fingerprint)
JUDGED = Trajectory(QPOS, 50, ARM.joints, "arm", goals=GOALS)


def passing(folder: Path, trajectory: Trajectory = JUDGED, **changes: Any) -> Path:
    """A trajectory's file with a report that says pass, but for the changes."""
    path = trajectory.save(folder / "t.npz")
    content = {"verdict": "pass", "reasons": [], "figures": {"mode": "free"}, "format_version": 2, "version": "9"}
    (folder / "report.json").write_text(json.dumps(content | {"trajectory_sha256": fingerprint(path)} | changes))
    return path


def test_goals_that_passed_on_these_servos_may_be_sent(tmp_path: Path) -> None:
    path = passing(tmp_path)
    assert require_judged(path, load_trajectory(path), ARM, "arm.toml") == "free"


def test_calibration_and_bus_are_the_robot_s_own_affair() -> None:
    own = ServoMap("mine", tuple(replace(s, id=s.id + 9, zero=s.zero + 3, sign=-s.sign) for s in ARM.servos), 57600)
    assert own != ARM and own.fingerprint == ARM.fingerprint


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"verdict": "fail", "reasons": ["fell: j1 touched the floor"]}, "did not pass: fell: j1"),
        ({"trajectory_sha256": "0"}, "about another trajectory than .*, or it was edited since"),
        ({"format_version": None, "version": "0.1.0"}, r"a report of another version \(0\.1\.0\)"),
        ({"format_version": 1}, "a report of another version"),
    ],
)
def test_a_report_that_says_something_else_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = passing(tmp_path, **changes)
    with pytest.raises(ServoError, match=rf"{message}.*; judge it anew: robot-retarget simulate .* --servos arm\.toml"):
        require_judged(path, load_trajectory(path), ARM, "arm.toml")


def test_a_missing_or_broken_report_is_refused(tmp_path: Path) -> None:
    path = passing(tmp_path)
    (tmp_path / "report.json").write_text("[1]")
    with pytest.raises(ServoError, match="is no report; judge it anew"):
        require_judged(path, JUDGED, ARM, "arm.toml")
    (tmp_path / "report.json").unlink()
    with pytest.raises(ServoError, match=r"no report at .*; judge it anew"):
        require_judged(path, JUDGED, ARM, "arm.toml")


def test_a_file_without_goals_or_with_edited_ones_is_refused(tmp_path: Path) -> None:
    bare = passing(tmp_path, replace(JUDGED, goals=None))
    with pytest.raises(ServoError, match="holds no goals; judge it anew"):
        require_judged(bare, load_trajectory(bare), ARM, "arm.toml")
    path = passing(tmp_path)
    angles = GOALS.angles.copy()
    angles[70, 2] += 1e-6
    edited = replace(JUDGED, goals=replace(GOALS, angles=angles))
    edited.save(path)
    with pytest.raises(ServoError, match="or it was edited since"):
        require_judged(path, edited, ARM, "arm.toml")


OTHER = {
    "speed": replace(ARM, limits=replace(ARM.limits, speed=3.0)),
    "jump": replace(ARM, limits=replace(ARM.limits, jump=0.4)),
    "model": replace(ARM, servos=(replace(ARM.servos[0], model="XM430-W210"), *ARM.servos[1:])),
    "gear": replace(ARM, servos=(replace(ARM.servos[0], gear=1.5), *ARM.servos[1:])),
    "range": replace(ARM, servos=(replace(ARM.servos[0], upper=1.2), *ARM.servos[1:])),
}


@pytest.mark.parametrize("what", OTHER)
def test_another_servo_map_than_judged_is_refused(tmp_path: Path, what: str) -> None:
    path = passing(tmp_path)
    with pytest.raises(ServoError, match=r"judged on other servos than those of other\.toml"):
        require_judged(path, load_trajectory(path), OTHER[what], "other.toml")


def test_a_zero_that_cuts_goals_off_is_refused(tmp_path: Path) -> None:
    path = passing(tmp_path)
    shifted = ServoMap("arm", (Servo("j1", 1, "XM430-W350", zero=20, lower=-1.5, upper=1.5), *ARM.servos[1:]))
    shifted = replace(shifted, limits=ARM.limits)
    assert shifted.fingerprint == ARM.fingerprint
    with pytest.raises(ServoError, match=r"the zero of j1 in my\.toml cuts off 0\.0\d+ rad of its goals"):
        require_judged(path, load_trajectory(path), shifted, "my.toml")


def test_simulate_keeps_what_play_sends_and_the_command_of_a_refusal_mends_it(tmp_path: Path) -> None:
    op3 = load_robot("op3")
    path = hold(op3, 0.4).save(tmp_path / "stand.npz")
    play = ("play", path, "--servos", "op3", "--dry-run", "--json")
    refused = call(*play)
    assert refused.returncode == 2 and "no report at" in refused.stderr
    command = shlex.split(refused.stderr.replace("\n", " ").partition("judge it anew: ")[2])
    assert command[0] == "robot-retarget" and call(*command[1:]).returncode == 0
    goals = load_trajectory(path).goals
    assert goals is not None and goals.lead_in == goals.lead_out == 1.0
    dry = call(*play)
    assert dry.returncode == 0 and json.loads(dry.stdout)["duration_s"] == pytest.approx(2.4)
    slower = call(*play, "--speed", "0.5")
    assert slower.returncode == 2 and "say --plain" in slower.stderr


def test_a_trajectory_as_it_is_needs_a_pass_of_its_own(tmp_path: Path) -> None:
    op3 = load_robot("op3")
    still = hold(op3, 0.4)
    tipped = still.qpos.copy()
    tipped[:, op3.qpos_index[op3.joint_names.index("l_hip_roll")]] += np.linspace(0, 0.5, len(tipped))
    for trajectory, code in ((still, 0), (replace(still, qpos=tipped), 2)):
        path = trajectory.save(tmp_path / "t.npz")
        tried = call("play", path, "--servos", "op3", "--plain", "--speed", "0.5", "--dry-run")
        assert tried.returncode == code
        assert code == 0 or "played as it is it does not pass: l_hip_roll" in tried.stderr
