"""What was judged is what happens: the emulated robot under `play` does what `simulate` said, for more than a second of arms, of legs and of steps.

Time on the emulated bus goes by goals, so that a busy machine changes nothing.
"""

from pathlib import Path

import numpy as np
import pytest
from emulated import emulated

import robot_retarget as rr
from robot_retarget.actuators.map import load_map
from robot_retarget.base.choices import Legs
from robot_retarget.base.files import SAMPLES
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions
from robot_retarget.servo.plan import goal_plan
from robot_retarget.servo.play import play

OP3, OP3_MAP = rr.load_robot("op3"), load_map("op3")
UPRIGHT = 0.9
"""Cosine of the trunk's tilt."""
ASTRAY = 0.01
"""Feet that are put down by hand stand so much elsewhere [m]."""


@pytest.mark.parametrize(("clip", "legs"), [("clap", "stand"), ("squat", "stand"), ("walk", "follow")])
def test_the_emulated_robot_does_what_was_judged(clip: str, legs: Legs, tmp_path: Path) -> None:
    solved = rr.retarget(rr.read_motion(SAMPLES / f"{clip}.bvh").frames(0, 40), OP3, legs=legs, balance="static")
    report = rr.simulate(
        solved.trajectory, OP3, mode="free", draws=0, others=False
    )  # the emulated servos are those modelled
    assert report.trajectory is not None and report.trajectory.goals is not None
    plan, goals = goal_plan(report.trajectory, OP3_MAP), report.trajectory.goals
    with emulated(tmp_path, "op3", "--physics", "--lockstep", str(plan.rate)) as robot:
        first = robot.do("state")["body"]["place"]
        outcome = play(plan, OP3_MAP, robot.port, PlaybackOptions(end_pose=False, lockstep=True), tmp_path / "play.npz")
        body = robot.do("state")["body"]
    assert outcome.ended is PlaybackEnd.FINISHED, outcome.reason
    assert not body["held"] and outcome.figures["limited"] == {}
    assert outcome.figures["tracking_rms_rad"] == pytest.approx(report.figures["tracking_rms_rad"], abs=0.003)
    assert (body["upright"] > UPRIGHT) == (report.figures["fall_s"] is None)
    simulated = report.series["simulated"][:, :2]
    walked = float(np.linalg.norm(simulated[-1] - simulated[0]))
    assert np.linalg.norm(np.subtract(body["place"], first)) == pytest.approx(walked, abs=ASTRAY + 0.1 * walked)
    with np.load(tmp_path / "play.npz") as log:
        playing = log["phase"] == list(log["phases"]).index("play")
        order = [list(log["joint_names"]).index(joint) for joint in OP3.joint_names]
        sent, present = log["goal"][playing][:, order], log["present"][playing][:, order]
    assert goals.feedback is not None
    added, fed = sent - goals.angles, goals.feedback.tilt.any(axis=1)
    assert np.abs(added[:, ~fed]).max() < 1e-9 < np.abs(added[:, fed]).max() < goals.feedback.bound
    frames, judged = report.series["time"], report.series["measured"]
    seen = np.stack([np.interp(frames, goals.times, column) for column in present.T], axis=1)
    assert np.sqrt(((seen - judged) ** 2).mean()) < 0.005
    assert np.abs(seen[-1] - judged[-1]).max() < 0.01
