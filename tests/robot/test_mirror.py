"""Seen in a mirror, a robot is the robot with its hinges exchanged; its keypoints say so."""

from pathlib import Path

import numpy as np
import pytest
from made_trajectories import robot_of
from shared_files import SHARED, needs_shared

from robot_retarget.robot import load_robot, recognise, world_points
from robot_retarget.robot.anatomy import mirror_of

LEFT = np.array([0.0, 1.0, 0.0])


ROBOTS = ("unitree_g1", "unitree_h1", "booster_t1", "robotis_op3", "toddlerbot_2xc")


def swapped(name: str) -> str:
    return {"l": "r", "r": "l"}[name[0]] + name[1:] if name[1:2] == "_" else name


def robots() -> list:
    shared = [SHARED / f"robots/{name}/{name}.xml" for name in ROBOTS]
    return ["op3", *[pytest.param(str(path), marks=needs_shared, id=path.stem) for path in shared]]


@pytest.mark.parametrize("name", robots())
def test_mirrored_hinges_put_mirrored_keypoints_on_the_other_side(name: str) -> None:
    robot = load_robot(name)
    mirror, anatomy = mirror_of(robot, LEFT), recognise(robot)
    assert (mirror.partner >= 0).all() and (mirror.partner[mirror.partner] == np.arange(len(mirror.partner))).all()
    draw = np.random.default_rng(1)
    here = np.tile(robot.neutral(), (5, 1))
    here[:, robot.qpos_index] += draw.normal(scale=0.3, size=(5, len(robot.lower)))
    there = here.copy()
    there[:, robot.qpos_index] = mirror.angles(here[:, robot.qpos_index])
    order = [anatomy.names.index(swapped(k)) for k in anatomy.names]
    reflected = world_points(robot, anatomy.points, here)[:, order] * [1, -1, 1]
    size = np.ptp(reflected, axis=(0, 1)).max()
    assert np.abs(reflected - world_points(robot, anatomy.points, there)).max() < 1e-4 * size


@pytest.mark.parametrize("name", robots())
def test_soles_are_alike_however_their_meshes_were_drawn(name: str) -> None:
    robot = load_robot(name)
    soles = recognise(robot).soles
    places = {side: world_points(robot, soles[side], robot.neutral()[None])[0] for side in "lr"}
    apart = np.linalg.norm((places["l"] * [1, -1, 1])[:, None] - places["r"], axis=2)
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 5e-5


def test_a_hinge_without_a_counterpart_is_told(tmp_path: Path) -> None:
    one_arm = (
        '<mujoco><worldbody><body><geom size=".1"/><body pos="0 .2 0"><joint name="arm" axis="1 0 0" range="-1 1"/>'
        '<geom size=".1"/></body></body></worldbody></mujoco>'
    )
    assert mirror_of(robot_of(one_arm, tmp_path / "one_arm.xml"), LEFT).partner.tolist() == [-1]
