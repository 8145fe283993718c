"""A robot on steps: where contacts push, on which part of a step a sole stands, how feet get there, and the whole in simulation."""

from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.arrays import intervals, unit
from robot_retarget.contact.stance import planned_stance
from robot_retarget.judge.playback import PlayedPlant
from robot_retarget.judge.rollout import plant_of, simulate
from robot_retarget.judge.stance import zero_moment_point
from robot_retarget.robot.dynamics import ground_push, root_dofs
from robot_retarget.robot.support import feet_of, planes_through
from robot_retarget.scene.geoms import SolidGround
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid
from robot_retarget.solver.balance.footsteps import foothold_places

OP3 = rr.load_robot("op3")
SCENES = ROOT / "samples/scenes"
SOLE = np.array([[0.06, 0.04, 0.0], [0.06, -0.04, 0.0], [-0.06, 0.04, 0.0], [-0.06, -0.04, 0.0]])
ASIDE = np.array([0.0, 0.06, 0.0])
RISE = 0.03
WEIGHT = OP3.gravity * float(OP3.model.body_mass.sum())


def block(x: float, height: float = RISE, length: float = 0.2, pitch: float = 0.0) -> SolidGround:
    """Return a ground with a block of a width of 0.4 m whose near edge is at x, or a ramp about that edge."""
    pose = np.array([x + length / 2, 0.0, height / 2, np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0])
    return SolidGround(Scene((RigidBody("block", solid(ShapeKind.BOX, (length, 0.4, height)), pose),)))


@cache
def stepped() -> rr.Result:
    """The sample at few frames: the OP3 follows the human onto a step."""
    return rr.retarget(SCENES / "step.bvh", OP3, scene=SCENES / "step.toml", legs="follow", fps=10)


