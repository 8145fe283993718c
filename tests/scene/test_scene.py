"""Bodies around a human: read from files of several programs, brought to the frames of a motion, measured by MuJoCo."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_files import CLIP, CRATE, CUBE, FAR, boxed, optitrack, path, written
from scipy.spatial.transform import Rotation

import robot_retarget as rr
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.surroundings import with_scene
from robot_retarget.human.touches import FLESH
from robot_retarget.scene.geoms import SceneModel
from robot_retarget.scene.scene import RigidBody, Scene, composed
from robot_retarget.scene.shape import height_field


def test_a_carried_body_keeps_its_place_in_the_joint(tmp_path: Path) -> None:
    hand = next(name for name in CLIP.skeleton.names if "Wrist" in name)
    file = written(
        tmp_path, f'[[body]]\nname="box"\nshape="box"\nsize=[0.1, 0.1, 0.1]\ncarrier="{hand}"\nposition=[0, 0.3, 0]\n'
    )
    scene = with_scene(CLIP, rr.read_scene(file)).scene
    assert scene is not None and CLIP.rotations is not None
    joint = CLIP.skeleton.names.index(hand)
    turn = Rotation.from_quat(CLIP.rotations[:, joint], scalar_first=True)
    local = turn.inv().apply(scene.poses(40)[:, 0, :3] - CLIP.positions[:, joint])
    np.testing.assert_allclose(local, np.tile([0, 0.3, 0], (40, 1)), atol=1e-9)


def test_poses_follow_the_time_of_the_source_through_cuts_and_rates() -> None:
    """Other rate, cut, resampled, in either order: the box is where its path says at each frame's time."""
    scene = boxed(path(400, 100.0), fps=100.0)
    first = with_scene(CLIP, scene).frames(10, 30).resample(50)
    second = with_scene(CLIP.frames(10, 30).resample(50), scene)
    for motion in (first, second):
        assert motion.scene is not None
        found = motion.scene.poses(len(motion))[:, 0]
        np.testing.assert_allclose(found[:, 0], FAR[0] + 0.3 * motion.source_time, atol=1e-9)
        angle = Rotation.from_quat(found[:, 3:], scalar_first=True).as_rotvec()[:, 2]
        np.testing.assert_allclose(angle, motion.source_time, atol=1e-3)


def test_a_fixed_body_needs_no_frames() -> None:
    motion = with_scene(CLIP, boxed(FAR)).resample(10)
    assert motion.scene is not None and motion.scene.bodies[0].fixed


@settings(max_examples=50)
@given(
    point=st.tuples(*[st.floats(-0.6, 0.6)] * 3).map(np.array),
    turn=st.tuples(*[st.floats(-3, 3)] * 3).map(np.array),
)
def test_distances_to_a_box_are_those_of_the_formula(point: np.ndarray, turn: np.ndarray) -> None:
    """‖max(|p| − h, 0)‖ + min(max(|p| − h), 0) in the frame of the box, and the nearest point is as far away."""
    rotation = Rotation.from_rotvec(turn)
    pose = np.concatenate([FAR[:3], rotation.as_quat(scalar_first=True)])
    world = FAR[:3] + rotation.apply(point)
    distance, place = SceneModel(boxed(pose)).nearest(world[None, None], pose[None, None], 2.0)
    out = np.abs(point) - 0.2
    expected = np.linalg.norm(np.maximum(out, 0)) + min(float(out.max()), 0.0)
    assert distance.item() == pytest.approx(expected, abs=2e-4)
    assert np.linalg.norm(place - world) == pytest.approx(abs(expected), abs=2e-4)


def test_heights_are_those_of_the_surface_under_a_point() -> None:
    ramp = np.tile(np.linspace(0, 0.5, 11), (3, 1))
    ramps = [
        RigidBody(f"ramp {y}", height_field(ramp + y / 10, 1.0, 1.0), np.array([-2.0, y, 0, 1, 0, 0, 0]))
        for y in (0, 2)
    ]
    scene = Scene((RigidBody("step", CUBE, FAR), *ramps))
    points = np.array([[[1.6, 0.1, 0.5], [0.0, 0, 0.1], [-2.0, 0.1, 0.4], [-1.75, 0, 0.5], [-1.75, 2, 0.7]]])
    height, normal, body = SceneModel(scene).heights(points, scene.poses(1), 0.3)
    np.testing.assert_allclose(height, [[0.4, 0.0, 0.25, 0.375, 0.575]], atol=1e-6)
    np.testing.assert_allclose(normal[0, 2], np.array([-0.5, 0, 1]) / np.hypot(0.5, 1), atol=1e-6)
    assert body.tolist() == [[0, -1, 1, 1, 2]]


