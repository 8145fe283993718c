"""A draft of a map from a bus: each servo moves a little, and what a person saw makes its joint and its sign."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emulated import ARM, emulated
from typer.testing import CliRunner

from robot_retarget.actuators.map import Stop, load_map
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.drafting import SHIFT, FoundServo, draft
from robot_retarget.servo.outcome import NOTICED, PlaybackEnd, PlaybackOptions, standstill
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import play
from robot_retarget.tools.cli import app
from robot_retarget.tools.cli.console import show_playback

LOCKSTEP = PlaybackOptions(lockstep=True)
RANGES: dict[str, tuple[float, float]] = dict.fromkeys(("j4", "j3", "j2", "j1", "waist"), (-1.5, 1.5))


def test_a_person_who_sees_what_moved_gets_the_map_of_the_arm(tmp_path: Path) -> None:
    with emulated(tmp_path, ARM, "--lockstep", "50") as emulator:
        seen = []

        def person(one: FoundServo) -> str:
            moved = emulator.servos()[one.id]
            servo = ARM[f"j{one.id}"]
            far = max(moved["highest_goal"] - servo.zero, servo.zero - moved["lowest_goal"])
            assert far * 2 * np.pi / 4096 == pytest.approx(SHIFT, abs=0.01) and not moved["torque_enable"]
            seen.append(one.id)
            way = 1 if moved["highest_goal"] - servo.zero > 50 else -1
            return "" if one.id == 4 else f"{servo.joint} {'+' if way * servo.sign > 0 else '-'}"

        found = draft("arm", RANGES, emulator.port, person, (ARM.baud,), 9, LOCKSTEP)
        assert seen == [1, 2, 3, 4] and found.joints == ("j1", "j2", "j3") and found.baud == ARM.baud
        for servo in found.servos:
            known = ARM[servo.joint]
            assert (servo.id, servo.model, servo.sign) == (known.id, known.model, known.sign)
            assert servo.zero == pytest.approx(known.zero, abs=2)
        with pytest.raises(ServoError, match=r"'elbow \+' is no joint with \+ or -; .*known: j4"):
            draft("arm", RANGES, emulator.port, lambda one: "elbow +", (ARM.baud,), 9, LOCKSTEP)
        emulator.do("torque 1")
        with pytest.raises(ServoError, match="servo 1 has torque on"):
            draft("arm", RANGES, emulator.port, lambda one: "", (ARM.baud,), 9, LOCKSTEP)


MODEL = """<mujoco model="arm"><worldbody><body name="trunk"><geom size=".05"/>{}</body></worldbody></mujoco>"""
LINK = """<body><joint name="j{}" axis="0 1 0" range="-80 80"/><geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/></body>"""


def test_the_command_writes_the_draft_and_says_where_positive_is(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "arm.xml").write_text(MODEL.format("".join(LINK.format(k) for k in range(1, 4))))
    with emulated(tmp_path, replace(ARM, servos=ARM.servos[:2], stop=Stop())) as emulator:
        words = ["servos", "map", str(tmp_path / "new.toml"), "--robot", str(tmp_path / "model" / "arm.xml")]
        words += ["--scan", emulator.port, "--baud", "1000000", "--last", "9"]
        result = CliRunner().invoke(app, words, input="j1 -\nj2 +\n")
    assert result.exit_code == 0, result.output
    assert "j1: + turns it down" in result.output and "2 servos; without a servo: j3" in result.output
    assert load_map(tmp_path / "new.toml")["j2"].upper == pytest.approx(np.radians(80))


def test_a_jam_shows_in_what_stood_still_and_slow_or_rough_joints_do_not() -> None:
    plan = 0.4 * np.sin(np.linspace(0, 12, 500))[:, None] * np.ones(4)
    joints = plan.copy()
    joints[200:, 0] = joints[200, 0]
    joints[:, 1] = np.roll(plan[:, 1], 8)
    joints[:, 2] = np.round(plan[:, 2] / 0.09) * 0.09
    plan[300:, 3], joints[303:, 3] = 1.0, 1.0
    found = standstill(plan, joints, 0.008)
    assert found[0] > 0.7 and (found[1:] < NOTICED).all()


@pytest.mark.parametrize(("joint", "travel"), [("r_el", 0.25), ("head_pan", 0.1)])
def test_a_jam_under_physics_holds_the_joint_and_is_noticed_or_named(
    tmp_path: Path, joint: str, travel: float, capsys: pytest.CaptureFixture[str]
) -> None:
    op3 = load_map("op3")
    rest = np.array([op3.stop.pose.get(name, 0.0) for name in op3.joints])
    swing = np.zeros((100, len(op3.joints)))
    swing[:, op3.joints.index(joint)] = travel * np.sin(np.linspace(0, np.pi, 100))
    with emulated(tmp_path, "op3", "--physics", "--lockstep", "125") as emulator:
        before: list[int] = []

        def say(text: str) -> None:
            if text.startswith("playing"):
                emulator.do(f"jam {op3[joint].id}")
                before.append(emulator.servos()[op3[joint].id]["present_position"])

        plan = ServoPlan(rest + swing, 125.0)
        outcome = play(plan, op3, emulator.port, PlaybackOptions(end_pose=False, lockstep=True), say=say)
        after = emulator.servos()[op3[joint].id]["present_position"]
    assert abs(after - before[0]) <= 6
    if travel > NOTICED:
        assert outcome.ended is PlaybackEnd.ASTRAY and outcome.exit_code == 1
        assert f"{joint} stood still while its plan moved by 0.2" in outcome.reason
    else:
        assert outcome.ended is PlaybackEnd.FINISHED and joint in outcome.figures["jams_unnoticed"]
        show_playback(outcome.figures)
        assert re.search(rf"(?s)moved too little to notice a jam .*{joint}", capsys.readouterr().out)
