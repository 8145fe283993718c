"""Steps and seats are found in a capture; a face has the distance of the nearest point of a link."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.human.match import match
from robot_retarget.human.terrain import with_terrain
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid

OP3 = rr.load_robot("op3")
SCENES, SAMPLES = ROOT / "samples/scenes", ROOT / "samples"
RISE = 0.14
"""Of the sample's step [m]."""


def found(motion: rr.Motion) -> tuple[rr.Motion, Scene | None]:
    shown = with_terrain(motion, match(motion, OP3))
    return shown, shown.scene


def test_a_step_has_the_height_to_which_the_feet_go_and_holds_them() -> None:
    motion, scene = found(rr.read_motion(SCENES / "step.bvh"))
    assert scene is not None and scene.names == ("step 1",)
    body = scene.bodies[0]
    assert body.shape.size[2] == pytest.approx(RISE, abs=0.005)
    ankles = [motion.skeleton.names.index(f"{side}Ankle") for side in ("Left", "Right")]
    for frame, inside in ((0, False), (-1, True)):
        away = np.abs(motion.positions[frame, ankles, :2] - body.poses[:2])
        assert (away < body.shape.size[:2] / 2).all(axis=1).tolist() == [inside, inside]


def test_a_floor_at_another_height_is_moved_to_zero() -> None:
    motion = rr.read_motion(SCENES / "step.bvh")
    lifted = replace(motion, positions=motion.positions + np.array([0, 0, 1.0]))
    (shown, scene), (level, same) = found(lifted), found(motion)
    assert scene is not None and same is not None
    np.testing.assert_allclose(scene.bodies[0].shape.size, same.bodies[0].shape.size, atol=1e-9)
    assert shown.positions[..., 2].min() == pytest.approx(level.positions[..., 2].min(), abs=0.05)


def test_a_seat_is_under_the_pelvis_while_it_rests() -> None:
    motion, scene = found(rr.read_motion(SCENES / "chair.bvh"))
    assert scene is not None and scene.names == ("seat 1",)
    hips = [motion.skeleton.names.index(f"{side}Hip") for side in ("Left", "Right")]
    seat, pelvis = scene.bodies[0], motion.positions[len(motion) // 2, hips].mean(axis=0)
    assert 0 < pelvis[2] - seat.shape.size[2] < 0.12
    assert (np.abs(pelvis[:2] - seat.poses[:2]) < seat.shape.size[:2] / 2).all()


@pytest.mark.parametrize("clip", ["walk", "squat", "hips_and_bow", "wave"])
def test_a_level_floor_has_no_steps_and_no_seats(clip: str) -> None:
    motion = rr.read_motion(SAMPLES / f"{clip}.bvh")
    assert found(motion)[0] is motion


def test_footholds_of_the_robot_lie_on_the_step_that_is_found() -> None:
    graph = rr.describe(SCENES / "step.bvh", OP3, terrain="auto")
    track = next(track for track in graph.tracks if track.name == "foothold")
    heights = track.lower[-1].reshape(-1, 3)[:, 2]
    np.testing.assert_allclose(heights, RISE * graph.match.leg_ratio, atol=0.002)


def test_the_distance_of_a_face_is_that_of_the_nearest_corner_with_its_slope() -> None:
    scene = rr.read_scene(SCENES / "box.toml")
    among, rng = RobotAmongBodies(OP3, scene), np.random.default_rng(5)
    link, pose = OP3.model.body("l_el_link").id, np.array(OP3.standing())
    geoms = among.geoms_of(np.array([link]))
    normal = rng.normal(size=3)
    face, poses = (np.array([0.1, 0.2, 0.3]), normal / np.linalg.norm(normal)), scene.poses(271)[0]

    def distance(qpos: np.ndarray) -> float:
        return among.to_face(qpos, poses, geoms, face)[0]

    least, slope = among.to_face(pose, poses, geoms, face)
    assert least == pytest.approx(nearest_corner(pose, link, face), abs=1e-6)
    step, moved = rng.normal(size=OP3.model.nv) * 1e-6, pose.copy()
    mujoco.mj_integratePos(OP3.model, moved, step, 1.0)
    assert distance(moved) - least == pytest.approx(slope @ step, abs=1e-9)


def nearest_corner(pose: np.ndarray, link: int, face: tuple[np.ndarray, np.ndarray]) -> float:
    """Return the least height of the link's boxes and capsules over a face [m]."""
    data = mujoco.MjData(OP3.model)
    data.qpos[:] = pose
    mujoco.mj_kinematics(OP3.model, data)
    heights = []
    for geom in solid_geoms(OP3)[link]:
        size, own = OP3.model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3).T @ face[1]
        capsule = OP3.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
        half = size[0] + size[1] * abs(own[2]) if capsule else np.abs(size * own).sum()
        heights.append(float((data.geom_xpos[geom] - face[0]) @ face[1]) - half)
    return min(heights)


def test_a_hand_that_overhangs_a_small_face_touches_the_body_and_one_beside_it_the_plane_of_the_face() -> None:
    cube = RigidBody("cube", solid(ShapeKind.BOX, (0.04, 0.04, 0.04)), np.tile([0.5, 0, 1.0, 1, 0, 0, 0], (2, 1)))
    among, pose = RobotAmongBodies(OP3, Scene((cube,))), np.array(OP3.standing())
    geoms = among.geoms_of(np.array([OP3.model.body("l_el_link").id]))
    among.place(pose, cube.poses[:1])
    middle = among.data.geom_xpos[geoms[0]]

    def found(way: np.ndarray) -> tuple[float, float, float]:
        """The cube's face across x, seen from the hand along a way: distance from the side, the plane and the body [m]."""
        poses = np.append(middle - way, [1.0, 0, 0, 0])[None]
        face = (poses[0, :3] + [0.02, 0, 0], np.array([1.0, 0, 0]))
        side, plane = among.to_side(pose, poses, geoms, 0, face)[0], among.to_face(pose, poses, geoms, face)[0]
        ends = np.zeros(6)
        body = min(
            mujoco.mj_geomDistance(among.model, among.data, among.model.geom("scene: cube").id, g, 1.0, ends)
            for g in geoms
        )
        return side, plane, body

    side, plane, body = found(np.array([0.15, 0.0, 0.0]))
    assert side == pytest.approx(body, abs=1e-9) and plane < body - 1e-5
    side, plane, body = found(np.array([0.0, 0.3, 0.0]))
    assert side == pytest.approx(plane, abs=1e-9) and plane != pytest.approx(body, abs=1e-3)
