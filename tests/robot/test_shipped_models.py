"""The shipped G1-class and ToddlerBot-class robots: published numbers, symmetry, stand, recognition, names."""

import mujoco
import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.actuators.map import load_map
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.robot import load_robot, recognise, shipped_robots
from robot_retarget.robot.catalog import humanoids, resolved

OURS = {
    "g1_class": ("unitree_g1/unitree_g1.xml", 29, 1.3),
    "toddler_class": ("toddlerbot_2xc/toddlerbot_2xc.xml", 30, 0.55),
}


@pytest.fixture(scope="module", params=OURS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def height_of(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, float]:
    low = [
        data.geom_xpos[g][2] - (np.abs(data.geom_xmat[g].reshape(3, 3)) @ model.geom_aabb[g, 3:])[2]
        for g in range(model.ngeom)
    ]
    top = [
        data.geom_xpos[g][2] + (np.abs(data.geom_xmat[g].reshape(3, 3)) @ model.geom_aabb[g, 3:])[2]
        for g in range(model.ngeom)
    ]
    return min(low), max(top)


def test_size_and_joints_are_as_stated(name: str) -> None:
    robot = load_robot(name)
    _, joints, tall = OURS[name]
    data = mujoco.MjData(robot.model)
    mujoco.mj_forward(robot.model, data)
    low, top = height_of(robot.model, data)
    assert len(robot.joint_names) == robot.model.nu == joints
    assert abs(low) < 1e-4 and abs(top - low - tall) < 0.06 * tall
    assert not robot.model.nmesh


def test_every_keypoint_is_found_and_the_robot_looks_along_x(name: str) -> None:
    anatomy = recognise(load_robot(name))
    assert set(anatomy.names) == set(KEYPOINTS) and set(anatomy.soles) == {"l", "r"}
    np.testing.assert_allclose(anatomy.forward, [1, 0, 0], atol=1e-6)
    assert not anatomy.notes


def test_sides_mirror_each_other(name: str) -> None:
    model = load_robot(name).model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    flip = np.array([1, -1, 1])
    for b in range(1, model.nbody):
        if model.body(b).name.startswith("left_"):
            other = model.body(model.body(b).name.replace("left_", "right_")).id
            np.testing.assert_allclose(data.xpos[other], data.xpos[b] * flip, atol=1e-6)
            np.testing.assert_allclose(data.xipos[other], data.xipos[b] * flip, atol=1e-6)
            assert model.body_mass[other] == model.body_mass[b]


def test_the_standing_keyframe_touches_nothing_but_the_floor(name: str) -> None:
    robot = load_robot(name)
    model = mujoco.MjModel.from_xml_path(str(robot.path.with_name("scene.xml")))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    data.qpos[2] -= 5e-4  # keyframes are rounded
    mujoco.mj_forward(model, data)
    assert data.ncon and all(0 in model.geom_bodyid[[c.geom1, c.geom2]] for c in data.contact)
    assert max(abs(c.dist) for c in data.contact) < 1e-3


@needs_shared
def test_joints_stand_where_the_published_model_puts_them(name: str) -> None:
    ours = load_robot(name).model
    theirs = mujoco.MjModel.from_xml_path(str(SHARED / "robots" / OURS[name][0]))
    assert abs(ours.body_mass.sum() - theirs.body_mass.sum()) < 1e-3
    places = []
    for model in (ours, theirs):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        names = {model.joint(j).name.removesuffix("_driven"): j for j in range(1, model.njnt)}
        places.append({n: (data.xanchor[j], model.jnt_range[j]) for n, j in names.items()})
    origin = [p[next(n for n in p if n.startswith("left_hip_pitch"))][0] for p in places]
    shared = [n for n in places[0] if n in places[1] and not n.startswith("right_")]
    assert len(shared) >= 15
    for n in shared:
        np.testing.assert_allclose(places[0][n][0] - origin[0], places[1][n][0] - origin[1], atol=2e-4, err_msg=n)
        np.testing.assert_allclose(places[0][n][1], np.clip(places[1][n][1], -3.1415, 3.1415), atol=2e-3, err_msg=n)


def test_shipped_names_are_no_names_of_robot_descriptions() -> None:
    descriptions = pytest.importorskip("robot_descriptions._descriptions", reason="needs robot_descriptions")
    entries = humanoids(descriptions.DESCRIPTIONS)
    assert resolved("g1", entries) == "g1_mj_description"
    assert not [ours for ours in shipped_robots() if ours != "op3" and resolved(ours, entries)]


def test_the_servo_map_covers_the_toddler_class() -> None:
    servo_map, robot = load_map("toddler_class"), load_robot("toddler_class")
    assert set(servo_map.joints) == set(robot.joint_names) and robot.servo_map == servo_map
