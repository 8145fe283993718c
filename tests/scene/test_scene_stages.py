"""Touch-ups, warnings, scores and pages know the bodies around the robot."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.collision import warnings_of
from robot_retarget.edit.cuts import mirrored, trimmed
from robot_retarget.edit.touchup import apply_edit, graph_of
from robot_retarget.graph.edits import Edit
from robot_retarget.graph.placed_scene import captured_scene, placed_scene
from robot_retarget.human.robot_performer import performed
from robot_retarget.human.surroundings import with_scene
from robot_retarget.scene.scene import RigidBody, Scene, extrapolated
from robot_retarget.scene.shape import ShapeKind, height_field, solid
from robot_retarget.scores.score import score
from robot_retarget.tools.view.staging import arrange
from robot_retarget.tools.view.web.shapes import shapes_of_scene
from robot_retarget.tools.view.web.show import Packer, take_header
from robot_retarget.tools.view.web.take import take_of
from robot_retarget.trajectory import Trajectory, load_trajectory

OP3 = rr.load_robot("op3")
SCENES = ROOT / "samples/scenes"
CLIP = rr.read_motion(SCENES / "box.bvh")
LIFT = with_scene(CLIP, rr.read_scene(SCENES / "box.toml")).frames(65, 115)
HAND = Edit("edge", {"a": "head", "b": "l_hand", "at": 0.14, "frames": [20, 30]})


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Trajectory:
    file = tmp_path_factory.mktemp("solved") / "lift.npz"
    rr.solve(rr.describe(LIFT, OP3, scene_scale=0.24), balance="off").trajectory.save(file)
    return load_trajectory(file)


def distances(trajectory: Trajectory, body: str, link: str = "") -> np.ndarray:
    """(T,) least distance of the links with a text in their names from a body of the trajectory, by MuJoCo alone [m]."""
    spec, scene = OP3.spec(), trajectory.scene
    assert scene is not None
    own = scene.bodies[scene.names.index(body)]
    there = spec.worldbody.add_body(name="there", mocap=True)
    there.add_geom(name="there", type=mujoco.mjtGeom.mjGEOM_BOX, size=own.shape.size / 2)
    model = spec.compile()
    data, found = mujoco.MjData(model), []
    geoms = [
        g for g in range(OP3.model.ngeom) if OP3.model.geom_contype[g] and link in model.body(model.geom_bodyid[g]).name
    ]
    poses = np.broadcast_to(own.poses, (len(trajectory), 7))
    for q, pose in zip(trajectory.qpos, poses, strict=True):
        data.qpos[:], data.mocap_pos[0], data.mocap_quat[0] = q, pose[:3], pose[3:]
        mujoco.mj_kinematics(model, data)
        found.append(min(mujoco.mj_geomDistance(model, data, model.geom("there").id, g, 1.0, None) for g in geoms))
    return np.array(found)


def shifted(trajectory: Trajectory, frames: slice, way: float) -> Trajectory:
    """The robot moved along y at some frames, gradually [m]."""
    qpos, count = trajectory.qpos.copy(), len(trajectory.qpos[frames])
    qpos[frames, 1] += way * np.sin(np.linspace(0, np.pi, count)) ** 2
    return trajectory.altered(qpos=qpos)


@pytest.mark.parametrize("scale", [None, 0.3])
def test_bodies_of_a_trajectory_go_back_to_the_human_and_come_again(scale: float | None) -> None:
    graph = rr.describe(LIFT, OP3, scene_scale=scale)
    there = placed_scene(graph.human, graph.match)
    assert there is not None and LIFT.scene is not None
    moved = replace(
        graph.motion, positions=graph.motion.positions + np.array([0.3, 0, 0])
    )  # a playback may begin elsewhere
    for placed, motion in ((there.scene, moved), (replace(there.scene, world=None), graph.motion)):
        back = captured_scene(placed, motion, graph.match)
        for body, known in zip(back.bodies, LIFT.scene.bodies, strict=True):
            np.testing.assert_allclose(body.poses, known.poses, atol=1e-9)
            np.testing.assert_allclose(body.shape.size, known.shape.size, atol=1e-12)


def test_a_trajectory_file_keeps_the_map_from_the_floor_of_the_human(solved: Trajectory) -> None:
    graph = rr.describe(LIFT, OP3)
    pelvis = graph.human.positions[0, graph.match.index("pelvis")]
    assert solved.scene is not None and solved.scene.scale == 0.24
    assert solved.scene.world == pytest.approx((graph.match.leg_ratio, *pelvis[:2]))


def test_a_touch_up_keeps_the_hands_on_the_box_and_out_of_it(solved: Trajectory) -> None:
    """The other hand may move by a tenth of a millimetre; without bodies the same edge pulls the hand into the box."""
    done = apply_edit(graph_of(CLIP, OP3, solved), solved, HAND)
    assert np.abs(done.trajectory.qpos - solved.qpos).max() > 0.01
    for hand in ("l_el", "r_el"):
        assert np.abs(distances(done.trajectory, "box", hand)).max() < 1e-3
    bare = apply_edit(graph_of(CLIP, OP3, solved.altered(scene=None)), solved, HAND)
    assert distances(bare.trajectory, "box").min() < -0.005


def test_a_link_that_goes_into_a_body_is_warned_of_and_one_that_rests_is_not(solved: Trajectory) -> None:
    assert not [e for e in warnings_of(solved, OP3).events if e.contact is not None]
    pushed = shifted(solved, slice(15, 45), 0.02)
    depth = distances(pushed, "box", "_el_link")
    events = [e for e in warnings_of(pushed, OP3).events if e.pair[1] == "box"]
    hits = [(e.first_warning, e.contact) for e in events if e.contact is not None]
    assert min(contact for _, contact in hits) == int(np.flatnonzero(depth < -0.0011)[0])
    assert all(warned <= contact for warned, contact in hits)


def test_a_body_that_comes_to_a_robot_at_rest_is_warned_of_beforehand() -> None:
    """A wall at 0.15 m/s: the interaction distance one step ahead is the distance less the way of a step."""
    wall = solid(ShapeKind.BOX, (0.1, 1.0, 1.0))
    poses = np.zeros((50, 7))
    poses[:, 0], poses[:, 3] = 0.35 - 0.005 * np.arange(50), 1.0
    still = np.repeat(OP3.standing()[None], 50, axis=0)
    scene = Scene((RigidBody("wall", wall, poses),))
    found = warnings_of(Trajectory(still, 30.0, OP3.joint_names, OP3.name, scene=scene), OP3, planned=False)
    own = [k for k, (_, body) in enumerate(found.pairs) if body == "wall"]
    now, ahead = found.distance[1:, own], found.ahead[1:, own]
    near = (now > 0.006) & (now < found.reach)
    assert near.sum() > 5
    np.testing.assert_allclose(ahead[near], now[near] - 0.005, atol=1e-6)
    first = min(found.events, key=lambda event: event.first_warning)
    assert first.pair[1] == "wall" and first.contact is not None and first.first_warning < first.contact


def test_the_mirror_image_of_a_trajectory_has_the_mirror_image_of_its_bodies(solved: Trajectory) -> None:
    """The other hand is as far from the box as this one was; the image of the image is the trajectory."""
    image = mirrored(shifted(solved, slice(15, 45), 0.02), OP3)
    for hand, other in (("l_el", "r_el"), ("r_el", "l_el")):
        before = distances(shifted(solved, slice(15, 45), 0.02), "box", other)
        np.testing.assert_allclose(distances(image, "box", hand), before, atol=2e-4)
    again = mirrored(mirrored(solved, OP3), OP3).scene
    assert again is not None and solved.scene is not None
    np.testing.assert_allclose(again.poses(len(solved)), solved.scene.poses(len(solved)), atol=1e-9)


def test_a_part_of_a_trajectory_has_the_bodies_of_its_frames(solved: Trajectory) -> None:
    part = trimmed(solved, 0.5, 1.0)
    assert part.scene is not None and solved.scene is not None
    np.testing.assert_array_equal(part.scene.poses(len(part)), solved.scene.poses(len(solved))[15:31])


def test_a_robot_that_performs_says_which_bodies_it_leaves(solved: Trajectory) -> None:
    assert any("left out: table, box" in note for note in performed(solved, OP3).notes)


def test_poses_go_on_as_they_went() -> None:
    turn = np.radians(10)
    before = np.array([[0.0, 0, 0, 1, 0, 0, 0]])
    now = np.array([[0.1, 0, 0, np.cos(turn / 2), 0, 0, np.sin(turn / 2)]])
    found = extrapolated(before, now, np.array([-1.0, 0.0, 2.0]))
    np.testing.assert_allclose(found[:2, 0], [before[0], now[0]], atol=1e-12)
    expected = [0.3, 0, 0, np.cos(1.5 * turn), 0, 0, np.sin(1.5 * turn)]
    np.testing.assert_allclose(found[2, 0] * np.sign(found[2, 0, 3]), expected, atol=1e-12)


def test_a_score_counts_touches_without_sinking_and_contacts_that_are_kept(solved: Trajectory) -> None:
    pushed = shifted(solved, slice(15, 45), 0.02)
    for trajectory, kept in ((solved, True), (pushed, False)):
        figures = score(trajectory, OP3, CLIP).figures
        near = np.minimum(distances(trajectory, "box"), distances(trajectory, "table"))
        touching = (near >= -0.0011) & (near <= 0.02)
        assert figures["body_touch_pct"] == pytest.approx(100 * touching.mean(), abs=0.06)
        assert figures["body_inside_pct"] == pytest.approx(100 * (near < -0.0011).mean(), abs=0.06)
        assert figures["body_depth_mm"] == pytest.approx(max(-1e3 * near.min(), 0), abs=0.06)
        share = figures["body_contacts_kept_pct"]
        assert share is not None and (share > 99) == kept
    assert score(solved.altered(scene=None), OP3, CLIP).figures["body_touch_pct"] is None
    assert any(note.startswith("box: contacts kept l_hand") for note in score(solved, OP3, CLIP).notes)


def test_the_camera_has_near_bodies_in_the_picture_and_stays_near_without_them() -> None:
    still = Trajectory(np.repeat(OP3.standing()[None], 3, axis=0), 3.0, OP3.joint_names, OP3.name)
    wide = solid(ShapeKind.BOX, (0.2, 0.5, 0.1))
    beside, away = (RigidBody("box", wide, np.array([x, 0, 0.05, 1.0, 0, 0, 0])) for x in (0.2, 5.0))
    alone, near, far = (
        arrange(OP3, still.altered(scene=scene), None, None, np.zeros(1)).distance
        for scene in (None, Scene((beside,)), Scene((away,)))
    )
    assert near > 1.05 * alone
    assert far == alone


def test_a_page_has_the_bodies_with_their_names_and_poses(solved: Trajectory) -> None:
    packer = Packer()
    header = take_header(take_of(solved, OP3), packer)
    assert header["around"]["names"] == ["table", "box"]
    assert [shape["kind"] for shape in header["around"]["shapes"]] == ["box", "box"]
    assert header["around"]["poses"]["shape"] == [len(solved), 2, 7]
    assert take_header(take_of(solved.altered(scene=None), OP3), Packer())["around"] is None


def test_shapes_of_pages_are_those_of_the_bodies() -> None:
    field = height_field(np.array([[0.0, 0.1, 0.2], [0.0, 0.1, 0.3]]), 2.0, 1.0)
    bodies = (
        RigidBody("ground", solid(ShapeKind.PLANE, ())),
        RigidBody("hill", field),
        RigidBody("can", solid(ShapeKind.CYLINDER, (0.2, 0.5))),
    )
    hill, can = shapes_of_scene(Scene(bodies))
    assert (hill.body, can.body) == (1, 2) and hill.mesh is not None
    vertices, faces = hill.mesh
    np.testing.assert_allclose(vertices[[0, 2, 3, 5]], [[-1, -0.5, 0], [1, -0.5, 0.2], [-1, 0.5, 0], [1, 0.5, 0.3]])
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    assert len(faces) == 4 and (np.cross(b - a, c - a)[:, 2] > 0).all()
    np.testing.assert_allclose(can.size, [0.1, 0.25, 0])