@given(st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_forces_on_one_plane_push_at_the_mean_of_their_places_weighed_by_their_normal_parts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    normal = unit(np.append(rng.uniform(-0.5, 0.5, 2), 1.0))
    places = rng.normal(size=(6, 3)) * 0.2
    places -= ((places - places[0]) @ normal)[:, None] * normal
    forces = rng.uniform(0.1, 1.0, (6, 1)) * normal + 0.3 * rng.normal(size=(6, 3))
    forces += np.maximum(0.1 - forces @ normal, 0.0)[:, None] * normal
    wrench = np.concatenate([forces.sum(axis=0), np.cross(places, forces).sum(axis=0)])
    planes = planes_through([places], [np.tile(normal, (6, 1))])
    assert planes.normals[0] == pytest.approx(normal, abs=1e-9)
    share = forces @ normal
    assert planes.points(wrench[None])[0] == pytest.approx(share @ places / share.sum(), abs=1e-9)


def test_ground_that_carries_a_twentieth_of_the_weight_has_a_zero_moment_point() -> None:
    planes, ground = planes_through([SOLE, SOLE], [np.tile([0.0, 0.0, 1.0], (4, 1))] * 2), np.zeros((2, 6))
    ground[:, 2] = 0.049, 0.051
    light, heavy = zero_moment_point(ground, planes, 1.0)
    assert np.isnan(light).all() and heavy == pytest.approx([0.0, 0.0])


def test_a_sole_that_overhangs_stands_on_the_part_over_the_step() -> None:
    points, heights, normals = block(0.013).footing(SOLE + np.array([0.0, 0.0, RISE]))
    assert (points.min(axis=0), points.max(axis=0)) == (
        pytest.approx([0.013, -0.04, RISE], abs=1e-3), pytest.approx([0.06, 0.04, RISE], abs=1e-3),
    )  # fmt: skip
    assert np.abs(heights).max() < 1e-9 and normals == pytest.approx(np.tile([0, 0, 1.0], (len(points), 1)))


def test_a_sole_on_a_ramp_has_the_normal_of_the_ramp() -> None:
    ground = block(-0.1, pitch=-0.2)
    heights, _ = ground.under(SOLE[None] + [0, 0, 0.1], above=0.3)
    ahead = SOLE.copy()
    ahead[:, 2] = heights[0]
    _, _, normals = ground.footing(ahead)
    assert normals == pytest.approx(np.tile([-np.sin(0.2), 0.0, np.cos(0.2)], (len(normals), 1)), abs=1e-6)


def test_a_swing_goes_over_the_edge_of_a_step_and_ends_flat_on_it() -> None:
    planted = np.ones((60, 2), bool)
    planted[20:40, 0] = False
    left, right = SOLE + ASIDE, SOLE - ASIDE
    ahead = np.interp(np.arange(60), [20, 40], [0.0, 0.15])
    corners = np.stack([left + np.outer(ahead, [1, 0, RISE / 0.15])[:, None], np.tile(right, (60, 1, 1))], axis=1)
    ground = block(0.07)
    places = foothold_places(planted, corners, 0.02, 0.0, ground)
    assert places[40:, 0, :, 2] == pytest.approx(RISE) and not places[:20, :, :, 2].any()
    toe = places[:, 0, :2, 0].max(axis=1)
    assert (places[toe > 0.0705, 0, :, 2] > RISE - 1e-9).all()
    assert (np.diff(np.sign(np.round(np.diff(places[19:41, 0, 0, 2]), 9))) <= 0).all()  # up, then down


def test_a_robot_steps_up_in_time_for_its_knee_and_does_not_throw_its_hips() -> None:
    trajectory = stepped().trajectory
    roll = Rotation.from_quat(trajectory.qpos[:, 3:7], scalar_first=True).as_euler("xyz")[:, 0]
    assert np.abs(np.diff(roll)).max() * trajectory.fps < 1.0  # 1.8 rad/s in the time of a level step


def apart() -> int:
    """A frame of the sample in which both feet stand, one of them on the step."""
    balance = stepped().balance
    assert balance is not None
    both = balance.timeline.planted.all(axis=1)
    frames = np.flatnonzero(both & (np.ptp(balance.places[..., 2], axis=(1, 2)) > 0.02))
    return int(frames[len(frames) // 2])


def test_the_ground_carries_a_robot_with_one_foot_on_a_step_and_a_level_floor_would_leave_it_to_one_foot() -> None:
    trajectory = stepped().trajectory
    data, soles, root = mujoco.MjData(OP3.model), feet_of(OP3).corners, root_dofs(OP3)
    data.qpos[:] = trajectory.qpos[apart()]
    mujoco.mj_forward(OP3.model, data)
    arm, weight = data.subtree_com[OP3.root_body] - data.xpos[OP3.root_body], np.array([0.0, 0.0, WEIGHT])
    wrench = np.append(weight, data.xmat[OP3.root_body].reshape(3, 3).T @ np.cross(arm, weight))
    missing = [
        np.linalg.norm(ground_push(OP3.model, data, soles, root, wrench, ground)[root] - wrench)
        for ground in (SolidGround(trajectory.scene), SolidGround())
    ]
    assert missing[0] < 0.02 < 0.2 < missing[1]


def test_a_step_is_played_in_balance_with_its_zero_moment_point_inside_the_soles() -> None:
    result = stepped()
    stance, balance = planned_stance(OP3, result.trajectory), result.balance
    assert stance is not None and balance is not None and balance.legs == "follow" and not result.solution.unmet
    assert min(np.nanmin(stance.zmp_margin), np.nanmin(stance.com_margin)) > 0.01
    assert balance.places[-1, :, :, 2] == pytest.approx(0.14 * result.match.leg_ratio, abs=1e-4)
    assert [len(intervals(~foot)) for foot in balance.timeline.planted.T] == [1, 1]


def test_the_zero_moment_point_on_two_levels_is_the_middle_of_mujocos_contact_forces() -> None:
    """Independent: the robot holds a pose with one foot on the step, and every contact's force is read."""
    trajectory = stepped().trajectory
    plant = plant_of(OP3, "free", scene=trajectory.scene)
    played = PlayedPlant(plant, 50.0)
    played.place(trajectory.qpos[apart()], on_floor=True)
    for _ in range(50):
        played.tick(trajectory.qpos[apart(), OP3.qpos_index])
    model, data, force = plant.model, played.data, np.zeros(6)
    mujoco.mj_forward(model, data)
    places, pushes = [], []
    for k, contact in enumerate(data.contact):
        mujoco.mj_contactForce(model, data, k, force)
        first = int(model.geom_bodyid[contact.geom[0]])
        sign = 1.0 if first == 0 or first >= OP3.model.nbody else -1.0
        places.append(contact.pos.copy())
        pushes.append(sign * contact.frame.reshape(3, 3).T @ force[:3])
    where, push = np.array(places), np.array(pushes)
    assert np.ptp(where[:, 2]) > 0.03 and push[:, 2].sum() == pytest.approx(WEIGHT, rel=0.02)
    wrench = np.append(push.sum(axis=0), np.cross(where, push).sum(axis=0))
    planes = planes_through([where], [np.tile([0.0, 0.0, 1.0], (len(where), 1))])
    share = push @ planes.normals[0]
    middle = share @ where / share.sum()
    assert zero_moment_point(wrench[None], planes, 1.0)[0] == pytest.approx(middle[:2], abs=2e-3)


def test_a_step_passes_in_simulation() -> None:
    report = simulate(stepped(), mode="free", draws=0, others=False)
    assert report.verdict == "pass", report.reasons
    assert min(report.figures["support_share"].values()) > 0.5  # the step counts as ground
