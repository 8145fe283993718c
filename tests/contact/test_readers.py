"""Every reader of contacts has the same answer, frame by frame: description, score, verdict, and joins of trajectories."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.actuators.goals import Goals
from robot_retarget.base.files import SAMPLES
from robot_retarget.contact.rule import without_flicker
from robot_retarget.contact.soles import contacts_of
from robot_retarget.contact.stance import planned_stance
from robot_retarget.edit.seam import Stances
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.human.robot_performer import performed
from robot_retarget.judge.feedback import planned_air
from robot_retarget.robot import world_points
from robot_retarget.scores.likeness import likeness_of
from robot_retarget.scores.pair import Pair
from robot_retarget.scores.score import subject_of
from robot_retarget.solver.balance.footsteps import planted_feet
from robot_retarget.tools.view.web.show import Packer, _stance

CLIPS = [
    *(str(SAMPLES / f"{clip}.bvh") for clip in ("clap", "hips_and_bow", "squat", "walk", "wave")),
    *(
        str(SHARED / "motions/bvh" / clip)
        for clip in (
            "lafan1_procedural/walk_procedural.bvh",
            "fair1_zup/jumping.bvh",
            "fair1_zup/dab.bvh",
            "cmu_cgspeed_motionbuilder/05_06_dance.bvh",
            "mixamo/test_freebvh_walk.bvh",
        )
    ),
]
ROBOTS = ("op3", "g1_class", "toddler_class")


@cache
def robot_of(name: str) -> rr.Robot:
    return rr.load_robot(name)


def drifting(robot: rr.Robot, graph: rr.RobotGraph, seed: int) -> rr.Trajectory:
    """A robot that stands, lifts off and slides along the floor: readers need no solved clip."""
    draw = np.random.default_rng(seed)
    qpos = np.tile(robot.standing(), (len(graph), 1))
    qpos[:, robot.root_address : robot.root_address + 2] += np.cumsum(draw.normal(0, 0.003, (len(qpos), 2)), axis=0)
    qpos[:, robot.root_address + 2] += 0.03 * np.abs(np.sin(np.arange(len(qpos)) / 7))
    start = graph.motion.source_time
    return rr.Trajectory(qpos, graph.fps, robot.joint_names, robot.name, source_time=start)


@needs_shared
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("clip", CLIPS, ids=[Path(clip).stem for clip in CLIPS])
def test_all_readers_agree_frame_by_frame(clip: str, name: str) -> None:
    """Exported labels, score, likeness, balance, splicing, verdict and viewer, of the robot's feet and the human's."""
    robot, motion = robot_of(name), rr.read_motion(clip)
    motion = motion.frames(0, min(len(motion), round(4 * motion.fps)))
    graph = rr.describe(motion, robot)
    trajectory = drifting(robot, graph, seed=len(clip))
    own, human, sides = contacts_of(trajectory, robot), graph.human.contacts, ("left_foot", "right_foot")
    assert 0.1 < own.down.mean() < 0.9 and (own.planted <= own.down).all() and (human.planted <= human.down).all()

    subject, _ = subject_of(trajectory, robot, motion)
    likeness = likeness_of(graph.human, robot, trajectory.qpos)
    spliced = Stances(performed(trajectory, robot))
    stance = planned_stance(robot, trajectory)
    assert stance is not None
    shown = np.zeros_like(own.down)
    for foot, stretches in enumerate(_stance(stance, Packer())["schedule"]):
        for first, last in stretches:
            shown[first : last + 1, foot] = True
    goals = Goals(trajectory.qpos[:, robot.qpos_index], trajectory.fps)
    down = {
        "score": subject.contacts.down,
        "likeness": likeness.feet.down,
        "splicing": spliced.down,
        "verdict": stance.touching,
        "feedback": planned_air(robot, trajectory, goals) == 0,
        "viewer": shown,
    }
    assert [reader for reader, found in down.items() if not np.array_equal(found, own.down)] == []
    labels = RobotMotion(trajectory, robot, robot.joint_names).foot_contacts
    stands = {"labels": np.stack([labels[side] for side in sides], axis=1), "likeness": likeness.feet.planted}
    assert [reader for reader, found in stands.items() if not np.array_equal(found, own.planted)] == []
    corners = np.zeros((len(graph), 2, 4, 3))
    planted = planted_feet(human, own, corners, graph.fps)
    both = without_flicker(human.planted | own.planted, graph.fps)
    assert np.array_equal(planted[both.any(axis=1)], both[both.any(axis=1)]) and planted.any(axis=1).all()

    assert subject.pair.contacts is not None and np.array_equal(subject.pair.contacts.stands, human.stands)
    assert len(likeness.human.steps) <= len(human.swings) and likeness.robot.steps == tuple(own.swings)
    places = world_points(robot, graph.match.points, trajectory.qpos)
    seen = Pair(graph.match, graph.human.positions, places, human, graph.fps).touches
    for kind in ("human", "kept"):  # a score has captured frames where a graph interpolates
        assert (getattr(seen, kind) != getattr(subject.pair.touches, kind)).mean() < 0.003
    assert likeness.contacts == seen.share


def test_a_sole_that_slides_within_the_thickness_of_the_floor_is_not_in_the_air() -> None:
    robot = robot_of("op3")
    qpos = np.tile(robot.standing(), (30, 1))
    qpos[:, robot.root_address] += np.linspace(0, 0.5, 30)
    qpos[15:, robot.root_address + 2] += 0.004
    found = contacts_of(rr.Trajectory(qpos, 30.0, robot.joint_names, robot.name), robot)
    assert found.down.all() and not found.flying.any() and not found.stands.any()
    qpos[15:, robot.root_address + 2] += 0.02
    found = contacts_of(rr.Trajectory(qpos, 30.0, robot.joint_names, robot.name), robot)
    assert np.array_equal(found.flying, np.arange(30) >= 15)


def test_a_step_of_the_human_is_lost_where_the_same_foot_of_the_robot_stays_down() -> None:
    """However many steps the other foot takes at another time."""
    graph, robot = rr.describe(str(SAMPLES / "walk.bvh"), robot_of("op3")), robot_of("op3")
    still = likeness_of(graph.human, robot, np.tile(robot.standing(), (len(graph), 1)))
    steps = still.human.steps
    assert len(steps) == 8 and still.steps_lost == 1.0
    down = np.ones_like(still.feet.down)
    for taken, (foot, start, stop) in enumerate(steps, 1):
        down[(start + stop) // 2, "lr".index(foot)] = False
        assert replace(still, feet=replace(still.feet, down=down)).steps_lost == pytest.approx(1 - taken / 8)
