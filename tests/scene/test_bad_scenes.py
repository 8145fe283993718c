"""Mistakes in scenes: each is refused, or named in a note, with the body and where it is stated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from forked import run
from scene_files import CLIP, CRATE, CUBE, FAR, boxed, optitrack, path, written

import robot_retarget as rr
from robot_retarget.base.errors import SceneError
from robot_retarget.human.surroundings import with_scene
from robot_retarget.scene.geoms import MESH_FILE
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import mesh

BOX = 'shape = "box"\nsize = [1, 1, 1]\n'
REFUSED = {
    'shape = "ball"\nsize = 1': "did you mean 'box'|known: box",
    'shape = ["box"]': "no shape",
    "": "no shape ''; known: box",
    'shape = "box"\nsize = [1, 2]': "size has 3 numbers",
    'shape = "box"': "size has 3 numbers .*got none",
    'shape = "box"\nsize = [1, 2, -2]': "3 positive lengths",
    'shape = "box"\nsize = [1, nan, 2]': "3 positive lengths",
    'shape = "box"\nsize = [true, true, true]': "size has 3 numbers",
    BOX + 'carrier = "Hips"\nposes = "a.npz"': "contradict each other",
    BOX + 'model = "a.xml"': "contradict each other",
    BOX + "carrier = 3": "carrier is a name, got 3",
    BOX + "weight = 3": "unknown key 'weight'",
    BOX + "mass = true": "mass is a positive number",
    BOX + "mass = inf": "mass is a positive number",
    BOX + "fps = -30": "fps is a positive number",
    BOX + 'unit = "inch"': "no unit 'inch'; known: m, cm, mm",
    BOX + 'up = ["z"]': "known: x, y, z",
    BOX + "position = [1, nan, 0]": "has no pose at frame 0",
    BOX + "quaternion = [2, 0, 0, 0]": "norm 2, not 1",
    BOX + "quaternion = 1": "quaternion has 4 numbers w x y z",
    BOX + 'quaternion = ["a", 0, 0, 0]': "quaternion has 4 numbers w x y z",
    BOX + 'poses = "none.npz"': "no such file",
    BOX + 'poses = "scene.toml"': r"known: \.npz, \.pt",
    BOX + 'poses = "unsaid.npz"': "order of its quaternions",
    BOX + 'poses = "unsaid.npz"\norder = "zyxw"': "known: wxyz, xyzw",
    BOX + 'poses = "text.npz"\norder = "wxyz"': "poses must be numbers",
    BOX + 'poses = "wide.npz"\norder = "wxyz"': "poses must have the shape",
    BOX + 'poses = "empty.npz"\norder = "wxyz"': "poses is empty",
    BOX + 'poses = "lost.npz"\norder = "wxyz"': r"has no pose at frame 7 \(1 of 50 frames\)",
    BOX + 'poses = "unlike.npz"': r"angles must have the shape \(50, 3\)",
    BOX + 'poses = "mirrored.npz"': "left-handed",
    BOX + 'poses = "junk.npz"': "not a readable .npz",
    BOX + 'poses = "junk.csv"': "no CSV export of Motive",
    'shape = "mesh"': "file is a name",
    'shape = "mesh"\nfile = "none.obj"': "no such file",
    'shape = "mesh"\nfile = "junk.csv"': "MuJoCo does not load it",
    'shape = "mesh"\nfile = "flat.obj"': "coplanar",
    'shape = "mesh"\nfile = "huge.obj"': "reduce its faces",
    'shape = "mesh"\nfile = "flat.obj"\nsize = [1, 1, 1]': "leave size out",
    'shape = "height field"\nsize = [1, 1]\nfile = "text.npz"': "not a readable array of heights",
    'shape = "height field"\nsize = [1, 1]\nfile = "low.npy"': "heights of 0 or more",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that bodies name."""
    made, poses = tmp_path_factory.mktemp("bodies"), path(50, 30.0)
    lost = poses.copy()
    lost[7] = np.nan
    np.savez(made / "unsaid.npz", poses=poses)
    np.savez(made / "text.npz", poses=np.array([["a"] * 7] * 2))
    np.savez(made / "wide.npz", poses=np.zeros((50, 8)))
    np.savez(made / "empty.npz", poses=np.zeros((0, 7)))
    np.savez(made / "lost.npz", poses=lost)
    np.savez(made / "unlike.npz", trans=poses[:, :3], angles=np.zeros((51, 3)))
    np.savez(made / "mirrored.npz", obj_trans=poses[:, :3], obj_rot=np.tile(-np.eye(3), (50, 1, 1)))
    np.save(made / "low.npy", np.array([[0, -1.0], [0, 1]]))
    for name in ("junk.npz", "junk.csv"):
        (made / name).write_text("junk")
    (made / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 4 3\n")
    with (made / "huge.obj").open("wb") as file:
        file.truncate(MESH_FILE + 1)
    return made


@pytest.mark.parametrize("text", REFUSED)
def test_a_wrong_table_is_refused_with_its_line_and_the_bodys_name(text: str, folder: Path) -> None:
    file = written(folder, f'\n# a comment\n[[body]]\nname = "crate"\n{text}\n')
    with pytest.raises(SceneError, match=rf"scene\.toml:3: body 'crate'.*{REFUSED[text]}") as refused:
        rr.read_scene(file)
    assert str(refused.value).count("'crate'") == 1


@pytest.mark.parametrize("name", ['""', "3", "true", '" "'])
def test_a_name_is_a_text(name: str, folder: Path) -> None:
    with pytest.raises(SceneError, match=r"scene\.toml:1: .*name is a text"):
        rr.read_scene(written(folder, f"[[body]]\nname = {name}\n{BOX}"))


def test_a_command_ends_with_2_and_one_line(folder: Path) -> None:
    scene = written(folder, f'[[body]]\nname = "crate"\n{BOX}carrier = "Prop1"\n')
    ended = run("info", str(CLIP.source), "--scene", str(scene))
    assert ended.returncode == 2 and "Traceback" not in ended.stderr
    assert f"{scene}:1: body 'crate': no joint 'Prop1'" in ended.stderr


def test_a_body_that_motive_lost_is_refused(tmp_path: Path) -> None:
    seen = [0, 0, 0, 1, 0, 200, 1500]
    optitrack(tmp_path, [seen if not 7 <= k < 24 else [""] * 7 for k in range(60)])
    with pytest.raises(SceneError, match=r"'crate' has no pose at frame 7 \(17 of 60 frames\)"):
        rr.read_scene(written(tmp_path, CRATE))


def test_a_short_gap_of_a_motive_body_is_bridged_and_a_longer_one_stays(tmp_path: Path) -> None:
    places = np.arange(60.0)
    lost = [7, 8, 31]
    optitrack(tmp_path, [[0, 0, 0, 1, 0, 200, x] if k not in lost else [""] * 7 for k, x in enumerate(places)])
    found = rr.read_scene(written(tmp_path, CRATE)).bodies[0].poses
    np.testing.assert_allclose(found[:, 0], places / 1000, atol=1e-9)


def test_a_cell_that_is_no_number_is_named_by_its_line(tmp_path: Path) -> None:
    optitrack(tmp_path, [[0, 0, 0, 1, 0, 200, "high" if k == 3 else 1500] for k in range(9)])
    with pytest.raises(SceneError, match=r"'crate'.*take\.csv:11: .*'high'"):
        rr.read_scene(written(tmp_path, CRATE))


def test_bodies_that_do_not_fit_the_motion_are_refused() -> None:
    inside = np.array([*CLIP.positions[0].mean(axis=0), 1.0, 0, 0, 0])
    cases = {
        "no joint 'Prop1'": boxed(FAR, carrier="Prop1"),
        "no pose after 0.33 s": boxed(path(11, 30.0), fps=30.0),
        "unit": boxed(FAR * [1000, 1000, 1000, 1, 1, 1, 1]),
        "400 m long: state its unit": Scene((RigidBody("box", CUBE.scaled(1000), FAR),)),
        "0.0004 m long: state its unit": Scene((RigidBody("box", CUBE.scaled(0.001), FAR),)),
        "order of its quaternions": Scene((RigidBody("box", CUBE.scaled(3), inside),)),
    }
    for message, scene in cases.items():
        with pytest.raises(SceneError, match=rf"'box'.*{message}"):
            with_scene(CLIP, scene)


def noted(scene: Scene) -> str:
    placed = with_scene(CLIP, scene).scene
    assert placed is not None
    return " ".join(placed.notes)


def test_a_body_that_moves_steadily_has_no_note() -> None:
    assert noted(boxed(path(400, 100.0), fps=100.0)) == ""


@pytest.mark.parametrize("frames", [slice(120, None), slice(120, 121)], ids=["from then on", "in one frame"])
@pytest.mark.parametrize("part", [slice(1, 2), slice(3, 7)], ids=["place", "turn"])
def test_a_body_that_jumps_is_named(frames: slice, part: slice) -> None:
    poses = path(400, 100.0)
    poses[frames, part] = [0.3] if part.stop == 2 else [0, 0, 0, 1]
    assert "Body 'box' jumps" in (note := noted(boxed(poses, fps=100.0)))
    assert "from frame 119 to 120" in note or "from frame 120 to 121" in note


def test_a_kicked_body_does_not_jump() -> None:
    poses = path(400, 100.0)
    poses[200:, 0] += 8.0 * np.arange(200) / 100
    assert noted(boxed(poses, fps=100.0)) == ""


def test_a_wrong_order_of_quaternions_turns_a_body_through_the_floor() -> None:
    poses = path(400, 100.0)
    assert noted(boxed(poses, fps=100.0)) == ""
    wrong = poses[:, [0, 1, 2, 4, 5, 6, 3]]
    assert "Body 'box' reaches" in noted(boxed(wrong, fps=100.0))


def test_a_body_that_holds_a_joint_is_named() -> None:
    foot = CLIP.positions[0, :, 2].argmin()
    x, y, z = CLIP.positions[0, foot]
    assert "Body 'box' holds the human's joint" in noted(boxed(np.array([x, y, z - 0.12, 1.0, 0, 0, 0])))


def test_a_hollow_mesh_is_named_open() -> None:
    lid = mesh(CUBE.corners, np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]]))
    assert "'crate' is open" in noted(Scene((RigidBody("crate", lid, FAR),)))


