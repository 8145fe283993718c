"""Edges of bodies: the robot touches what the human touches, at the same place of the body, and stays out of it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.graph.placed_scene import PlacedScene, placed_scene
from robot_retarget.graph.soles import raised
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.robot.kinematics import integrate
from robot_retarget.scene.scene import RigidBody, Scene, composed
from robot_retarget.scene.shape import ShapeKind, solid
from robot_retarget.solver.pipeline import Result

OP3 = rr.load_robot("op3")
WAVE = rr.read_motion(ROOT / "samples" / "wave.bvh").frames(0, 24)
WALK = rr.read_motion(ROOT / "samples" / "walk.bvh").frames(20, 50)
BESIDE = np.array([0.25, 0.05, 0.0, 0.8, 0.6, 0, 0])
EDGE = 0.24
"""Of a box in the hand [m]."""


def held_box() -> Scene:
    """A box that the left hand of the human carries, its side one centimetre outside the wrist."""
    wrist = WAVE.skeleton.names.index("LeftWrist")
    outward = unit_of(WAVE.positions[0, wrist] - WAVE.positions[0, WAVE.skeleton.names.index("LeftElbow")])
    assert WAVE.rotations is not None
    turn = Rotation.from_quat(WAVE.rotations[0, wrist], scalar_first=True)
    away = turn.inv().apply((EDGE / 2 + 0.01) * outward)
    align = (turn.inv() * Rotation.align_vectors([outward], [[1.0, 0, 0]])[0]).as_quat(scalar_first=True)
    shape = solid(ShapeKind.BOX, (EDGE, EDGE, EDGE))
    return Scene((RigidBody("box", shape, np.concatenate([away, align]), carrier="LeftWrist"),))


def unit_of(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


@pytest.fixture(scope="module")
def carried() -> Result:
    return rr.solve(rr.describe(WAVE, OP3, scene=held_box()), balance="off")


def scene_of(result: Result) -> PlacedScene:
    scene = placed_scene(result.graph.human, result.graph.match)
    assert scene is not None
    return scene


def distances(result: Result, link: str = "") -> np.ndarray:
    """(T,) least distance of the geoms of a link, or of all, from the first body, by MuJoCo alone [m]."""
    scene, robot = scene_of(result), result.robot
    among = scene.among(robot)
    geoms = [
        g
        for g in range(robot.model.ngeom)
        if robot.model.geom_contype[g] and link in robot.model.body(robot.model.geom_bodyid[g]).name
    ]
    body, found = among.model.geom("scene: box").id, []
    for q, poses in zip(result.trajectory.qpos, scene.poses(len(result.trajectory)), strict=True):
        among.near(q, poses, 0.0)
        found.append(min(mujoco.mj_geomDistance(among.model, among.data, body, g, 1.0, None) for g in geoms))
    return np.array(found)


def test_slopes_of_distances_are_their_differences() -> None:
    scene = Scene((RigidBody("box", solid(ShapeKind.BOX, (0.2, 0.2, 0.2)), BESIDE[None]),))
    among, draw = RobotAmongBodies(OP3, scene), np.random.default_rng(3)
    q = integrate(OP3, OP3.standing(), 0.3 * draw.normal(size=OP3.model.nv))  # parallel faces have no one nearest point
    pose = np.concatenate([BESIDE[:3] + q[:3], BESIDE[3:]])[None]
    found = among.near(q, pose, 0.3)
    assert len(found.distance) > 3
    for _ in range(5):
        way = draw.normal(size=OP3.model.nv) * 1e-5
        after, before = (among.near(integrate(OP3, q, sign * way), pose, 0.3) for sign in (1, -1))
        np.testing.assert_allclose((after.distance - before.distance) / 2, found.slope @ way, atol=5e-8)


def test_a_hand_touches_the_box_that_the_human_carries(carried: Result) -> None:
    site = carried.match.anatomy.sites["l_hand"]
    hand = distances(carried, OP3.model.body(site.body).name)
    assert carried.graph.human.around is not None and carried.graph.human.around.touches.held.any()
    assert np.abs(hand).max() < 0.002


def test_the_hand_does_not_slide_on_the_box(carried: Result) -> None:
    """The hand's keypoint stays within 4 mm of one place along the side of the box."""
    scene, robot = scene_of(carried), carried.robot
    site, data = carried.match.anatomy.sites["l_hand"], mujoco.MjData(robot.model)
    places = []
    for q, pose in zip(carried.trajectory.qpos, scene.poses(len(carried.trajectory))[:, 0], strict=True):
        data.qpos[:] = q
        mujoco.mj_kinematics(robot.model, data)
        world = data.xpos[site.body] + data.xmat[site.body].reshape(3, 3) @ site.offset
        places.append(Rotation.from_quat(pose[3:], scalar_first=True).inv().apply(world - pose[:3]))
    assert np.ptp(np.array(places)[:, 1:], axis=0).max() < 0.004


