"""Bodies around a human: read from files of several programs, brought to the frames of a motion, measured by MuJoCo."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.errors import SceneError
from robot_retarget.scene.geoms import SceneModel
from robot_retarget.scene.scene import RigidBody, Scene, composed
from robot_retarget.scene.shape import ShapeKind, height_field, mesh, solid

CLIP = rr.read_motion(ROOT / "samples" / "wave.bvh").frames(0, 40)
CUBE = solid(ShapeKind.BOX, (0.4, 0.4, 0.4))
FAR = np.array([1.5, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0])


def boxed(poses: np.ndarray, **facts: object) -> Scene:
    return Scene((RigidBody("box", CUBE, poses, **facts),))  # type: ignore[arg-type]


def path(frames: int, fps: float) -> np.ndarray:
    """A box that moves along x at 0.3 m/s and turns about z at 1 rad/s."""
    time = np.arange(frames) / fps
    turn = Rotation.from_rotvec(time[:, None] * [0, 0, 1]).as_quat(scalar_first=True)
    return np.concatenate([FAR[:3] + time[:, None] * [0.3, 0, 0], turn], axis=1)


def written(folder: Path, text: str) -> Path:
    file = folder / "scene.toml"
    file.write_text(text)
    return file


def test_a_carried_body_keeps_its_place_in_the_joint(tmp_path: Path) -> None:
    hand = next(name for name in CLIP.skeleton.names if "Wrist" in name)
    file = written(
        tmp_path, f'[[body]]\nname="box"\nshape="box"\nsize=[0.1, 0.1, 0.1]\ncarrier="{hand}"\nposition=[0, 0.3, 0]\n'
    )
    scene = CLIP.with_scene(rr.read_scene(file)).scene
    assert scene is not None and CLIP.rotations is not None
    joint = CLIP.skeleton.names.index(hand)
    turn = Rotation.from_quat(CLIP.rotations[:, joint], scalar_first=True)
    local = turn.inv().apply(scene.poses(40)[:, 0, :3] - CLIP.positions[:, joint])
    np.testing.assert_allclose(local, np.tile([0, 0.3, 0], (40, 1)), atol=1e-9)


def test_poses_follow_the_time_of_the_source_through_cuts_and_rates() -> None:
    """Other rate, cut, resampled, in either order: the box is where its path says at each frame's time."""
    scene = boxed(path(400, 100.0), fps=100.0)
    first = CLIP.with_scene(scene).frames(10, 30).resample(50)
    second = CLIP.frames(10, 30).resample(50).with_scene(scene)
    for motion in (first, second):
        assert motion.scene is not None
        found = motion.scene.poses(len(motion))[:, 0]
        np.testing.assert_allclose(found[:, 0], FAR[0] + 0.3 * motion.source_time, atol=1e-9)
        angle = Rotation.from_quat(found[:, 3:], scalar_first=True).as_rotvec()[:, 2]
        np.testing.assert_allclose(angle, motion.source_time, atol=1e-3)


def test_a_fixed_body_needs_no_frames() -> None:
    motion = CLIP.with_scene(boxed(FAR)).resample(10)
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
    ramp = height_field(np.tile(np.linspace(0, 0.5, 11), (3, 1)), 1.0, 1.0)
    scene = Scene((RigidBody("step", CUBE, FAR), RigidBody("ramp", ramp, np.array([-2.0, 0, 0, 1, 0, 0, 0]))))
    points = np.array([[[1.6, 0.1, 0.5], [0.0, 0, 0.1], [-2.0, 0.1, 0.4], [-1.75, 0, 0.5]]])
    height, normal, body = SceneModel(scene).heights(points, scene.poses(1), 0.3)
    np.testing.assert_allclose(height, [[0.4, 0.0, 0.25, 0.375]], atol=1e-6)
    np.testing.assert_allclose(normal[0, 2], np.array([-0.5, 0, 1]) / np.hypot(0.5, 1), atol=1e-6)
    assert body.tolist() == [[0, -1, 1, 1]]


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


def test_a_hollow_mesh_is_named_open() -> None:
    lid = mesh(CUBE.corners, np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]]))
    motion = CLIP.with_scene(Scene((RigidBody("crate", lid, FAR),)))
    assert motion.scene is not None and any("'crate' is open" in note for note in motion.scene.notes)


def optitrack(folder: Path, rows: list[str]) -> Path:
    kinds = ",".join(["", "", *["Rigid RigidBody"] * 7])
    names = ",".join(["", "", *["crate"] * 7])
    channels = ",".join(["", "", *["Rotation"] * 4, *["Position"] * 3])
    head = f"Format Version,1.23,Export Frame Rate,30.0,Rotation Type,Quaternion,Length Units,Millimeters\n\n{kinds}\n{names}\n,,{'1,' * 7}\n"
    file = folder / "take.csv"
    file.write_text(head + channels + "\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z\n" + "\n".join(rows) + "\n")
    return file


