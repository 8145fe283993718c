"""Scores equal those of an independent judge, to the digits that it prints."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from judged_files import ROBOTS, judge, map_file, points, robot_file, skeleton
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.scores.score import score

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
    assert {key: found.figures[key] for key in expected} == expected
    assert expected["self_pen_pct"] and expected["planted_frames"] is not None
    assert expected["limit_frames"] or not robot.model.jnt_limited[robot.joint_ids].any()
