"""What is no foot stays over the floor: distances as MuJoCo's own, slopes as they turn out."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.files import SAMPLES
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.distances import FLOOR_SHARE, Separation
from robot_retarget.robot.geoms import FLOOR_GEOM, Placed, joined, solid_geoms
from robot_retarget.robot.kinematics import integrate
from robot_retarget.robot.links import Links
from robot_retarget.solver.pipeline import retarget

REACH = 0.05
NEAR = FLOOR_SHARE * REACH


def fallen(robot: Robot, seed: int) -> np.ndarray:
    """A pose that lies somehow about the floor."""
    draw = np.random.default_rng(seed)
    q = robot.neutral()
    q[robot.qpos_index] = draw.uniform(robot.lower, robot.upper)
    q[:3] = 0.0, 0.0, 0.05
    q[3:7] = Rotation.from_rotvec(draw.normal(size=3)).as_quat(scalar_first=True)
    return q


def least_of(geoms: np.ndarray, distances: np.ndarray) -> dict[int, float]:
    return {int(g): float(distances[geoms == g].min()) for g in np.unique(geoms)}


def by_mujoco(robot: Robot, qpos: np.ndarray) -> dict[str, float]:
    """How near each geom is to a plane, as MuJoCo finds it, by the geom's name."""
    spec = mujoco.MjSpec.from_file(str(robot.path))
    for k, geom in enumerate(spec.geoms):
        geom.name = f"geom {k}"
        geom.contype = geom.conaffinity = 2 if geom.contype or geom.conaffinity else 0
        geom.margin = NEAR / 2
    kind = mujoco.mjtGeom.mjGEOM_PLANE
    plane = spec.worldbody.add_geom(type=kind, size=[0, 0, 1], contype=2, conaffinity=2, margin=NEAR / 2)
    plane.name = "plane"
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    found: dict[str, float] = {}
    for contact in data.contact:
        names = [model.geom(g).name for g in contact.geom]
        if "plane" in names:
            other = names[names[0] == "plane"]
            found[other] = min(found.get(other, np.inf), contact.dist)
    return found


@pytest.mark.parametrize("seed", range(4))
def test_what_is_near_the_floor_is_as_near_as_mujoco_says(seed: int) -> None:
    robot = load_robot("op3")
    separation = Separation(robot, REACH, feet=frozenset())
    qpos = fallen(robot, seed)
    separation.along(qpos[None])
    assert separation.floor is not None
    near = joined(separation.floor.near(Placed.of(separation.places[0].data)))
    expected = {int(name.split()[1]): distance for name, distance in by_mujoco(robot, qpos).items()}
    here = least_of(near.geoms[:, 1], near.distance)
    assert len(expected) > 2
    assert set(here) == set(expected)
    assert here == pytest.approx(expected, abs=2e-5)
    assert separation.floor_penetration(qpos[None])[0] == pytest.approx(max(0.0, -min(expected.values())), abs=2e-5)


@pytest.mark.parametrize("seed", range(4))
def test_heights_over_the_floor_change_as_their_slopes_say(seed: int) -> None:
    robot = load_robot("op3")
    separation = Separation(robot, REACH, feet=frozenset())
    qpos, step = fallen(robot, seed), 1e-6
    way = np.random.default_rng(seed).normal(size=robot.model.nv)

    def floor_rows(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, slope = separation.along(q[None])
        distance, geoms = found.distance, found.geoms
        low = np.flatnonzero(geoms[:, 0] == FLOOR_GEOM)
        low = low[np.argsort(distance[low])]
        return distance[low], slope[low]

    (before, slope), (after, _) = floor_rows(qpos), floor_rows(integrate(robot, qpos, step * way))
    assert len(before) == len(after) > 2
    assert (after - before) / step == pytest.approx(slope @ way, abs=1e-3)


def test_feet_and_robots_without_a_floor_are_left_alone() -> None:
    robot = load_robot("op3")
    every = frozenset(Links(robot).ids)
    qpos = fallen(robot, 0)
    assert Separation(robot, REACH, feet=frozenset()).floor_penetration(qpos[None]) > 0
    assert Separation(robot, REACH, feet=every).floor_penetration(qpos[None]) == 0
    assert Separation(robot, REACH).floor_penetration(qpos[None]) == 0


def lying(motion: Motion) -> Motion:
    """The motion tipped onto its back, its lowest point on the floor."""
    tipped = motion.positions @ Rotation.from_euler("y", -90, degrees=True).as_matrix().T
    return replace(motion, positions=tipped - [0, 0, tipped[..., 2].min()], rotations=None)


def lowest(robot: Robot, path: np.ndarray) -> float:
    return min(float(links.surface(x)[:, 2].min()) for links in (Links(robot, q) for q in path) for x in links.ids)


def test_who_lies_down_lies_on_the_floor_and_not_in_it() -> None:
    robot, clip = load_robot("op3"), lying(read_motion(SAMPLES / "wave.bvh").resample(10))
    result = retarget(replace(clip, positions=clip.positions[:12]), robot, balance="off")
    assert lowest(robot, result.trajectory.qpos) > -1e-4


def test_who_lies_down_over_planted_feet_keeps_every_other_link_off_the_floor() -> None:
    robot, clip = load_robot("op3"), lying(read_motion(SAMPLES / "wave.bvh").resample(5))
    result = retarget(replace(clip, positions=clip.positions[:2]), robot, legs="stand", balance="static")
    path, feet = result.trajectory.qpos, {int(sole.bodies[0]) for sole in result.graph.match.anatomy.soles.values()}
    links = [geom for link, own in solid_geoms(robot).items() if link not in feet for geom in own]
    near = by_mujoco(robot, path[len(path) // 2])
    assert NEAR > min(near.get(f"geom {geom}", NEAR) for geom in links) > 0.005  # a link on the floor counts as a fall


@needs_shared
def test_a_person_who_gets_up_from_the_floor_does_not_come_out_of_it() -> None:
    robot = load_robot("op3")
    clip = read_motion(SHARED / "motions/bvh/lafan1_procedural/fall_getup_procedural.bvh").resample(10)
    assert lowest(robot, retarget(clip, robot, balance="off").trajectory.qpos) > -1e-3


def only_seen(folder: Path) -> Robot:
    """The OP3 with the same shapes, none of which takes part in contacts."""
    spec = load_robot("op3").spec()
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    path = folder / "seen.xml"
    path.write_text(spec.to_xml())
    return load_robot(path)


def test_what_is_only_seen_stays_over_the_floor(tmp_path: Path) -> None:
    robots = only_seen(tmp_path), load_robot("op3")
    for seed in range(5):
        q = fallen(robots[1], seed)
        seen, solid = (Separation(robot, REACH, feet=frozenset()).floor_penetration(q[None]) for robot in robots)
        assert solid > 0.01 and seen >= solid - 1e-6


def test_links_that_are_only_seen_are_kept_apart(tmp_path: Path) -> None:
    draw, robots = np.random.default_rng(3), (only_seen(tmp_path), load_robot("op3"))
    poses = np.tile(robots[1].neutral(), (40, 1))
    poses[:, robots[1].qpos_index] = draw.uniform(robots[1].lower, robots[1].upper, (40, len(robots[1].lower)))
    seen, solid = (np.array([Separation(robot, REACH).depth(q) for q in poses]) for robot in robots)
    assert solid.max() > 0.005 and (seen >= solid - 1e-6).all()