def test_no_link_is_inside_the_box(carried: Result) -> None:
    assert distances(carried).min() > -0.0011


@pytest.mark.parametrize("kind", [ShapeKind.BOX, ShapeKind.PLANE])
def test_a_hand_that_reaches_through_a_wall_meets_it_whatever_its_shape(kind: ShapeKind) -> None:
    """The wall is 8 cm nearer than the hand of the human, on its left; the arm ends at the wall, and nothing is behind it."""
    near = WAVE.positions[:, WAVE.skeleton.names.index("LeftWrist"), 1].max() - 0.08
    box = kind is ShapeKind.BOX
    pose = [0, near + 1, 0, 1, 0, 0, 0] if box else [0, near, 0, 0.5**0.5, 0.5**0.5, 0, 0]
    wall = Scene((RigidBody("box", solid(kind, (6, 2, 6) if box else ()), np.array(pose)),))
    found = distances(rr.solve(rr.describe(WAVE, OP3, scene=wall), balance="off"))
    assert found.min() > -0.0011 and np.abs(found).max() < 0.003


def test_the_cost_is_the_sum_of_the_kinds_with_bodies_too(carried: Result) -> None:
    assert {"contact", "near", "clearance"} <= carried.solution.stress.keys()
    np.testing.assert_allclose(carried.solution.cost, np.sum(list(carried.solution.stress.values()), axis=0))


def test_edges_of_bodies_are_contacts_and_clearances_and_poses_are_none(carried: Result) -> None:
    """The contact of one hand and the clearance of every solid link; no priority can drop the pose of a body."""
    kinds = carried.graph.kinds
    assert (len(kinds["contact"]), len(kinds["clearance"])) == (4, len(solid_geoms(OP3)))
    assert {end for name in ("contact", "clearance") for _, end in kinds[name].ends} == {"box"}
    bodies = carried.graph.with_priority("contact", 0).bodies
    assert bodies is not None
    np.testing.assert_allclose(bodies.poses(24), scene_of(carried).poses(24), atol=1e-12)


def test_without_a_scene_no_edge_is_added() -> None:
    assert not {"contact", "near", "clearance"} & rr.describe(WAVE, OP3).kinds.keys()


def test_ground_that_rises_lifts_the_robot_and_nothing_else() -> None:
    """A walk on a plateau of 0.2 m is the walk on the floor, raised by as much times the ratio of the legs."""
    high = 0.2
    plateau = RigidBody("plateau", solid(ShapeKind.BOX, (20, 20, high)), np.array([0, 0, high / 2, 1, 0, 0, 0]))
    level = replace(WALK, positions=WALK.positions - [0, 0, WALK.clip.positions[..., 2].min()], whole=None)
    raised_walk = replace(level, positions=level.positions + np.array([0, 0, high]))
    floor = Scene((RigidBody("wall", solid(ShapeKind.BOX, (0.1, 0.1, 0.1)), np.array([9.0, 0, 0.05, 1, 0, 0, 0])),))
    below, above = (rr.describe(m, OP3, scene=s) for m, s in ((level, floor), (raised_walk, Scene((plateau,)))))
    first, second = below.kinds["foothold"], above.kinds["foothold"]
    np.testing.assert_allclose(first.priority, second.priority)
    lift = np.array([axis == "z" for axis in first.axes]) * below.match.leg_ratio * high
    np.testing.assert_allclose(second.lower, first.lower + lift, atol=1e-6)


def test_corners_on_a_slope_lie_in_its_plane() -> None:
    normal = unit_of(np.array([0.2, -0.1, 1.0]))
    flat = np.array([[1.0, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    place = np.array([0.3, 0.2, 0.5])
    np.testing.assert_allclose((raised(flat, place, normal) - place) @ normal, 0, atol=1e-12)


@pytest.mark.parametrize("scale", [None, 1.0, 0.3])
def test_a_body_of_any_size_stands_on_the_floor_and_keeps_the_places_of_touches(scale: float | None) -> None:
    pose = np.array([1.0, 0.5, 0.2, 1, 0, 0, 0])
    box = Scene((RigidBody("box", solid(ShapeKind.BOX, (0.3, 0.3, 0.4)), pose),))
    graph = rr.describe(WAVE, OP3, scene=box, scene_scale=scale)
    scene = placed_scene(graph.human, graph.match)
    assert scene is not None
    own, size = scene.scene.bodies[0], graph.match.leg_ratio if scale is None else scale
    np.testing.assert_allclose(own.shape.size, size * np.array([0.3, 0.3, 0.4]))
    assert own.poses[2] == pytest.approx(own.shape.size[2] / 2)
    top = np.array([[[0.1, 0.0, 0.2]]])
    place = scene.points(np.array([0]), top, scene.poses(1))[0, 0]
    expected = composed(own.poses, np.array([*size * top[0, 0], 1, 0, 0, 0]))[:3]
    np.testing.assert_allclose(place, expected)
