"""Bodies in exports: OmniRetarget's seven columns, and a MuJoCo scene that plays with the bodies."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import robot_retarget as rr
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.formats import FORMATS, FormatOptions
from robot_retarget.scene.geoms import PREFIX
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, height_field, mesh, solid
from robot_retarget.tools.view.film import strip
from robot_retarget.tools.view.picture import Picture

OP3 = rr.load_robot("op3")
CUBE = solid(ShapeKind.BOX, (0.1, 0.2, 0.3))
TURNS = Rotation.from_rotvec(np.linspace(0, 1, 20)[:, None] * [0.3, 0, 1]).as_quat(scalar_first=True)
PATH = np.concatenate([np.linspace([0.4, 0, 0.1], [0.4, 0.3, 0.6], 20), TURNS], axis=1)
STILL = np.array([-1.0, 0.2, 0.1, 0.8, 0, 0, 0.6])
HULL = mesh(
    CUBE.corners,
    np.array(
        [
            [0, 1, 3],
            [0, 3, 2],
            [4, 6, 7],
            [4, 7, 5],
            [0, 4, 5],
            [0, 5, 1],
            [2, 3, 7],
            [2, 7, 6],
            [0, 2, 6],
            [0, 6, 4],
            [1, 5, 7],
            [1, 7, 3],
        ]
    ),
)
SHAPES = {
    "box": CUBE,
    "ball": solid(ShapeKind.SPHERE, (0.2,)),
    "drum": solid(ShapeKind.CYLINDER, (0.2, 0.3)),
    "hull": HULL,
    "hills": height_field(np.array([[0, 0.1, 0], [0.2, 0, 0.1]]), 1, 2),
    "plateau": height_field(np.array([[0.2, 0.3, 0.2], [0.4, 0.2, 0.3]]), 1, 2),
}


def same(found: Scene | None, scene: Scene) -> None:
    """Equal names, shapes, poses, masses and friction, as MuJoCo's single precision keeps them."""
    assert found is not None and found.names == scene.names
    for one, other in zip(found.bodies, scene.bodies, strict=True):
        assert one.shape.kind is other.shape.kind and one.fixed == other.fixed
        np.testing.assert_allclose(one.poses[..., :3], other.poses[..., :3], atol=1e-7)
        turns = [Rotation.from_quat(np.atleast_2d(body.poses)[:, 3:], scalar_first=True) for body in (one, other)]
        assert (turns[0] * turns[1].inv()).magnitude().max() < 1e-6
        corners, expected = (np.sort(body.shape.corners, axis=0) for body in (one, other))
        np.testing.assert_allclose(corners, expected, atol=1e-6)
        np.testing.assert_allclose(one.shape.heights, other.shape.heights, atol=1e-6)
        assert one.weight == pytest.approx(other.weight, rel=1e-6) and one.friction == other.friction


