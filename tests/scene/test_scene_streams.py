"""Bodies in streams: each frame brings their poses; hands stay on them, feet on top of them."""

from collections import Counter
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.errors import SceneError
from robot_retarget.graph.placed_scene import PlacedScene, placed_scene
from robot_retarget.graph.track import Status
from robot_retarget.human.match import match
from robot_retarget.human.surroundings import LiveScene, with_scene
from robot_retarget.human.terrain import with_terrain
from robot_retarget.live.frame import FaultCounter
from robot_retarget.live.messages import LineDecoder, line_of, skeleton_line
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid
from robot_retarget.solver.stream import Stream, StreamPose

OP3 = rr.load_robot("op3")
SCENES = ROOT / "samples/scenes"
BOX = with_scene(rr.read_motion(SCENES / "box.bvh").resample(30), rr.read_scene(SCENES / "box.toml")).frames(45, 110)
STEP = with_terrain(
    whole := rr.read_motion(SCENES / "step.bvh").resample(30),
    match(whole, OP3),
)


def placed(motion: rr.Motion) -> PlacedScene:
    graph = rr.describe(motion, OP3)
    scene = placed_scene(graph.human, graph.match)
    assert scene is not None
    return scene


def distances(scene: PlacedScene, qpos: np.ndarray, body: str, links: list[int]) -> np.ndarray:
    """(T,) least distance of links from a body, by MuJoCo alone [m]."""
    among, poses = scene.among(OP3), scene.poses(len(qpos))
    model = among.model
    own = [g for g in range(OP3.model.ngeom) if OP3.model.geom_contype[g] and OP3.model.geom_bodyid[g] in links]
    solid_body, found = model.geom(f"scene: {body}").id, []
    for q, pose in zip(qpos, poses, strict=True):
        among.near(q, pose, 0.0)
        found.append(min(mujoco.mj_geomDistance(model, among.data, solid_body, g, 1.0, None) for g in own))
    return np.array(found)


def pushed(stream: Stream, motion: rr.Motion) -> Iterator[StreamPose]:
    assert motion.rotations is not None
    for t, (positions, rotations) in enumerate(zip(motion.positions, motion.rotations, strict=True)):
        yield stream.push(positions, rotations, time=t / motion.fps, poses=motion.poses_at(t))


def test_hands_stay_on_the_box_that_the_human_lifts() -> None:
    qpos, scene = np.array(list(rr.stream(OP3, BOX, native=False))), placed(BOX)
    around = rr.describe(BOX, OP3).human.around
    assert around is not None
    for hand in ("l_hand", "r_hand"):
        held = around.touches.held[:, around.touches.pairs.index((hand, 1))]
        away = distances(scene, qpos, "box", [match(BOX, OP3).anatomy.sites[hand].body])
        assert held.sum() > 40
        assert ((away >= -0.0011) & (away <= 0.02))[held][6:].all()  # no earlier frame shows the touch
        assert np.abs(away[held][8:]).max() < 5e-4


def test_feet_stand_on_the_step_and_do_not_sink_into_it() -> None:
    qpos, scene = np.array(list(rr.stream(OP3, STEP, native=False))), placed(STEP)
    soles = match(STEP, OP3).anatomy.soles
    for side in "lr":
        away = distances(scene, qpos, "step 1", [int(soles[side].bodies[0])])
        assert away.min() > -0.0011
        assert away[-1] < 0.002
    top = float(scene.scene.bodies[0].shape.size[2])
    assert qpos[-1, 2] - qpos[0, 2] == pytest.approx(top, abs=0.01)


def test_poses_in_packets_are_those_of_the_recording() -> None:
    """A stream whose frames bring the recorded poses is the replay of the recording, and says where the bodies are."""
    part = BOX.frames(15, 30)
    replayed, scene = np.array(list(rr.stream(OP3, part, native=False))), placed(part)
    poses = list(pushed(Stream(OP3, part.skeleton, calibration=part, native=False), part))
    np.testing.assert_array_equal([pose.qpos for pose in poses], replayed)
    said = np.array([[pose.bodies[name] for name in scene.names] for pose in poses])
    np.testing.assert_allclose(said, scene.poses(len(part)), atol=1e-12)


def test_a_performer_who_is_not_known_is_watched_among_the_bodies() -> None:
    stream = Stream(OP3, BOX.skeleton, native=False, scene=SCENES / "box.toml")
    poses = list(pushed(stream, BOX))
    assert poses[0].status is Status.CALIBRATING
    assert poses[-1].bodies.keys() == {"table", "box"}
    assert stream.performer is not None
    assert stream.performer.graph.kinds.keys() >= {"contact", "near", "clearance"}


def test_a_body_keeps_its_pose_until_a_frame_brings_another_and_wrong_ones_are_counted() -> None:
    box = RigidBody("box", solid(ShapeKind.BOX, (0.1, 0.1, 0.1)), np.array([2.0, 0, 0.5, 1, 0, 0, 0]))
    floor = RigidBody("ground", solid(ShapeKind.PLANE, ()), np.array([0, 0, 0, 1.0, 0, 0, 0]))
    faults = Counter[str]()
    live, joints = LiveScene(Scene((box, floor)), BOX.skeleton, faults), np.zeros((len(BOX.skeleton), 3))
    moved = np.array([3.0, 0, 0.5, 2 / 3, 1 / 3, 2 / 3, 0])
    for given, place in (({}, 2.0), ({"box": moved}, 3.0), ({}, 3.0), ({"box": moved * np.nan}, 3.0)):
        assert live.step(given, joints, None)[0, 0] == place
    live.step({"bxo": moved, "ground": moved, "box": moved}, joints, None)
    assert faults == {
        "no pose of body 'box'": 1,
        "no pose for body 'box'": 1,
        "no body 'bxo'": 1,
        "body 'ground' cannot move": 1,
    }
    assert np.linalg.norm(live.poses[0, 3:]) == pytest.approx(1)


def test_a_joint_carries_a_body_through_a_stream() -> None:
    wrist = BOX.skeleton.names.index("LeftWrist")
    own = np.array([0.1, 0, 0, 1.0, 0, 0, 0])
    held = RigidBody("box", solid(ShapeKind.BOX, (0.1, 0.1, 0.1)), own, carrier="LeftWrist")
    live = LiveScene(Scene((held,)), BOX.skeleton, Counter())
    recorded = with_scene(BOX.clip, Scene((held,))).scene
    assert recorded is not None and BOX.clip.rotations is not None
    for t in (0, 50):
        found = live.step({}, BOX.clip.positions[t], BOX.clip.rotations[t])
        np.testing.assert_allclose(found, recorded.poses(len(BOX.clip))[t])
    assert np.linalg.norm(found[0, :3] - BOX.clip.positions[50, wrist]) == pytest.approx(0.1)
    with pytest.raises(SceneError, match="no joint 'Wrist'"):
        LiveScene(Scene((RigidBody("box", held.shape, own, carrier="Wrist"),)), BOX.skeleton, Counter())


def test_a_line_carries_the_poses_of_bodies() -> None:
    decoder = LineDecoder(FaultCounter())
    decoder.feed(skeleton_line(BOX.skeleton), 0.0)
    assert decoder.feed(line_of(0.0, BOX.positions[0], None, BOX.poses_at(0)), 0.0) == 1
    np.testing.assert_allclose(decoder.newest().poses["box"], BOX.poses_at(0)["box"], atol=1e-6)
    assert decoder.feed(line_of(0.1, BOX.positions[0]), 0.1) == 1
    assert decoder.newest().poses == {}
