"""Capsules contain what they stand for, and the pairs watched are those that MuJoCo lets touch."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from made_trajectories import robot_of, wander
from shared_files import SHARED, needs_shared

from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.capsules import Capsules, collision_geoms, fit_capsules
from robot_retarget.robot.clearance import Clearance, Marks
from robot_retarget.robot.collidable import collidable
from robot_retarget.simulate.contacts import built_in

SHAPES = """<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint/><geom type="box" size=".1 .15 .2"/>
<body name="egg" pos="0 .4 0"><joint name="a" axis="1 0 0"/><geom type="ellipsoid" size=".05 .1 .2" euler="20 30 40"/></body>
<body name="can" pos="0 -.4 0"><joint name="b" axis="1 0 0"/><geom type="cylinder" size=".08 .1" pos=".1 0 0"/>
<geom type="cylinder" size=".04 .2" pos="-.1 0 0" euler="0 90 0"/></body>
<body name="pill" pos="0 0 .5"><joint name="c" axis="1 0 0"/><geom type="capsule" size=".05" fromto="0 0 0 .1 .2 .3"/></body>
<body name="ball" pos="0 0 -.5"><joint name="d" axis="1 0 0"/><geom type="sphere" size=".07" pos=".02 0 0"/></body>
</body></worldbody></mujoco>"""
ROBOTS = ["op3", *(f"{name}/{name}.xml" for name in ("unitree_g1", "booster_t1", "robotis_op3", "toddlerbot_2xc"))]


def robot_named(name: str) -> Robot:
    return load_robot(name if name == "op3" else SHARED / "robots" / name)


def points_within(model: mujoco.MjModel, geom: int, draw: np.random.Generator, count: int = 400) -> np.ndarray:
    """Random points of a geom's surface in its own frame, from the definitions of the shapes."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    way = draw.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        corners = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        return draw.dirichlet(np.full(4, 0.3), count)[:, None] @ corners[draw.integers(len(corners), size=(count, 4))]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return np.sign(way) * size * draw.choice([1.0, 1.0, 0.5], (count, 3))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        turn = draw.uniform(0, 2 * np.pi, count)
        return np.stack([size[0] * np.cos(turn), size[0] * np.sin(turn), size[1] * draw.choice([-1, 1], count)], 1)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return way * size
    along = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
    return way * size[0] + np.array([0, 0, along]) * draw.choice([-1, 1], (count, 1))


def outside(capsules: Capsules, link: int, points: np.ndarray) -> float:
    """How far the worst of points (N, 3) in the link's frame is outside every capsule of the link."""
    gaps = []
    for k in capsules.by_link[link]:
        (a, b), r = capsules.ends[k], capsules.radius[k]
        share = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-18), 0, 1)
        gaps.append(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1) - r)
    return float(np.min(gaps, axis=0).max())


def assert_contained(robot: Robot) -> None:
    capsules, draw = fit_capsules(robot), np.random.default_rng(1)
    model, data = robot.model, mujoco.MjData(robot.model)
    mujoco.mj_kinematics(model, data)
    for link, geoms in collision_geoms(robot).items():
        assert link in capsules.by_link
        for geom in geoms:
            local = points_within(model, geom, draw)
            world = local.reshape(-1, 3) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            inside = (world - data.xpos[link]) @ data.xmat[link].reshape(3, 3)
            assert outside(capsules, link, inside) <= 1e-9, (model.body(link).name, geom)


def test_capsules_contain_every_kind_of_geom(tmp_path: Path) -> None:
    assert_contained(robot_of(SHAPES, tmp_path / "shapes.xml"))


@needs_shared
@pytest.mark.parametrize("name", ROBOTS)
def test_capsules_contain_the_geoms_of_robots(name: str) -> None:
    assert_contained(robot_named(name))


def test_geoms_that_touch_in_explicit_pairs_alone_are_covered_and_watched(tmp_path: Path) -> None:
    """Where a model lets no two links touch, all that is seen of them does."""
    arm = '<body name="{0}" pos="{1} 0 0"><joint name="{0}" axis="0 1 0"/><geom name="{0}" type="capsule" size=".05" '
    arms = (arm + 'fromto="0 0 0 0 0 .8" contype="0" conaffinity="0"/></body>').format
    bodies = f"<worldbody>{arms('left', -0.3)}{arms('middle', 0)}{arms('right', 0.3)}</worldbody>"
    seen = robot_of(f"<mujoco>{bodies}</mujoco>", tmp_path / "seen.xml")
    pair = '<contact><pair geom1="left" geom2="right"/></contact>'
    paired = robot_of(f"<mujoco>{bodies}{pair}</mujoco>", tmp_path / "paired.xml")
    assert collidable(paired).names(paired) == [("left", "right")]
    assert collidable(seen).names(seen) == [("left", "middle"), ("left", "right"), ("middle", "right")]
    assert_contained(paired)


def test_a_capsule_and_a_sphere_are_their_own_capsules(tmp_path: Path) -> None:
    robot = robot_of(SHAPES, tmp_path / "shapes.xml")
    capsules = fit_capsules(robot)
    pill, ball = robot.model.body("pill").id, robot.model.body("ball").id
    assert capsules.excess[ball] == pytest.approx(0, abs=1e-6)
    assert capsules.radius[capsules.by_link[pill][0]] == pytest.approx(0.05, abs=0.02)
    assert all(0 <= excess < 0.2 for excess in capsules.excess.values())


def test_capsules_are_never_farther_apart_than_geoms() -> None:
    from robot_retarget.collision.approach import REST, CapsulePairs

    robot = load_robot("op3")
    capsules, pairs = fit_capsules(robot), collidable(robot)
    qpos = wander(robot, 12).qpos
    ends = Marks(robot, capsules.points).along(qpos)
    found = CapsulePairs(capsules, pairs).approach(ends, np.zeros_like(ends), REST)
    assert (found.distance <= Clearance(robot, pairs).all(qpos, 10.0) + 1e-6).all()


@needs_shared
@pytest.mark.parametrize("name", ROBOTS[:4])
def test_pairs_watched_are_all_that_mujoco_lets_touch(name: str) -> None:
    robot = robot_named(name)
    model, data, draw = robot.model, mujoco.MjData(robot.model), np.random.default_rng(5)
    watched = {tuple(pair) for pair in collidable(robot).links.tolist()}
    built = built_in(robot)
    data.qpos[:] = robot.neutral()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    built |= {tuple(sorted(model.geom_bodyid[pair].tolist())) for pair in data.contact.geom}
    for _ in range(150):
        data.qpos[robot.qpos_index] = draw.uniform(robot.lower, robot.upper)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        bodies = np.sort(model.geom_bodyid[data.contact.geom[data.contact.dist < 0]], axis=1)
        touching = {(int(a), int(b)) for a, b in bodies if a > 0} - built
        assert {tuple(sorted(model.body_weldid[list(pair)].tolist())) for pair in touching} <= watched