def test_poses_without_shapes_say_what_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "object.npz"
    np.savez(file, trans=np.zeros((3, 3)))
    with pytest.raises(SceneError, match=r"no shapes.*\[\[body\]\]"):
        rr.read_scene(file)


def test_two_bodies_of_one_name_are_refused(tmp_path: Path) -> None:
    one = f'[[body]]\nname = "box"\n{BOX}position = [2, 0, 0.5]\n'
    with pytest.raises(SceneError, match=r"scene\.toml:6: body 'box': another body has this name"):
        rr.read_scene(written(tmp_path, one + one))
    body = RigidBody("box", CUBE, FAR)
    with pytest.raises(SceneError, match="body 'box'"):
        Scene((body, replace(body)))


def test_a_model_with_a_shape_that_scenes_lack_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(
        '<mujoco><worldbody><body name="roll"><geom type="capsule" size=".1 .3"/></body></worldbody></mujoco>'
    )
    with pytest.raises(SceneError, match=r"scene\.xml: body 'roll'.*CAPSULE"):
        rr.read_scene(file)


def test_the_scan_of_a_room_is_said_to_act_as_its_hull(tmp_path: Path) -> None:
    """Four walls around the human: nothing is near it, but their hull holds it."""
    walls, faces = [], []
    for x, y, wide, deep in ((2, 0, 0.1, 4), (-2, 0, 0.1, 4), (0, 2, 4, 0.1), (0, -2, 4, 0.1)):
        box = [[x + a * wide / 2, y + b * deep / 2, c] for a in (-1, 1) for b in (-1, 1) for c in (0, 2.5)]
        faces += [[len(walls) + k for k in tri] for tri in ((0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6))]
        walls += box
    middle = CLIP.positions[0].mean(axis=0) * [1, 1, 0]
    room = RigidBody("room", mesh(np.array(walls), np.array(faces)), np.array([*middle, 1, 0, 0, 0]))
    with pytest.raises(SceneError, match="a mesh acts as its convex hull, and the scan of a room is not convex"):
        with_scene(CLIP, Scene((room,)))