def test_a_hand_touches_by_its_knuckles() -> None:
    """The hand hangs over a box that is out of the wrist's reach."""
    wrist, end = (CLIP.positions[0, CLIP.skeleton.names.index(f"LeftWrist{part}")] for part in ("", "_end"))
    matched = match(CLIP, rr.load_robot("op3"))
    assert wrist[2] - end[2] + 0.04 > FLESH["hand"] * matched.human_leg
    touched = {}
    for gap in (0.04, 0.2):
        below = np.array([*end[:2], end[2] - gap - 0.2, 1.0, 0, 0, 0])
        around = features_of(with_scene(CLIP, boxed(below)), matched).around
        assert around is not None
        touched[gap] = bool(around.touches.held[:, around.touches.pairs.index(("l_hand", 0))].any())
    assert touched == {0.04: True, 0.2: False}


SIZES = {
    'shape = "box"\nsize = [400, 300, 200]': [0.4, 0.3, 0.2],
    'shape = "cylinder"\nsize = [400, 200]': [0.4, 0.4, 0.2],
    'shape = "sphere"\nsize = 400': [0.4, 0.4, 0.4],
    'shape = "plane"': [0, 0, 0],
    'shape = "mesh"\nfile = "cube.obj"': [0.4, 0.4, 0.4],
    'shape = "height field"\nsize = [400, 300]\nfile = "heights.npy"': [0.4, 0.3, 0.2],
}


@pytest.mark.parametrize("shape", SIZES)
def test_every_shape_is_read_in_its_unit(shape: str, tmp_path: Path) -> None:
    corners = CUBE.corners * 1000
    faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    (tmp_path / "cube.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + faces)
    np.save(tmp_path / "heights.npy", [[0.0, 100], [200, 0]])
    text = f'[[body]]\nname = "thing"\nunit = "mm"\nposition = [1500, 0, 200]\n{shape}\n'
    body = rr.read_scene(written(tmp_path, text)).bodies[0]
    np.testing.assert_allclose(body.shape.size, SIZES[shape], atol=1e-6)
    np.testing.assert_allclose(body.poses[:3], [1.5, 0, 0.2])
    assert body.shape.open_edges == 0


def test_optitrack_is_turned_from_y_up_and_millimetres(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    poses = [[0, half, 0, half, 10 * k, 200, 1500] for k in range(60)]
    optitrack(tmp_path, poses)
    body = rr.read_scene(written(tmp_path, CRATE)).bodies[0]
    np.testing.assert_allclose(body.poses[3, :3], [1.5, 0.03, 0.2], atol=1e-9)
    np.testing.assert_allclose(body.poses[3, 3:], [half, 0, 0, half], atol=1e-9)
    assert body.fps == 30


def test_rows_of_omomo_hold_a_human_and_a_body(tmp_path: Path) -> None:
    poses = path(50, 30.0)
    angles = Rotation.from_quat(poses[:, 3:], scalar_first=True).as_rotvec()
    np.savez(tmp_path / "object.npz", trans=poses[:, :3], angles=angles, fps=30.0)
    body = rr.read_scene(written(tmp_path, CRATE.replace("take.csv", "object.npz"))).bodies[0]
    np.testing.assert_allclose(composed(body.poses, FAR), composed(poses, FAR), atol=1e-9)


@pytest.mark.parametrize("key", ["obj_rot", "obj_rot_mat"])
def test_a_pickle_of_omomo_holds_places_and_matrices(key: str, tmp_path: Path) -> None:
    poses = path(50, 30.0)
    turns = Rotation.from_quat(poses[:, 3:], scalar_first=True).as_matrix()
    with (tmp_path / "clip.pkl").open("wb") as file:
        pickle.dump({"seq_name": "sub1_box", "obj_trans": poses[:, :3, None], key: turns}, file)
    body = rr.read_scene(written(tmp_path, CRATE.replace("take.csv", "clip.pkl"))).bodies[0]
    np.testing.assert_allclose(composed(body.poses, FAR), composed(poses, FAR), atol=1e-9)


def test_an_object_behind_a_robots_joints_is_read(tmp_path: Path) -> None:
    poses = path(50, 30.0)
    np.savez(
        tmp_path / "qpos.npz",
        qpos=np.concatenate([np.tile([0, 0, 1, 1, 0, 0, 0.0], (50, 1)), np.zeros((50, 29)), poses], 1),
    )
    body = rr.read_scene(written(tmp_path, CRATE.replace("take.csv", "qpos.npz"))).bodies[0]
    np.testing.assert_allclose(body.poses, poses, atol=1e-9)


def test_a_model_gives_its_bodies_without_the_robot(tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(
        '<mujoco><worldbody><geom name="floor" type="plane" size="0 0 .1"/>'
        '<body name="table" pos="1 0 .4"><geom type="box" size=".4 .3 .4"/><geom type="sphere" size=".1"/></body>'
        '<body name="box" pos="1 0 1"><freejoint/><geom type="sphere" size=".1" mass="2"/></body>'
        '<body name="robot" pos="0 0 1"><freejoint/><geom size=".1"/><body><joint/><geom size=".1"/></body></body>'
        "</worldbody></mujoco>"
    )
    scene = rr.read_scene(file)
    assert scene.names == ("floor", "table", "table 2", "box")
    np.testing.assert_allclose(scene.bodies[1].shape.size, [0.8, 0.6, 0.8])
    assert scene.bodies[3].weight == pytest.approx(2.0)
