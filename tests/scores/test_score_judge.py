"""Scores equal those of an independent judge, to the digits that it prints."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from judged_files import ROBOTS, judge, map_file, points, robot_file, skeleton
from scipy.ndimage import median_filter
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.scores.score import score, subject_of
from robot_retarget.scores.subject import Subject

CLIPS = (("fair1_zup/dab.bvh", "fair1"), ("cmu_cgspeed_motionbuilder/05_06_dance.bvh", "cmu"))


def wandering(robot: rr.Robot, frames: int, seed: int) -> rr.Trajectory:
    """A robot that reels over the floor, through it and through itself, its joints past their ranges at times."""
    random = np.random.default_rng(seed)
    qpos = np.tile(robot.neutral(), (frames, 1))
    walk = np.cumsum(random.normal(0, 0.3, (frames, len(robot.joint_names))), axis=0)
    qpos[:, robot.qpos_index] += walk
    qpos[:, :3] += np.cumsum(random.normal(0, 0.004, (frames, 3)), axis=0)
    qpos[:, 3:7] += np.cumsum(random.normal(0, 0.03, (frames, 4)), axis=0)
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    return rr.Trajectory(qpos, 30.0, robot.joint_names, robot.name)


def planted_as_judged(subject: Subject) -> np.ndarray:
    """(T, 2) the judge's own rule of planted feet: a toe of the human that is slow and low."""
    pair = subject.pair
    leg, toes = pair.match.human_leg, pair.human[:, [pair.index("l_toe"), pair.index("r_toe")]]
    speed = np.zeros(toes.shape[:2])
    speed[1:] = np.linalg.norm(np.diff(toes, axis=0), axis=2) * subject.fps / leg
    still = (speed < 0.2) & (toes[:, :, 2] < np.percentile(toes[:, :, 2], 2) + 0.08 * leg)
    planted = median_filter(still.astype(np.uint8), (5, 1)).astype(bool)
    planted[0] = False
    return planted


@needs_shared
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(("clip", "skeleton_name"), CLIPS, ids=["dab", "dance"])
def test_figures_equal_those_of_the_judge(tmp_path: Path, name: str, clip: str, skeleton_name: str) -> None:
    motion = rr.read_motion(SHARED / "motions/bvh" / clip, repair=False)
    robot, reference = rr.load_robot(str(robot_file(name))), judge()
    trajectory = wandering(robot, 60, seed=len(clip))
    trajectory = replace(trajectory, source_time=motion.source_time[0] + trajectory.source_time)
    joints = skeleton(skeleton_name)
    human, dt = reference.human_keypoints(SHARED / "motions/bvh" / clip, joints)
    human = human[len(human) - len(motion) :]  # reading drops calibration frames at the start
    expected = reference.judge(
        human, dt, mujoco.MjModel.from_xml_path(str(robot_file(name))), points(name), trajectory.qpos, trajectory.fps
    )
    found = score(trajectory, robot, motion, overrides=map_file(tmp_path, joints["joints"], points(name)["points"]))
    assert found.frames == expected.pop("frames")
    subject, _ = subject_of(trajectory, robot, motion, map_file(tmp_path, joints["joints"], points(name)["points"]))
    planted = planted_as_judged(subject)
    assert expected["planted_frames"] is not None and int(planted.sum()) == expected.pop("planted_frames")
    slid = subject.slip[planted]
    assert round(100 * slid.mean() if slid.size else 0.0, 2) == expected.pop("skate_cm_s")
    # As the judge counts them: of any duration, and by keypoints alone.
    touches = replace(subject.pair, fps=0.0, model=None).touches
    assert expected.pop("contact_recall") == (None if touches.share is None else round(touches.share, 3))
    hit, false, made = (int(which.sum()) for which in (touches.kept, touches.false, touches.human))
    assert expected.pop("contact_f1") == (round(2 * hit / (hit + false + made), 3) if made else None)
    expected.pop("contact_frames", None)
    assert {key: found.figures[key] for key in expected} == expected
    assert expected["self_pen_pct"]
    assert expected["limit_frames"] or not robot.model.jnt_limited[robot.joint_ids].any()