def moved(scene: Scene) -> rr.Trajectory:
    return rr.Trajectory(np.tile(OP3.standing(), (20, 1)), 30.0, OP3.joint_names, OP3.name, scene=scene)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_mujoco_scene_has_the_bodies_where_they_are(shape: str, tmp_path: Path) -> None:
    fixed, path = RigidBody("still", SHAPES[shape], STILL), RigidBody("moves", SHAPES[shape], PATH)
    rr.export(moved(Scene((fixed, path))), OP3, "mujoco-scene", tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("frame_7").id)
    mujoco.mj_kinematics(model, data)
    for name, pose in (("still", STILL), ("moves", PATH[7])):
        body = data.body(PREFIX + name)
        np.testing.assert_allclose(body.xpos, pose[:3], atol=1e-7)
        assert abs(body.xquat @ pose[3:]) == pytest.approx(1, abs=1e-7)
        box = model.geom_aabb[model.geom(PREFIX + name).id, 3:]
        if shape in ("box", "ball", "drum"):
            np.testing.assert_allclose(2 * box, SHAPES[shape].size, atol=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_an_exported_mujoco_scene_is_read_with_its_bodies(shape: str, tmp_path: Path) -> None:
    scene = Scene(
        (RigidBody("still", SHAPES[shape], STILL), RigidBody("moves", SHAPES[shape], PATH, mass=2, friction=0.5))
    )
    rr.export(moved(scene), OP3, "mujoco-scene", tmp_path / "out")
    same(rr.load_trajectory(tmp_path / "out", OP3).scene, scene)


@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_stand_in_a_file_next_to_a_format_without_them(shape: str, tmp_path: Path) -> None:
    scene = Scene(
        (RigidBody("still", SHAPES[shape], STILL), RigidBody("moves", SHAPES[shape], PATH, mass=2, friction=0.5))
    )
    rr.export(moved(scene), OP3, "csv", tmp_path / "out.csv")
    same(rr.load_trajectory(tmp_path / "out.csv", OP3).scene, scene)
    same(rr.read_scene(tmp_path / "out.csv.scene.xml"), scene)
    rr.export(moved(scene).altered(scene=None), OP3, "csv", tmp_path / "out.csv")
    assert rr.load_trajectory(tmp_path / "out.csv", OP3).scene is None


@pytest.mark.parametrize("format", FORMATS)
def test_bodies_survive_a_way_through_the_format_of_others(format: str, tmp_path: Path) -> None:
    """Of every format: at the rate that its readers assume, the bodies are where they are in time."""
    scene, file = (
        Scene((RigidBody("still", HULL, STILL), RigidBody("box", CUBE, PATH))),
        tmp_path / f"out{FORMATS[format].suffix}",
    )
    rr.export(moved(scene), OP3, format, file)
    found = rr.load_trajectory(file, OP3, format)
    assert found.scene is not None and found.scene.names == scene.names
    box = found.scene.poses(len(found))[:, 1]
    expected = [np.interp(np.arange(len(found)) / found.fps, np.arange(20) / 30, PATH[:, k]) for k in range(3)]
    np.testing.assert_allclose(box[:, :3], np.transpose(expected), atol=1e-6)


def test_trainers_attach_the_bodies_to_their_world(tmp_path: Path) -> None:
    """As mjlab's SceneCfg.spec_fn is called: with a world that has a robot and its keyframe."""
    scene = Scene((RigidBody("still", HULL, STILL), RigidBody("box", CUBE, PATH)))
    rr.export(moved(scene), OP3, "mjlab", tmp_path / "out.npz")
    world = mujoco.MjSpec.from_file(str(OP3.path))
    bodies = mujoco.MjSpec.from_file(str(tmp_path / "out.npz.scene.xml"))
    for key in list(bodies.keys):
        bodies.delete(key)
    world.attach(bodies, prefix="around/", frame=world.worldbody.add_frame())
    model = world.compile()
    assert model.nq == OP3.model.nq + 7
    np.testing.assert_allclose(model.body("around/" + PREFIX + "box").pos, PATH[0, :3], atol=1e-9)


def test_one_moving_body_comes_behind_the_joints_and_is_read_again(tmp_path: Path) -> None:
    """The scene of the user gives the shape where no file next to the motion does."""
    rr.export(moved(Scene((RigidBody("box", CUBE, PATH),))), OP3, "omniretarget", tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as file:
        np.testing.assert_allclose(file["qpos"][:, -7:], PATH, atol=1e-6)
    (tmp_path / "out.npz.scene.xml").unlink()
    assert any("left out" in note for note in rr.load_trajectory(tmp_path / "out.npz", OP3).notes)
    scene, shape = tmp_path / "scene.toml", '[[body]]\nname = "box"\nshape = "box"\nsize = [0.1, 0.2, 0.3]\n'
    scene.write_text(shape)
    found = rr.load_trajectory(tmp_path / "out.npz", OP3, options=FormatOptions(scene=scene)).scene
    assert found is not None
    np.testing.assert_allclose(found.poses(20)[:, 0], PATH, atol=1e-6)
    scene.write_text(shape + shape.replace('"box"', '"other"', 1))
    with pytest.raises(UsageError, match=r"moves one body, and .*scene\.toml has 2"):
        rr.load_trajectory(tmp_path / "out.npz", OP3, options=FormatOptions(scene=scene))
    scene.write_text(f'{shape}poses = "out.npz"\nfps = 30\n')
    np.testing.assert_allclose(rr.read_scene(scene).bodies[0].poses, PATH, atol=1e-6)


def test_holosomas_orders_and_its_training_form_move_the_body(tmp_path: Path) -> None:
    """The retargeter writes positions first, the published set quaternions first; the training form has arrays of the object."""
    scene, shape = tmp_path / "scene.toml", '[[body]]\nname = "box"\nshape = "box"\nsize = [0.1, 0.2, 0.3]\n'
    scene.write_text(shape)
    options, boxed = FormatOptions(scene=scene), moved(Scene((RigidBody("box", CUBE, PATH),)))
    qpos, first = OP3.standing(), [3, 4, 5, 6, 0, 1, 2]
    rows = np.column_stack([np.tile(qpos[:7][first], (20, 1)), np.tile(qpos[7:], (20, 1)), PATH[:, first]])
    np.savez(tmp_path / "published.npz", qpos=rows)
    found = rr.load_trajectory(tmp_path / "published.npz", OP3, "omniretarget", options)
    assert found.scene is not None
    np.testing.assert_allclose(found.scene.poses(20)[:, 0], PATH, atol=1e-9)
    rr.export(boxed, OP3, "omniretarget-training", tmp_path / "training.npz", FormatOptions(fps=30))
    (tmp_path / "training.npz.scene.xml").unlink()
    found = rr.load_trajectory(tmp_path / "training.npz", OP3, options=options)
    assert found.scene is not None
    np.testing.assert_allclose(found.scene.poses(20)[:, 0], PATH, atol=1e-9)
    with np.load(tmp_path / "training.npz") as file:
        np.testing.assert_allclose(file["object_lin_vel_w"], np.tile((PATH[-1] - PATH[0])[:3] * 30 / 19, (20, 1)))
        spin = Rotation.from_quat(TURNS[-1], scalar_first=True).as_rotvec() * 30 / 19
        np.testing.assert_allclose(file["object_ang_vel_w"], np.tile(spin, (20, 1)), atol=1e-9)


def test_bodies_of_another_motion_are_refused(tmp_path: Path) -> None:
    rr.export(moved(Scene((RigidBody("box", CUBE, PATH),))), OP3, "csv", tmp_path / "out.csv")
    short = replace(moved(Scene(())), qpos=moved(Scene(())).qpos[:9], source_time=np.zeros(0), scene=None)
    rr.export(short, OP3, "csv", tmp_path / "short.csv")
    (tmp_path / "out.csv.scene.xml").rename(tmp_path / "short.csv.scene.xml")
    with pytest.raises(TrajectoryError, match="scene has 20 frames, the trajectory 9"):
        rr.load_trajectory(tmp_path / "short.csv", OP3)


def test_omniretarget_holds_no_two_moving_bodies(tmp_path: Path) -> None:
    two = Scene((RigidBody("a", CUBE, PATH), RigidBody("b", CUBE, PATH)))
    with pytest.raises(UsageError, match="one moving body, the trajectory has 2"):
        rr.export(moved(two), OP3, "omniretarget", tmp_path / "out.npz")


def test_pictures_show_the_bodies() -> None:
    beside = RigidBody("box", solid(ShapeKind.BOX, (0.3, 0.3, 0.3)), np.array([0.0, -0.35, 0.15, 1, 0, 0, 0]))
    alone, among = (strip(OP3, replace(moved(Scene(())), scene=scene)) for scene in (None, Scene((beside,))))
    if not isinstance(alone, Picture) or not isinstance(among, Picture):
        pytest.skip("no renderer here")
    assert np.abs(alone.pixels.astype(int) - among.pixels).mean() > 2
