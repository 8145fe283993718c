"""Bodies in simulation: carried along their path, or free and held by friction; a dropped one fails the verdict."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import robot_retarget as rr
from robot_retarget.base.choices import Stand
from robot_retarget.base.errors import SceneError, UsageError
from robot_retarget.judge.feedback import with_feedback
from robot_retarget.judge.playback import plain_goals
from robot_retarget.judge.rollout import plant_of
from robot_retarget.scene.scene import FIELDS, OPTIONAL, RigidBody, Scene, arrays_of, scene_from
from robot_retarget.scene.shape import ShapeKind, height_field, mesh, solid
from robot_retarget.trajectory import load_trajectory

OP3 = rr.load_robot("op3")
STAND = rr.Trajectory(np.tile(OP3.standing(), (20, 1)), 30.0, OP3.joint_names, OP3.name)
CUBE = solid(ShapeKind.BOX, (0.1, 0.1, 0.1))


def beside(height: float, moves: bool = True) -> Scene:
    """A box in front of the robot, in the air or on the floor."""
    pose = np.array([0.5, 0.0, height, 1, 0, 0, 0])
    return Scene((RigidBody("box", CUBE, np.tile(pose, (20, 1)) if moves else pose, mass=0.1),))


def test_a_free_body_in_the_air_is_dropped_and_said_so() -> None:
    report = rr.simulate(
        replace(STAND, scene=beside(0.6)), OP3, mode="free", objects="free", draws=0, others=False, compensate=False
    )
    assert any("box is dropped at" in reason for reason in report.reasons)


@pytest.mark.parametrize("mode", ["free", "pinned"])
def test_a_free_body_on_the_floor_stays(mode: Stand) -> None:
    played = replace(STAND, scene=beside(0.05))
    report = rr.simulate(played, OP3, mode=mode, objects="free", draws=0, others=False, compensate=False)
    assert report.figures["objects"]["box"]["dropped_s"] is None
    assert report.figures["objects"]["box"]["off_m"] < 0.005


def test_a_carried_body_changes_nothing_that_it_does_not_touch() -> None:
    alone, among = (
        rr.simulate(replace(STAND, scene=scene), OP3, mode="free", draws=0, compensate=False)
        for scene in (None, beside(0.6))
    )
    assert among.verdict == alone.verdict
    np.testing.assert_allclose(among.series["measured"], alone.series["measured"], atol=1e-6)


def test_objects_are_carried_or_free() -> None:
    with pytest.raises(UsageError, match="unknown objects 'held'; known: carried, free"):
        rr.simulate(STAND, OP3, objects="held")  # type: ignore[arg-type]


def every_shape() -> Scene:
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]])
    shapes = (
        CUBE,
        mesh(CUBE.corners, faces),
        height_field(np.array([[0, 0.1, 0], [0.2, 0, 0.1]]), 1, 2),
        solid(ShapeKind.PLANE, ()),
    )
    still = np.array([0.5, 0.0, 0.2, 1, 0, 0, 0])
    return Scene(
        tuple(
            RigidBody(f"b{k}", shape, still if k % 2 else np.tile(still, (20, 1)), mass=1.0)
            for k, shape in enumerate(shapes)
        )
    )


@pytest.mark.parametrize("judged", [False, True])
def test_a_scene_survives_the_trajectory_file(judged: bool, tmp_path: Path) -> None:
    """Also beside judged goals with feedback, whose arrays have sizes of their own."""
    scene, file = every_shape(), tmp_path / "t.npz"
    plant = plant_of(OP3, "free")
    goals = with_feedback(plant, STAND, plain_goals(plant, STAND, None))
    assert goals.feedback is not None
    replace(STAND, scene=scene, goals=goals if judged else None).save(file)
    found = load_trajectory(file).scene
    assert found is not None and found.names == scene.names
    for before, after in zip(scene.bodies, found.bodies, strict=True):
        assert (before.shape.kind, before.fixed, before.weight) == (after.shape.kind, after.fixed, after.weight)
        for name in ("size", "vertices", "faces", "heights"):
            np.testing.assert_array_equal(getattr(before.shape, name), getattr(after.shape, name))
        np.testing.assert_allclose(before.poses, after.poses)


def test_broken_scenes_of_files_are_refused() -> None:
    whole = arrays_of(every_shape(), 20)
    assert scene_from(whole) is not None
    for name in FIELDS:
        if name not in ("scene_names", *OPTIONAL):
            with pytest.raises(SceneError, match=name):
                scene_from({key: value for key, value in whole.items() if key != name})
    with pytest.raises(SceneError, match="scene_counts"):
        scene_from(whole | {"scene_counts": whole["scene_counts"] + 1})
    with pytest.raises(SceneError, match="scene_faces"):
        scene_from(whole | {"scene_faces": whole["scene_faces"] + 99})
