"""Grasp: goals press hands on a free body hard enough to hold it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import robot_retarget as rr
from robot_retarget.judge.compensate import SQUEEZE, grasp_pushes
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.rollout import plant_of
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid

OP3 = rr.load_robot("op3")
FRAMES, HEIGHT, GRAVITY = 30, 0.06, 9.81


def forward_arms() -> np.ndarray:
    """Both arms stretched forward, the palms towards each other."""
    pose = np.array(OP3.standing())
    for joint, angle in {"sho_pitch": 1.2, "sho_roll": 1.4, "el": -0.3}.items():
        for side, sign in (("l", 1.0), ("r", -1.0)):
            turned = sign * angle * (-1.0 if joint == "sho_pitch" else 1.0)
            pose[OP3.qpos_index[OP3.joint_names.index(f"{side}_{joint}")]] = turned
    return pose


def held(pose: np.ndarray) -> rr.Trajectory:
    """A trajectory that holds a box just as wide as the hands are apart."""
    model, data = OP3.model, mujoco.MjData(OP3.model)
    data.qpos[:] = pose
    mujoco.mj_kinematics(model, data)
    tip = max(
        (data.geom_xpos[g] for g in range(model.ngeom) if model.body(model.geom_bodyid[g]).name == "l_el_link"),
        key=lambda place: place[0],
    )

    def box(width: float) -> Scene:
        place = np.array([tip[0], 0.0, tip[2], 1, 0, 0, 0])
        shape = solid(ShapeKind.BOX, (0.04, width, HEIGHT))
        return Scene((RigidBody("box", shape, np.tile(place, (FRAMES, 1)), mass=0.1),))

    low, high = 0.01, 2 * float(tip[1])
    for _ in range(30):
        middle = (low + high) / 2
        scene = box(middle)
        near = RobotAmongBodies(OP3, scene).near(pose, scene.poses(FRAMES)[0], 1.0)
        low, high = (middle, high) if near.distance.min(initial=1.0) > 0 else (low, middle)
    return rr.Trajectory(np.tile(pose, (FRAMES, 1)), 30.0, OP3.joint_names, OP3.name, scene=box(low))


@pytest.fixture(scope="module")
def trajectory() -> rr.Trajectory:
    return held(forward_arms())


def pushes(plant: Plant, trajectory: rr.Trajectory) -> np.ndarray:
    """Return the generalised forces (nv,) on the still robot and body."""
    state = plant.places.model_qpos(trajectory.qpos[0])
    assert plant.bodies is not None
    state[plant.bodies.coordinates] = plant.bodies.free_paths(np.zeros(1))[0]
    still = np.zeros((1, plant.model.nv))
    return grasp_pushes(plant, state[None], still, still, 125.0)[0]


def test_hands_give_a_body_its_weight_and_no_torque(trajectory: rr.Trajectory) -> None:
    plant = plant_of(OP3, "pinned", scene=trajectory.scene, objects="free")
    on_body = pushes(plant, trajectory)[-6:]
    np.testing.assert_allclose(on_body, [0, 0, 0.1 * GRAVITY, 0, 0, 0], atol=0.02)


def test_hands_press_towards_each_other(trajectory: rr.Trajectory) -> None:
    plant = plant_of(OP3, "pinned", scene=trajectory.scene, objects="free")
    assert plant.bodies is not None
    found = pushes(plant, trajectory)
    slope, data = np.empty((3, plant.model.nv)), mujoco.MjData(plant.model)
    data.qpos[:] = plant.places.model_qpos(trajectory.qpos[0])
    mujoco.mj_forward(plant.model, data)
    arm = plant.dofs[OP3.joint_names.index("l_sho_roll")]
    mujoco.mj_jac(plant.model, data, slope, None, data.xpos[plant.bodies.ids[0]], plant.model.body("l_el_link").id)
    least = 0.5 * SQUEEZE * GRAVITY * OP3.model.body_mass.sum() * abs(slope[1, arm])
    assert abs(found[arm]) > least


@pytest.mark.parametrize(("compensate", "kept"), [(True, True), (False, False)])
def test_a_box_between_the_hands_stays_only_where_they_press(
    trajectory: rr.Trajectory, compensate: bool, kept: bool
) -> None:
    report = rr.simulate(trajectory, OP3, mode="pinned", objects="free", compensate=compensate, others=False)
    assert (report.figures["objects"]["box"]["dropped_s"] is None) == kept


def test_a_body_on_the_floor_asks_nothing_of_the_robot(trajectory: rr.Trajectory) -> None:
    low = np.array([0.5, 0.0, HEIGHT / 2, 1, 0, 0, 0])
    assert trajectory.scene is not None
    body = replace(trajectory.scene.bodies[0], poses=np.tile(low, (FRAMES, 1)))
    plant = plant_of(OP3, "free", scene=Scene((body,)), objects="free")
    found = pushes(plant, replace(trajectory, scene=Scene((body,))))
    np.testing.assert_allclose(found[-6:], [0, 0, 0.1 * GRAVITY, 0, 0, 0], atol=0.02)
    np.testing.assert_array_equal(found[:-6], 0.0)
