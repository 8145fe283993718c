"""The shipped OP3-class robot: its published numbers, its symmetry, its stand."""

import math

import mujoco
import numpy as np
import pytest
from shared_files import ROOT, SHARED, needs_shared

SCENE = ROOT / "models" / "op3" / "scene.xml"
REFERENCE = SHARED / "robots" / "robotis_op3" / "robotis_op3.xml"
FEET = {"l_ank_roll_link", "r_ank_roll_link"}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(SCENE))


@pytest.fixture
def data(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    mujoco.mj_forward(model, data)
    return data


def hinges(model: mujoco.MjModel) -> list[str]:
    return [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]


def body_names(model: mujoco.MjModel) -> list[str]:
    return [model.body(b).name for b in range(1, model.nbody)]


def touching(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[str, ...]]:
    """The pairs of bodies that overlap by more than nothing, names in order."""
    pairs = ((c.geom1, c.geom2) for c in data.contact if c.dist < 0)
    return {tuple(sorted(model.body(model.geom_bodyid[geom]).name for geom in pair)) for pair in pairs}


def other_side(name: str) -> str:
    return {"l_": "r_", "r_": "l_"}.get(name[:2], name[:2]) + name[2:]


def random_poses(model: mujoco.MjModel, count: int) -> np.ndarray:
    """Free roots anywhere and hinges anywhere in their ranges, (count, nq)."""
    rng = np.random.default_rng(7)
    quaternions = rng.normal(size=(count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    angles = rng.uniform(*model.jnt_range[1:].T, size=(count, model.nq - 7))
    return np.hstack([rng.normal(size=(count, 3)), quaternions, angles])


def places(model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World positions (B, 3) and rotation matrices (B, 3, 3) of every body but the world."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return data.xpos[1:].copy(), data.xmat[1:].reshape(-1, 3, 3).copy()


@needs_shared
def test_every_body_stands_where_the_published_model_puts_it(model):
    reference = mujoco.MjModel.from_xml_path(str(REFERENCE))
    assert body_names(model) == body_names(reference)
    assert hinges(model) == hinges(reference)
    for qpos in random_poses(model, 200):
        for ours, theirs in zip(places(model, qpos), places(reference, qpos), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6)


@needs_shared
def test_every_body_has_the_published_mass_centre_and_principal_inertia(model):
    reference = mujoco.MjModel.from_xml_path(str(REFERENCE))
    np.testing.assert_allclose(model.body_mass, reference.body_mass, rtol=0, atol=1e-9)
    np.testing.assert_allclose(model.body_ipos, reference.body_ipos, rtol=0, atol=1e-9)
    ours, theirs = np.sort(model.body_inertia), np.sort(reference.body_inertia)
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=0)


def test_the_robot_weighs_what_its_parts_weigh(model):
    assert model.body("body_link").subtreemass[0] == pytest.approx(3.1475, abs=5e-5)


def test_the_robot_is_half_a_metre_tall(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.site("l_sole").xpos[2] == pytest.approx(0, abs=1e-6)
    assert data.site("head").xpos[2] == pytest.approx(0.51, abs=0.005)


def test_every_hinge_has_a_range_that_is_mirrored_on_the_right(model):
    """`test_op3_ranges` has the ranges."""
    assert all(model.jnt_limited[1:])
    for name in hinges(model):
        mirror = model.joint(other_side(name)).range
        expected = model.joint(name).range if name == "head_tilt" else np.sort(-model.joint(name).range)
        np.testing.assert_array_equal(mirror, expected)


def test_every_joint_has_the_identified_servo(model):
    joints = [model.joint(j).name for j in model.actuator_trnid[:, 0]]
    assert joints == hinges(model)
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], 21.1)
    np.testing.assert_allclose(model.actuator_biasprm[:, :3], [[0, -21.1, 0]] * model.nu)
    np.testing.assert_array_equal(model.actuator_forcerange, [[-4.1, 4.1]] * model.nu)
    np.testing.assert_allclose(model.actuator_ctrlrange, model.jnt_range[1:], rtol=1e-12)
    np.testing.assert_allclose(model.dof_damping[6:], 1.084)
    np.testing.assert_allclose(model.dof_armature[6:], 0.045)
    np.testing.assert_allclose(model.dof_frictionloss[6:], 0.03)
    assert not model.dof_damping[:6].any() and not model.dof_armature[:6].any()


def test_mirrored_angles_give_the_mirrored_body(model):
    names, angles = body_names(model), hinges(model)
    swap = [names.index(other_side(name)) for name in names]
    sign = np.array([-1.0 if name != "head_tilt" else 1.0 for name in angles])
    turn = [angles.index(other_side(name)) for name in angles]
    mirror = np.diag([1.0, -1.0, 1.0])
    head = names.index("head_tilt_link")  # its frame stands beside the middle, so only its turning is mirrored
    for qpos in random_poses(model, 50):
        qpos[:7] = model.qpos0[:7]
        flipped = np.concatenate([qpos[:7], (sign * qpos[7:][turn])])
        (positions, rotations), (other_positions, other_rotations) = places(model, qpos), places(model, flipped)
        expected = np.delete(positions[swap] @ mirror, head, axis=0)
        np.testing.assert_allclose(np.delete(other_positions, head, axis=0), expected, atol=1e-9)
        np.testing.assert_allclose(other_rotations, mirror @ rotations[swap] @ mirror, atol=1e-9)


def test_shapes_are_mirrored_from_side_to_side(model):
    def shapes(side: str) -> dict[str, list[tuple]]:
        found: dict[str, list[tuple]] = {}
        for geom in range(model.ngeom):
            name = model.body(model.geom_bodyid[geom]).name
            if name.startswith(side):
                place = model.geom_pos[geom] * (1, 1 if side == "l_" else -1, 1) + 0.0
                found.setdefault(name[2:], []).append((*place.round(6), *model.geom_size[geom].round(6)))
        return found

    assert shapes("l_") == shapes("r_")


def test_shapes_carry_no_mass_of_their_own(model):
    spec = mujoco.MjSpec.from_file(str(SCENE))
    assert all(geom.mass == 0 for geom in spec.geoms if geom.name != "floor")


def test_no_part_touches_another_at_zero_or_at_stand(model, data):
    assert touching(model, data) <= {("l_ank_roll_link", "world"), ("r_ank_roll_link", "world")}
    data.qpos[:] = model.qpos0
    mujoco.mj_forward(model, data)
    assert touching(model, data) <= {("l_ank_roll_link", "world"), ("r_ank_roll_link", "world")}


def test_limbs_that_cross_are_seen_to_collide(model, data):
    data.joint("l_hip_roll").qpos[0], data.joint("r_hip_roll").qpos[0] = 0.5, -0.5
    mujoco.mj_forward(model, data)
    legs_crossed = touching(model, data)
    data.joint("l_hip_roll").qpos[0], data.joint("r_hip_roll").qpos[0] = -0.3, 0.3
    mujoco.mj_forward(model, data)
    legs_apart = touching(model, data)
    assert ("l_hip_pitch_link", "r_hip_pitch_link") in legs_crossed
    assert ("l_hip_pitch_link", "r_hip_pitch_link") not in legs_apart


def test_hands_meet_in_front_and_nothing_else_touches(model):
    data = mujoco.MjData(model)
    data.qpos[:] = model.key("stand").qpos
    for side, sign in (("l", 1), ("r", -1)):
        for joint, angle in (("sho_pitch", -math.pi / 2), ("sho_roll", 1.1), ("el", -1.3)):
            data.joint(f"{side}_{joint}").qpos[0] = sign * angle
    mujoco.mj_forward(model, data)
    assert touching(model, data) <= {("l_ank_roll_link", "world"), ("r_ank_roll_link", "world")}
    gap = np.linalg.norm(data.site("l_hand").xpos - data.site("r_hand").xpos)
    assert gap < 0.05


def test_feet_are_flat_and_the_weight_is_above_them_at_stand(data):
    for side in "lr":
        corners = np.array([data.site(f"{side}_sole_{corner}").xpos for corner in range(1, 5)])
        np.testing.assert_allclose(corners[:, 2], 0, atol=1e-6)
        np.testing.assert_allclose(corners.mean(axis=0), data.site(f"{side}_sole").xpos, atol=1e-9)
    middle = (data.site("l_sole").xpos + data.site("r_sole").xpos) / 2
    np.testing.assert_allclose(data.body("body_link").subtree_com[:2], middle[:2], atol=0.002)


def test_the_stand_commands_its_own_pose(model):
    np.testing.assert_array_equal(model.key("stand").ctrl, model.key("stand").qpos[7:])


def test_the_robot_stands_for_ten_seconds(model, data):
    height, touched = data.qpos[2], set()
    lowest, most_tilted = height, 1.0
    while data.time < 10:
        mujoco.mj_step(model, data)
        touched |= touching(model, data)
        lowest = min(lowest, data.qpos[2])
        most_tilted = min(most_tilted, data.body("body_link").xmat[8])
    assert {name for pair in touched for name in pair} <= {*FEET, "world"}
    assert height - lowest < 0.003
    assert math.degrees(math.acos(most_tilted)) < 4
    assert np.abs(data.qvel).max() < 1e-3
    assert np.linalg.norm(data.qpos[:2] - model.key("stand").qpos[:2]) < 0.01
