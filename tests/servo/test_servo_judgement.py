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

from robot_retarget.actuators.goals import RATE, Goals
from robot_retarget.actuators.map import Servo, ServoMap, load_map
from robot_retarget.base.errors import ServoError, TrajectoryError
from robot_retarget.base.untrusted.documents import sealed
from robot_retarget.judge.verdict import Thresholds
from robot_retarget.robot import load_robot
from robot_retarget.servo.judgement import require_judged
from robot_retarget.tools.cli.run import judged_plain
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory

QPOS = np.zeros((11, 4))
GOALS = Goals(0.1 * np.sin(np.arange(151)[:, None] / 20) * np.ones(4), 125.0, 0.5, 0.5, ARM.fingerprint)
JUDGED = Trajectory(QPOS, 50, ARM.joints, "arm", goals=GOALS)


PASS = {
    "verdict": "pass",
    "reasons": [],
    "figures": {},
    "robot": "arm",
    "format_version": 3,
    "version": "9",
    "mode": "free",
}


def passing(folder: Path, trajectory: Trajectory = JUDGED, name: str = "report.json", **changes: Any) -> Path:
    """A trajectory's file with a sealed report that says pass, but for the changes."""
    path = trajectory.save(folder / "t.npz")
    content = sealed(PASS | {"thresholds": {}, "trajectory_sha256": fingerprint(path)} | changes)
    (folder / name).write_text(json.dumps(content))
    return path


def test_goals_that_passed_on_these_servos_may_be_sent(tmp_path: Path) -> None:
    path = passing(tmp_path)
    require_judged(path, load_trajectory(path), ARM, "arm.toml")


@pytest.mark.parametrize(
    "edit", [{"verdict": "pass", "reasons": []}, {"mode": "free"}, {"thresholds": {}}, {"robot": "leg"}]
)
def test_a_report_that_was_edited_is_refused(tmp_path: Path, edit: dict[str, Any]) -> None:
    loose = {"tracking_rms": {"value": "inf", "default": "0.2"}}
    path = passing(tmp_path, verdict="fail", reasons=["fell"], mode="pinned", thresholds=loose)
    report = tmp_path / "report.json"
    report.write_text(json.dumps(json.loads(report.read_text()) | edit))
    with pytest.raises(ServoError, match=r"report\.json was edited since it was written; judge it again"):
        require_judged(path, load_trajectory(path), ARM, "arm.toml")


def test_a_pass_with_the_pelvis_held_plays_only_where_that_is_said(tmp_path: Path) -> None:
    path = passing(tmp_path, mode="pinned")
    with pytest.raises(ServoError, match=r"passed in mode pinned .*, not free; --mode pinned plays it on a robot held"):
        require_judged(path, JUDGED, ARM, "arm.toml")
    require_judged(path, JUDGED, ARM, "arm.toml", mode="pinned")


def test_a_pinned_report_does_not_stand_in_for_a_free_one_that_failed(tmp_path: Path) -> None:
    passing(tmp_path, name="report.pinned.json", mode="pinned")
    path = passing(tmp_path, verdict="fail", reasons=["fell: j1 touched the floor"])
    with pytest.raises(ServoError, match="did not pass: fell: j1"):
        require_judged(path, JUDGED, ARM, "arm.toml")
    require_judged(path, JUDGED, ARM, "arm.toml", mode="pinned")


def test_thresholds_above_the_defaults_need_a_flag(tmp_path: Path) -> None:
    own = Thresholds(tracking_rms=float("inf"), foot_slip=0.005).changed
    path = passing(tmp_path, thresholds=own)
    with pytest.raises(ServoError, match=r"above the defaults \(tracking_rms inf, default 0\.2\); --loose-thresholds"):
        require_judged(path, JUDGED, ARM, "arm.toml")
    require_judged(path, JUDGED, ARM, "arm.toml", loose=True)
    require_judged(passing(tmp_path, thresholds=Thresholds(foot_slip=0.005).changed), JUDGED, ARM, "arm.toml")


def test_a_preview_is_no_pass_for_servos(tmp_path: Path) -> None:
    path = passing(tmp_path, figures={"draws": 0})
    for loose in (False, True):
        with pytest.raises(ServoError, match=r"simulated once, .*--draws 0\): a preview .*judge it again: .*simulate"):
            require_judged(path, JUDGED, ARM, "arm.toml", loose=loose)
    require_judged(passing(tmp_path, figures={"draws": 10}), JUDGED, ARM, "arm.toml")
    require_judged(passing(tmp_path, figures={"draws": 0}, mode="pinned"), JUDGED, ARM, "arm.toml", mode="pinned")


def test_a_trajectory_of_another_robot_than_judged_is_refused(tmp_path: Path) -> None:
    path = passing(tmp_path, replace(JUDGED, robot="leg"))
    with pytest.raises(ServoError, match=r"is of the robot 'leg', .*report\.json of 'arm'"):
        require_judged(path, load_trajectory(path), ARM, "arm.toml")


@pytest.mark.parametrize(
    "nonsense", [{"thresholds": [1]}, {"thresholds": {"a": 1}}, {"mode": [1]}, {"reasons": 1, "verdict": 2}]
)
def test_a_sealed_report_of_nonsense_is_refused_in_a_sentence(tmp_path: Path, nonsense: dict[str, Any]) -> None:
    path = passing(tmp_path, **nonsense)
    with pytest.raises(ServoError, match="judge it again"):
        require_judged(path, JUDGED, ARM, "arm.toml")


@pytest.mark.parametrize("rate", [0.5, 1001.0, 1e9, float("nan")])
def test_goals_come_at_a_rate_that_servos_take(rate: float) -> None:
    with pytest.raises(TrajectoryError, match="goals_rate must be in 1 … 1000"):
        replace(GOALS, rate=rate)


