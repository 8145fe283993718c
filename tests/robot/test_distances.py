"""Distances between links are those that MuJoCo gives geom by geom; the pairs are all that it lets touch."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from made_trajectories import robot_of, wander
from shared_files import SHARED, needs_shared

from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.contacts import reference_overlaps
from robot_retarget.robot.distances import LinkDistances
from robot_retarget.robot.geoms import allowed

ROBOTS = ["op3", *(f"{name}/{name}.xml" for name in ("unitree_g1", "booster_t1", "robotis_op3"))]


def robot_named(name: str) -> Robot:
    return load_robot(name if name == "op3" else SHARED / "robots" / name)


def one_by_one(robot: Robot, links: LinkDistances, qpos: np.ndarray) -> np.ndarray:
    """(P,) the least of MuJoCo's distances over the pairs of geoms of every pair of links, up to the reach."""
    model, data, table = robot.model, mujoco.MjData(robot.model), allowed(robot)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    found = np.full(len(links), links.reach)
    for p, pair in enumerate(map(tuple, links.links.tolist())):
        for a, b in table[pair]:
            found[p] = min(found[p], mujoco.mj_geomDistance(model, data, a, b, links.reach, None))
    return found


@needs_shared
@pytest.mark.parametrize("name", ROBOTS)
def test_near_links_are_as_far_apart_as_mujoco_says_geom_by_geom(name: str) -> None:
    robot = robot_named(name)
    links, rest = LinkDistances(robot), LinkDistances(robot).along(robot.neutral()[None])[0]
    compared = 0
    for qpos in wander(robot, 6, 5.0).qpos:
        found, exact = links.along(qpos[None])[0], one_by_one(robot, links, qpos)
        near = (exact > 0) & (exact < links.reach - 1e-3) & (rest > 1e-3)
        assert np.abs(found - exact)[near].max(initial=0.0) < 5e-4
        compared += int(near.sum())
    assert compared > 5


def test_moving_the_whole_robot_changes_no_distance() -> None:
    robot = load_robot("op3")
    links, still = LinkDistances(robot), wander(robot, 3, 5.0).qpos
    moved = still.copy()
    moved[:, :3] += [5.0, -2.0, 0.3]
    moved[:, 3:7] = [0.5, 0.5, 0.5, 0.5]
    assert np.array_equal(links.along(still), links.along(moved))


def test_explicit_pairs_alone_are_watched_and_of_a_model_that_lets_nothing_touch_all_that_is_seen(
    tmp_path: Path,
) -> None:
    arm = '<body name="{0}" pos="{1} 0 0"><joint name="{0}" axis="0 1 0"/><geom name="{0}" type="capsule" size=".05" '
    arms = (arm + 'fromto="0 0 0 0 0 .8" contype="0" conaffinity="0"/></body>').format
    bodies = f"<worldbody>{arms('left', -0.3)}{arms('middle', 0)}{arms('right', 0.3)}</worldbody>"
    seen = robot_of(f"<mujoco>{bodies}</mujoco>", tmp_path / "seen.xml")
    pair = '<contact><pair geom1="left" geom2="right"/></contact>'
    paired = robot_of(f"<mujoco>{bodies}{pair}</mujoco>", tmp_path / "paired.xml")
    every = [("left", "middle"), ("left", "right"), ("middle", "right")]
    assert LinkDistances(seen).names == every
    leaning = np.array([0.3, 0.0, -0.3])  # the outer ones lean inwards, through the middle one
    assert LinkDistances(seen).along(leaning[None])[0].min() < LinkDistances(seen).reach
    distance = dict(zip(LinkDistances(paired).names, LinkDistances(paired).along(leaning[None])[0], strict=True))
    assert {names for names, d in distance.items() if d < LinkDistances(paired).reach} <= {("left", "right")}


@needs_shared
@pytest.mark.parametrize("name", ROBOTS)
def test_pairs_watched_are_all_that_mujoco_lets_touch(name: str) -> None:
    robot = robot_named(name)
    model, data, draw = robot.model, mujoco.MjData(robot.model), np.random.default_rng(5)
    watched = {tuple(pair) for pair in LinkDistances(robot).links.tolist()}
    built = reference_overlaps(robot)
    data.qpos[:] = robot.neutral()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    built |= {tuple(sorted(model.geom_bodyid[pair].tolist())) for pair in data.contact.geom}
    for _ in range(150):
        data.qpos[robot.qpos_index] = draw.uniform(robot.lower, robot.upper)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        bodies = np.sort(model.geom_bodyid[data.contact.geom[data.contact.dist < 0]], axis=1)
        touching = {(int(a), int(b)) for a, b in bodies if a > 0} - built
        assert {tuple(sorted(model.body_weldid[list(pair)].tolist())) for pair in touching} <= watched
