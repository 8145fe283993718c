"""The standing pose of a model without a standing keyframe."""

from pathlib import Path

import numpy as np
import pytest

import robot_retarget as rr
from robot_retarget.base.arrays import unit
from robot_retarget.robot import Robot, recognise, world_points
from robot_retarget.robot.distances import Separation


@pytest.fixture(scope="module")
def keyless(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """The OP3, whose zero is a T-pose, without its keyframe."""
    spec, path = rr.load_robot("op3").spec(), Path(tmp_path_factory.mktemp("robot")) / "keyless.xml"
    for key in list(spec.keys):
        spec.delete(key)
    path.write_text(spec.to_xml())
    return rr.load_robot(str(path))


def bones(robot: Robot, qpos: np.ndarray) -> np.ndarray:
    """(4, 3) directions of both upper arms and forearms."""
    points = recognise(robot).points_of([f"{s}_{part}" for s in "lr" for part in ("shoulder", "elbow", "hand")])
    places = world_points(robot, points, qpos[None])[0].reshape(2, 3, 3)
    return unit(np.diff(places, axis=1)).reshape(4, 3)


def test_arms_of_a_t_pose_hang_as_in_the_keyframe_of_the_maker(keyless: Robot) -> None:
    op3 = rr.load_robot("op3")
    made, found = bones(op3, op3.standing()), bones(keyless, keyless.standing())
    assert np.abs(bones(keyless, keyless.neutral())[:, 2]).max() < 0.1
    assert np.degrees(np.arccos((made * found).sum(axis=1))).max() < 20
    legs = [k for k, name in enumerate(keyless.joint_names) if "sho" not in name and not name.endswith("_el")]
    np.testing.assert_array_equal(keyless.standing()[keyless.qpos_index[legs]], 0.0)


def test_links_may_be_as_near_as_in_the_standing_pose(keyless: Robot) -> None:
    """Shoulders are nearer to the chest with arms down than in a T-pose: balance would lift the arms by its margin."""
    links = Separation(keyless, 0.04)
    found = links.distances(keyless.standing()[None])
    assert (found.distance >= links.rest[tuple(found.geoms.T)] - 1e-12).all()


def test_a_stand_of_the_model_is_kept() -> None:
    g1 = rr.load_robot("g1_class")
    np.testing.assert_array_equal(g1.standing(), g1.model.key("stand").qpos)