def test_calibration_and_bus_are_the_robot_s_own_affair() -> None:
    own = ServoMap("arm", tuple(replace(s, id=s.id + 9, zero=s.zero + 3, sign=-s.sign) for s in ARM.servos), 57600)
    assert own != ARM and own.fingerprint == ARM.fingerprint


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectory_sha256": "0"}, "about another trajectory than .*, or it was edited since"),
        ({"format_version": None, "version": "0.1.0"}, r"a report of another version \(0\.1\.0\)"),
        ({"format_version": 2}, "a report of another version"),
    ],
)
def test_a_report_that_says_something_else_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = passing(tmp_path, **changes)
    with pytest.raises(
        ServoError, match=rf"{message}.*; judge it again: robot-retarget simulate .* --servos arm\.toml"
    ):
        require_judged(path, load_trajectory(path), ARM, "arm.toml")


def test_the_cure_names_the_robot_as_it_was_given(tmp_path: Path) -> None:
    path = passing(tmp_path, mode="pinned", model="own/my.xml")
    with pytest.raises(ServoError, match=r"--robot own/my\.xml --mode free --servos arm\.toml"):
        require_judged(path, load_trajectory(path), ARM, "arm.toml")


def test_another_robots_map_is_named_and_no_command_that_fails(tmp_path: Path) -> None:
    path = passing(tmp_path)
    with pytest.raises(
        ServoError, match=r"of the robot arm, toddler_class of \S+: only one has .* more joints; use --servos"
    ) as error:
        require_judged(path, load_trajectory(path), load_map("toddler_class"), "toddler_class")
    assert "simulate" not in str(error.value)


def test_a_failed_trajectory_is_refused_with_what_helps_and_not_sent_to_fail_again(tmp_path: Path) -> None:
    path = passing(
        tmp_path,
        verdict="fail",
        reasons=["fell: j1 touched the floor"],
        cures=[{"what": "keep both feet in place", "command": "robot-retarget run a.bvh --legs stand"}],
    )
    with pytest.raises(
        ServoError, match=r"did not pass: fell: j1 .*what helps: keep both feet in place: robot-retarget run"
    ) as error:
        require_judged(path, load_trajectory(path), ARM, "arm.toml")
    assert "robot-retarget simulate" not in str(error.value)


def test_a_missing_or_broken_report_is_refused(tmp_path: Path) -> None:
    path = passing(tmp_path)
    for text in ("[1]", "{", "[" * 100_000):
        (tmp_path / "report.json").write_text(text)
        with pytest.raises(ServoError, match=r"no report.*; judge it again"):
            require_judged(path, JUDGED, ARM, "arm.toml")
    (tmp_path / "report.json").unlink()
    with pytest.raises(ServoError, match=r"no report at .*; judge it again"):
        require_judged(path, JUDGED, ARM, "arm.toml")


def test_a_file_without_goals_or_with_edited_ones_is_refused(tmp_path: Path) -> None:
    bare = passing(tmp_path, replace(JUDGED, goals=None))
    with pytest.raises(ServoError, match="holds no goals; judge it again"):
        require_judged(bare, load_trajectory(bare), ARM, "arm.toml")
    path = passing(tmp_path)
    angles = GOALS.angles.copy()
    angles[70, 2] += 1e-6
    edited = replace(JUDGED, goals=replace(GOALS, angles=angles))
    edited.save(path)
    with pytest.raises(ServoError, match="or it was edited since"):
        require_judged(path, edited, ARM, "arm.toml")


OTHER = {
    "robot": replace(ARM, robot="leg"),
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
    held = call("simulate", path, "--robot", "op3", "--mode", "pinned")
    assert held.returncode == 0 and (tmp_path / "report.pinned.json").exists()
    assert call(*play, "--mode", "pinned").returncode == 0
    refused = call(*play)
    assert refused.returncode == 2 and "no report at" in refused.stderr
    command = shlex.split(refused.stderr.replace("\n", " ").partition("judge it again: ")[2])
    assert command[0] == "robot-retarget" and call(*command[1:]).returncode == 0
    goals = load_trajectory(path).goals
    assert goals is not None and goals.lead_in == goals.lead_out == 1.0
    dry = call(*play)
    assert dry.returncode == 0 and json.loads(dry.stdout)["duration_s"] == pytest.approx(2.4)
    slower = call(*play, "--speed", "0.5")
    assert slower.returncode == 2 and "add --plain" in slower.stderr


def test_a_trajectory_as_it_is_needs_a_pass_of_its_own(tmp_path: Path) -> None:
    op3 = load_robot("op3")
    still = hold(op3, 0.4)
    tipped = still.qpos.copy()
    tipped[:, op3.qpos_index[op3.joint_names.index("l_hip_roll")]] += np.linspace(0, 0.5, len(tipped))
    for trajectory, code in ((still, 0), (replace(still, qpos=tipped), 2)):
        path = trajectory.save(tmp_path / "t.npz")
        tried = call("play", path, "--servos", "op3", "--plain", "--speed", "0.5", "--dry-run")
        assert tried.returncode == code
        assert code == 0 or "the trajectory without compensation does not pass: l_hip_roll" in tried.stderr


@pytest.mark.parametrize(("asked", "closed"), [(None, True), (False, False)])
def test_a_trajectory_as_it_is_is_judged_with_the_feedback_that_is_played(asked: bool | None, closed: bool) -> None:
    op3 = load_robot("op3")
    goals = judged_plain(hold(op3, 0.2), op3, "free", RATE, asked).goals
    assert goals is not None and (goals.feedback is not None) == closed
