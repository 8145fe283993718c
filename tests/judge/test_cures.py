"""Each reason of a report names a command that helps: pasted into a shell, it moves the figure."""

import html
import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_trajectories import hold, swing
from shared_files import ROOT
from typer.testing import CliRunner

import robot_retarget as rr
from robot_retarget.judge.cures import CURES, Failing, Origin, cure_of
from robot_retarget.judge.verdict import CHECKS, Thresholds
from robot_retarget.robot import load_robot
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid
from robot_retarget.scores.likeness import UNLIKE
from robot_retarget.tools.cli import app
from robot_retarget.tools.cli.command import line_without
from robot_retarget.tools.cli.options import OUT
from robot_retarget.trajectory import Trajectory


def pasted(command: str) -> None:
    """Run the commands of a line as a shell does: the next only after one that ran (0, or 1 for a verdict)."""
    for words in command.split(" && "):
        program, *arguments = shlex.split(words)
        done = CliRunner().invoke(app, arguments)
        assert program == "robot-retarget" and isinstance(done.exception, SystemExit | None), (
            f"{words}\n{done.output}\n{done.exception}"
        )


def written(command: str) -> dict[str, Any]:
    """The report that a line of commands writes last."""
    pasted(command)
    words = shlex.split(command)
    place = (
        words[words.index("--report") + 1] if "--report" in words else f"{words[words.index('--out') + 1]}/report.json"
    )
    return json.loads(Path(place).read_text(encoding="utf-8"))


def moved(joint: str, size: float, hertz: float) -> Callable[[], Trajectory]:
    return lambda: swing(load_robot("op3"), joint, size, hertz, 1.2, 30.0)


FAST, WIDE = moved("l_sho_pitch", 1.2, 2.0), moved("l_sho_roll", 0.9, 0.5)
ASIDE, STILL = moved("l_hip_roll", 0.5, 0.6), moved("l_hip_roll", 0.0, 1.0)
EXAMPLES = [
    # What fails, in which mode and under which threshold, and the figures that the cure moves.
    ("tracking_rms", FAST, "pinned", {}, ("worst_joint_rms_rad", "speed_ratio")),
    ("saturated_share", ASIDE, "free", {"saturated_share": 0.2}, ("saturated_share", "goal_step_rad")),
    ("temperature_rise", STILL, "free", {"temperature_rise": 0.1}, ("temperature_rise_K",)),
    ("penetration", WIDE, "pinned", {}, ("self_contact_depth_m", "range_excess_rad")),
    ("fell", moved("r_hip_pitch", 0.6, 0.8), "free", {}, ("fall_s",)),
    ("foot_slip", moved("r_hip_pitch", 0.4, 0.8), "free", {"foot_slip": 0.002}, ("foot_slip_m",)),
]


