"""Every reader of contacts has the same answer, frame by frame: description, score, verdict, and joins of trajectories."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.contact.soles import sole_contacts
from robot_retarget.edit.seam import Stances
from robot_retarget.human.robot_performer import performed
from robot_retarget.robot import recognise, world_points
from robot_retarget.scores.likeness import likeness_of
from robot_retarget.scores.pair import Pair
from robot_retarget.scores.score import score, subject_of

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
    robot, motion = robot_of(name), rr.read_motion(clip)
    motion = motion.frames(0, min(len(motion), round(4 * motion.fps)))
    graph = rr.describe(motion, robot)
    trajectory = drifting(robot, graph, seed=len(clip))
    subject, _ = subject_of(trajectory, robot, motion)
    for foot, stands in graph.human.contacts.items():
        assert np.array_equal(subject.pair.contacts[foot], stands)
    places = world_points(robot, graph.match.points, trajectory.qpos)
    seen = Pair(graph.match, graph.human.positions, places, graph.human.contacts, graph.fps).touches
    for name in (
        "human",
        "kept",
    ):  # a score has the bones of the compared frames, and captured frames where a graph interpolates
        assert (getattr(seen, name) != getattr(subject.pair.touches, name)).mean() < 0.003
    assert likeness_of(graph.human, graph.robot, trajectory.qpos).contacts == seen.share
    scored = score(trajectory, robot, motion)
    assert scored.figures["contact_recall"] == (
        None if (share := subject.pair.touches.share) is None else round(share, 3)
    )
    own = sole_contacts(robot, recognise(robot), trajectory.qpos, trajectory.fps)
    assert np.array_equal(subject.on_floor, own.down)
    assert np.array_equal(~subject.standing, own.flying)
    assert scored.figures["flight_pct"] == pytest.approx(100 * own.flying.mean(), abs=0.01)
    assert np.array_equal(Stances(performed(trajectory, robot)).down, own.down)


def test_a_sole_that_slides_within_the_thickness_of_the_floor_is_not_in_the_air() -> None:
    robot = robot_of("op3")
    qpos = np.tile(robot.standing(), (30, 1))
    qpos[:, robot.root_address] += np.linspace(0, 0.5, 30)
    qpos[15:, robot.root_address + 2] += 0.004
    found = sole_contacts(robot, recognise(robot), qpos, 30.0)
    assert found.down.all() and not found.flying.any() and not found.stands.any()
    qpos[15:, robot.root_address + 2] += 0.02
    assert np.array_equal(sole_contacts(robot, recognise(robot), qpos, 30.0).flying, np.arange(30) >= 15)