CRATE = '[[body]]\nname = "crate"\nshape = "box"\nsize = [0.4, 0.4, 0.4]\nposes = "take.csv"\n'


def test_optitrack_is_turned_from_y_up_and_millimetres(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    optitrack(tmp_path, [f"{k},{k / 30},0,{half},0,{half},{10 * k},200,1500" for k in range(60)])
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


def test_an_object_behind_a_robots_joints_is_read(tmp_path: Path) -> None:
    poses = path(50, 30.0)
    np.savez(
        tmp_path / "qpos.npz",
        qpos=np.concatenate([np.tile([0, 0, 1, 1, 0, 0, 0.0], (50, 1)), np.zeros((50, 29)), poses], 1),
    )
    body = rr.read_scene(written(tmp_path, CRATE.replace("take.csv", "qpos.npz"))).bodies[0]
    np.testing.assert_allclose(body.poses, poses, atol=1e-9)


REFUSED = {
    'shape = "ball"\nsize = 1': "did you mean 'box'|known: box",
    'shape = "box"\nsize = [1, 2]': r"'crate'.*size has 3 numbers",
    'shape = "box"\nsize = [1, 2, -2]': r"'crate'.*3 positive lengths",
    'shape = "box"\nsize = [1, 1, 1]\ncarrier = "Hips"\nposes = "a.npz"': "contradict each other",
    'shape = "box"\nsize = [1, 1, 1]\nweight = 3': r"'crate'.*unknown key 'weight'",
    'shape = "box"\nsize = [1, 1, 1]\nquaternion = [2, 0, 0, 0]': r"'crate'.*norm 2, not 1",
    'shape = "box"\nsize = [1, 1, 1]\nposes = "none.npz"': r"'crate'.*no such file",
    'shape = "mesh"\nfile = "none.obj"': r"'crate'.*no such file",
    'shape = "box"\nsize = [1, 1, 1]\nposes = "unsaid.npz"': "order of its quaternions",
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_wrong_table_is_refused_with_the_bodys_name(text: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "unsaid.npz", poses=path(50, 30.0))
    with pytest.raises(SceneError, match=REFUSED[text]):
        rr.read_scene(written(tmp_path, f'[[body]]\nname = "crate"\n{text}\n'))


def test_a_body_without_pose_at_some_frames_is_refused(tmp_path: Path) -> None:
    optitrack(tmp_path, [f"{k},0,0,0,0,1,0,200,1500" if k != 7 else "7,0,,,,,,," for k in range(60)])
    with pytest.raises(SceneError, match=r"'crate' has no pose at frame 7"):
        rr.read_scene(written(tmp_path, CRATE))


def test_bodies_that_do_not_fit_the_motion_are_refused() -> None:
    inside = np.array([*CLIP.positions[0].mean(axis=0), 1.0, 0, 0, 0])
    cases = {
        "no joint 'Prop1'": boxed(FAR, carrier="Prop1"),
        "no pose after 0.33 s": boxed(path(11, 30.0), fps=30.0),
        "unit": boxed(FAR * [1000, 1000, 1000, 1, 1, 1, 1]),
        "400 m long: state its unit": Scene((RigidBody("box", CUBE.scaled(1000), FAR),)),
        "order of its quaternions": Scene((RigidBody("box", CUBE.scaled(3), inside),)),
    }
    for message, scene in cases.items():
        with pytest.raises(SceneError, match=rf"'box'.*{message}"):
            CLIP.with_scene(scene)


def test_a_body_that_jumps_is_named() -> None:
    poses = path(400, 100.0)
    poses[120:, 1] += 3
    motion = CLIP.with_scene(boxed(poses, fps=100.0))
    assert motion.scene is not None and any("'box' jumps" in note for note in motion.scene.notes)


def test_poses_without_shapes_say_what_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "object.npz"
    np.savez(file, trans=np.zeros((3, 3)))
    with pytest.raises(SceneError, match=r"no shapes.*\[\[body\]\]"):
        rr.read_scene(file)


def test_two_bodies_of_one_name_are_refused() -> None:
    body = RigidBody("box", CUBE, FAR)
    with pytest.raises(SceneError, match="two bodies named 'box'"):
        Scene((body, replace(body)))


def test_a_model_gives_its_bodies_without_the_robot(tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(
        '<mujoco><worldbody><geom name="floor" type="plane" size="0 0 .1"/>'
        '<body name="table" pos="1 0 .4"><geom type="box" size=".4 .3 .4"/></body>'
        '<body name="box" pos="1 0 1"><freejoint/><geom type="sphere" size=".1" mass="2"/></body>'
        '<body name="robot" pos="0 0 1"><freejoint/><geom size=".1"/><body><joint/><geom size=".1"/></body></body>'
        "</worldbody></mujoco>"
    )
    scene = rr.read_scene(file)
    assert scene.names == ("floor", "table", "box")
    np.testing.assert_allclose(scene.bodies[1].shape.size, [0.8, 0.6, 0.8])
    assert scene.bodies[2].weight == pytest.approx(2.0)
