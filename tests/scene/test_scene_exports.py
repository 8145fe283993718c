"""Bodies in exports: OmniRetarget's seven columns, and a MuJoCo scene that plays with the bodies."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import robot_retarget as rr
from robot_retarget.errors import UsageError
from robot_retarget.scene.geoms import PREFIX
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, height_field, mesh, solid
from robot_retarget.view import Picture, strip

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
}


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


def test_one_moving_body_comes_behind_the_joints_and_is_read_again(tmp_path: Path) -> None:
    rr.export(moved(Scene((RigidBody("box", CUBE, PATH),))), OP3, "omniretarget", tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as file:
        np.testing.assert_allclose(file["qpos"][:, -7:], PATH, atol=1e-6)
    scene = tmp_path / "scene.toml"
    scene.write_text('[[body]]\nname = "box"\nshape = "box"\nsize = [0.1, 0.2, 0.3]\nposes = "out.npz"\nfps = 30\n')
    np.testing.assert_allclose(rr.read_scene(scene).bodies[0].poses, PATH, atol=1e-6)


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