@pytest.mark.parametrize(("kind", "make", "mode", "limits", "moves"), EXAMPLES)
def test_the_command_beside_a_reason_moves_its_figure(
    kind: str,
    make: Callable[[], Trajectory],
    mode: str,
    limits: dict[str, float],
    moves: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    make().save("t.npz")
    Path("limits.toml").write_text("".join(f"{name} = {value}\n" for name, value in limits.items()))
    before, command = judged(kind, replace(Thresholds(), **limits), "--mode", mode, "--thresholds", "limits.toml")
    assert "--thresholds limits.toml" in command
    after = written(command)["figures"]
    for figure in moves:
        assert after[figure] is None if figure == "fall_s" else after[figure] < 0.95 * before[figure], figure


def judged(kind: str, most: Thresholds, *options: str) -> tuple[dict[str, Any], str]:
    """The figures of `t.npz`, which fails, and the command that its report has beside the reason of a kind."""
    pasted(
        shlex.join(
            ["robot-retarget", "simulate", "t.npz", "--robot", "op3", "--draws", "0", "--report", "t.json", *options]
        )
    )
    before = json.loads(Path("t.json").read_text(encoding="utf-8"))
    told = [cure["reason"] for cure in before["cures"]]
    assert before["verdict"] == "fail" and told == [*before["reasons"], *(before["unlike"] or ())]
    wanted = cure_of("", kind, Failing(before["figures"], most, Origin("t.npz", "op3"))).what
    [command] = {cure["command"] for cure in before["cures"] if cure["what"] == wanted}
    return before["figures"], command


def test_an_object_that_friction_does_not_hold_is_carried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    box = RigidBody(
        "box", solid(ShapeKind.BOX, (0.04, 0.04, 0.06)), np.tile([0.2, 0, 0.3, 1, 0, 0, 0], (31, 1)), mass=0.1
    )
    replace(hold(load_robot("op3"), 1.0, 30.0), scene=Scene((box,))).save("t.npz")
    before, command = judged("dropped", Thresholds(), "--mode", "pinned", "--objects", "free")
    assert before["objects"]["box"]["dropped_s"] is not None
    assert "--objects carried" in command and "objects" not in written(f"{command} --report t.json")["figures"]


def test_feedback_that_oscillates_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    hold(load_robot("op3"), 3.0).save("t.npz")
    text = (ROOT / "models/op3/servos.toml").read_text(encoding="utf-8")
    for part in ("pitch", "roll"):
        text = re.sub(
            rf"^([lr])_ank_{part} = {{.*",
            rf"\1_hip_{part} = {{ rate = {1.0 * (part == 'pitch')}, tilt = {5.0 * (part == 'pitch')} }}",
            text,
            flags=re.M,
        )
    Path("wild.toml").write_text(text, encoding="utf-8")
    before, command = judged("oscillates", Thresholds(), "--mode", "free", "--servos", "wild.toml")
    assert before["feedback_oscillation_rad"] > 0
    assert "feedback_oscillation_rad" not in written(f"{command} --report t.json")["figures"]


def test_options_of_cures_bring_the_motion_nearer_to_the_human() -> None:
    """Solved without a simulation: `run` adds nothing to these figures."""
    walk, clap = (
        rr.read_motion(ROOT / f"samples/{name}.bvh").frames(*part)
        for name, part in (("walk", (0, 60)), ("clap", (20, 40)))
    )
    static = rr.retarget(walk, "op3", balance="static").trajectory.likeness
    told = {
        value_of("--balance", kind, mode="free", balance="static")
        for kind in ("unlike_slowdown", "unlike_legs", "path_off", "steps_shortened")
    }
    then = rr.retarget(walk, "op3", balance=told.pop()).trajectory.likeness  # type: ignore[arg-type]
    assert not told
    for figure in ("slowdown", "limb_rad_legs", "path_off", "steps_shortened"):
        assert then[figure] < 0.9 * static[figure], figure
    scores = {}
    for kind in ("unlike_arms", "contacts_lost"):
        favoured = rr.retarget(clap, "op3", balance="off", preset=value_of("--favour", kind, mode="pinned"))  # type: ignore[arg-type]
        scores[kind] = rr.score(favoured.trajectory, "op3", clap).figures
    assert scores["unlike_arms"]["limb_deg_mean"] < 0.95 * scores["contacts_lost"]["limb_deg_mean"]
    assert scores["contacts_lost"]["near_err"] < 0.95 * scores["unlike_arms"]["near_err"]


def value_of(option: str, kind: str, **figures: str) -> str:
    """The value that a cure gives an option of `run`."""
    words = shlex.split(cure_of("", kind, Failing(figures, Thresholds(), Origin())).command)
    return words[words.index(option) + 1]


def test_a_motion_that_no_robot_plays_standing_is_held_by_the_pelvis() -> None:
    figures = {"mode": "free", "balance": "static", "not_standing": "a seat holds the human up", "legs": "instead"}
    cure = cure_of(
        "",
        "path_off",
        Failing(figures, Thresholds(), Origin("out/trajectory.npz", "op3", run="robot-retarget run a.bvh")),
    )
    assert cure.command == "robot-retarget run a.bvh --balance off --out out-held"
    assert "pelvis" in cure.what


FIGURES = {
    "mode": "free", "fps": 30.0, "duration_s": 3.0, "worst_joint_rms_rad": 0.3, "speed_ratio": 3.0, "saturated_share": 0.9, "goal_step_rad": 0.6,
    "goal_step_limit_rad": 0.5, "temperature_rise_K": 80.0, "ankle_stiffness_Nm_rad": 2.0, "tipping_stiffness_Nm_rad": 9.0,
}  # fmt: skip


@pytest.mark.parametrize("kind", CURES)
@pytest.mark.parametrize("mode", ["free", "pinned"])
def test_every_cure_is_a_command_whose_options_exist(kind: str, mode: str) -> None:
    origins = (
        Origin("out/trajectory.npz", "op3", run="robot-retarget run a.bvh --robot op3"),
        Origin("my clip.npz", "op3", "a.bvh"),
    )
    for origin in origins:
        cure = cure_of("it fails", kind, Failing({**FIGURES, "mode": mode}, Thresholds(), origin))
        assert cure.reason == "it fails" and cure.what
        for words in cure.command.split(" && "):
            program, *arguments = shlex.split(words)
            name = arguments[: 2 if arguments[0] == "edit" else 1]
            options = help_of(*name)
            assert program == "robot-retarget" and all(word in options for word in arguments if word.startswith("-"))


@cache
def help_of(*command: str) -> str:
    return CliRunner().invoke(app, [*command, "--help"]).output


def test_a_cure_of_a_run_repeats_its_options_but_for_its_folder() -> None:
    given = "run no.bvh --robot op3 --out=there --json -q --frames 0:30 --legs follow -o here"
    assert CliRunner().invoke(app, shlex.split(given)).exception
    kept = line_without(OUT, ("--json", "--quiet", "-q", "--video"))
    assert kept == shlex.split("run no.bvh --robot op3 --frames 0:30 --legs follow")
    origin = Origin("here/trajectory.npz", "op3", run=shlex.join(["robot-retarget", *kept]))
    cure = cure_of("it falls", "fell", Failing({"mode": "free", "legs": "follow"}, Thresholds(), origin))
    assert cure.command == "robot-retarget run no.bvh --robot op3 --frames 0:30 --legs stand --out here-stand"


def test_under_a_policy_a_motion_is_slowed_without_balance_of_its_own_and_followed_again() -> None:
    origin = Origin("t.npz", "g1.xml", judge="--robot g1.xml --policy walker.onnx")
    figures = {"mode": "free", "policy": "walker"}
    command = cure_of("it falls", "fell", Failing(figures, Thresholds(), origin)).command
    assert "--balance off" in command and "--policy walker.onnx --report t-slower.json" in command


def test_every_limit_and_every_difference_has_a_cure() -> None:
    assert {check.threshold for check in (*CHECKS, *UNLIKE)} <= set(CURES)


def test_reasons_with_their_cures_stand_beside_one_another_in_every_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    WIDE().save("t.npz")
    line = "simulate t.npz --robot op3 --draws 0 --page t.html --report t.json"
    said = CliRunner().invoke(app, shlex.split(line)).output
    page = html.unescape(Path("t.html").read_text(encoding="utf-8"))
    cures = json.loads(Path("t.json").read_text(encoding="utf-8"))["cures"]
    assert len({cure["command"] for cure in cures}) > 1
    for text in (said, page[page.index('class="reasons"') :]):
        for cure in cures:
            below = text[text.index(cure["reason"], text.index(cures[0]["reason"])) :]
            others = [below.find(other["command"]) for other in cures if other["command"] != cure["command"]]
            assert 0 < below.index(cure["command"]) < min([at for at in others if at > 0], default=len(below))
