"""A touch-up moves the named keypoints at the named frames only; equal edits give equal bytes on every machine."""

import math
from pathlib import Path

import numpy as np
import pytest
from forked import run
from scipy.spatial.transform import Rotation
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.errors import GraphError, UsageError
from robot_retarget.edit.touchup import Session, apply_edit, graph_of
from robot_retarget.edit.window import AROUND
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.edits import Edit
from robot_retarget.robot import load_robot, world_points
from robot_retarget.trajectory import Trajectory, load_trajectory

OP3 = load_robot("op3")
WAVE = ROOT / "samples/wave.bvh"
MOTION = rr.read_motion(WAVE).frames(0, 75)
CLIP = ("--frames", "0:75", "--robot", "op3")
HANDS = Edit("edge", {"a": "l_hand", "b": "r_hand", "at": [0.0, 0.1], "frames": [30, 39]})


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> tuple[RobotGraph, Trajectory]:
    """As the command line has it: through a file."""
    path = tmp_path_factory.mktemp("solved") / "wave.npz"
    command("solve", WAVE, *CLIP, "--balance", "off", "-o", path)
    trajectory = load_trajectory(path)
    return graph_of(MOTION, OP3, trajectory), trajectory


def command(*words: str | Path) -> None:
    done = run(*words)
    assert done.returncode == 0, done.stderr


def apart(graph: RobotGraph, trajectory: Trajectory, a: str, b: str) -> np.ndarray:
    """(T,) between two keypoints, by forward kinematics [m]."""
    points = world_points(OP3, graph.match.points, trajectory.qpos)
    return np.linalg.norm(points[:, graph.match.index(a)] - points[:, graph.match.index(b)], axis=1)


def test_two_points_come_as_near_as_is_said_and_the_rest_stays(solved: tuple[RobotGraph, Trajectory]) -> None:
    graph, trajectory = solved
    done = apply_edit(graph, trajectory, HANDS)
    held = slice(34, 38)  # the joints need an eighth of a second to come together and to part
    assert apart(graph, trajectory, "l_hand", "r_hand")[held].min() > 0.15
    assert apart(graph, done.trajectory, "l_hand", "r_hand")[held].max() < 0.13
    outside = np.r_[0 : done.first, done.last + 1 : len(graph)]
    np.testing.assert_array_equal(done.trajectory.qpos[outside], trajectory.qpos[outside])
    assert done.first == 30 - round(AROUND * graph.fps)


def test_a_hard_edge_holds_from_its_first_frame_to_its_last(solved: tuple[RobotGraph, Trajectory]) -> None:
    table = {"a": "l_hand", "b": "head", "at": 0.12, "frames": [30, 45], "hard": True}
    done = apply_edit(*solved, Edit("edge", table))
    assert np.abs(apart(solved[0], done.trajectory, "l_hand", "head")[30:46] - 0.12).max() < 1e-3
    assert not done.unmet


def test_a_touch_up_keeps_ranges_and_speeds_and_comes_without_a_jerk(solved: tuple[RobotGraph, Trajectory]) -> None:
    graph, trajectory = solved
    hinges = apply_edit(graph, trajectory, HANDS).trajectory.qpos[:, OP3.qpos_index]
    assert (hinges >= OP3.lower - 1e-6).all() and (hinges <= OP3.upper + 1e-6).all()
    assert (np.abs(np.diff(hinges, axis=0)) * graph.fps <= OP3.max_speed * 1.05).all()


def test_a_session_gives_the_bytes_of_the_command_line(solved: tuple[RobotGraph, Trajectory], tmp_path: Path) -> None:
    session = Session(*solved, tmp_path / "EDITS.toml", tmp_path / "EDITS.npz")
    session.make(HANDS.values)
    session.make({"a": "r_hand", "b": [0.13, -0.1, 0.3], "at": 0, "frames": [60, 66], "hard": True})
    session.make({"a": "l_hand", "b": "head", "at": [0.3, math.inf], "frames": [50, 60]})
    edits, mended_file = session.save()
    solved[1].save(tmp_path / "wave.npz")
    given = "--motion", WAVE, "--edges", edits
    command("edit", "mend", tmp_path / "wave.npz", *CLIP, *given, "-o", tmp_path / "again.npz")
    np.testing.assert_array_equal(load_trajectory(tmp_path / "again.npz").qpos, load_trajectory(mended_file).qpos)
    assert (tmp_path / "again.npz").read_bytes() == mended_file.read_bytes()


def test_undo_and_redo_go_back_and_on_to_the_same_trajectory(
    solved: tuple[RobotGraph, Trajectory], tmp_path: Path
) -> None:
    session = Session(*solved, tmp_path / "E.toml", tmp_path / "E.npz")
    with pytest.raises(UsageError, match="nothing to undo"):
        session.undo()
    session.make(HANDS.values)
    there = session.trajectory
    session.undo()
    assert session.trajectory is solved[1] and not session.edits
    session.redo()
    assert session.trajectory is there and len(session.edits) == 1
    with pytest.raises(UsageError, match="nothing to do again"):
        session.redo()


def test_ends_and_times_beyond_the_clip_are_refused(solved: tuple[RobotGraph, Trajectory]) -> None:
    for edit, said in (
        (Edit("edge", {"a": "l_hand", "b": "tail", "at": 0}), "no keypoint 'tail'"),
        (Edit("edge", {**HANDS.values, "frames": [90, 99]}), "not within"),
    ):
        with pytest.raises(GraphError, match=said):
            apply_edit(*solved, edit)


def test_an_edge_in_place_of_the_latest_leaves_as_many_and_starts_where_that_one_did(
    solved: tuple[RobotGraph, Trajectory], tmp_path: Path
) -> None:
    session = Session(*solved, tmp_path / "E.toml", tmp_path / "E.npz")
    session.make(HANDS.values)
    there = session.trajectory
    session.make(HANDS.values, instead=True)
    assert len(session.edits) == 1 and session.before is solved[1]
    np.testing.assert_array_equal(session.trajectory.qpos, there.qpos)
    with pytest.raises(GraphError):
        session.make({"a": "l_hand", "b": "tail", "at": 0}, instead=True)
    assert len(session.edits) == 1


@pytest.mark.parametrize(
    ("at", "asked"),
    [(0, "touch"), (0.07, "exactly 7 cm"), ([0.3, math.inf], "at least 30 cm"), ([0, 0.09], "at most 9 cm")],
)
def test_what_was_asked_for_is_said_in_the_words_of_the_form(
    at: object, asked: str, solved: tuple[RobotGraph, Trajectory]
) -> None:
    form = (ROOT / "robot_retarget/tools/view/web/assets/touch.js").read_text()
    assert asked.split(" ")[0] in form and " ".join(asked.split(" ")[:2]).rstrip("0123456789 ") in form
    done = apply_edit(*solved, Edit("edge", {**HANDS.values, "at": at}))
    assert f"interval: {asked}" in done.reached


def test_an_edge_out_of_reach_names_the_joints_that_stop_it(solved: tuple[RobotGraph, Trajectory]) -> None:
    graph, trajectory = solved
    feet = world_points(OP3, graph.match.points, trajectory.qpos)[33, graph.match.index("l_ankle")]
    for end, way in (("l_ankle", [0.15, 0.0, 0.45]), ("l_hand", [0.0, 0.6, 0.5])):
        far = {"a": end, "b": [round(float(v), 3) for v in np.add(feet, way)], "at": 0, "frames": [30, 36]}
        done = apply_edit(graph, trajectory, Edit("edge", {**far, "priority": 1e4}))
        stopped = any(f"{joint} is at its" in done.reached for joint in OP3.joint_names)
        assert stopped or "at its extremum" in done.reached, done.reached
        assert "solve --edges" in done.reached


@pytest.mark.parametrize("name", ["op3", "g1_class", "toddler_class"])
def test_a_hand_or_foot_that_is_dragged_moves_without_the_trunk_and_comes_near_or_says_what_holds_it(name: str) -> None:
    robot, motion = load_robot(name), MOTION.frames(0, 32)
    stand = np.tile(robot.standing(), (32, 1))
    trajectory = Trajectory(stand, 30.0, robot.joint_names, name, "wave.bvh", source_time=motion.source_time)
    graph = graph_of(motion, robot, trajectory)
    points = world_points(robot, graph.match.points, stand[:1])[0]
    for end, way in (("l_hand", [0.06, -0.12, 0.06]), ("r_ankle", [0.05, 0.0, 0.12])):
        place = (points[graph.match.index(end)] + way).tolist()
        table = {"a": end, "b": place, "at": 0, "frames": [12, 19], "hard": True}
        done = apply_edit(graph, trajectory, Edit("edge", table))
        turned = Rotation.from_quat(done.trajectory.qpos[:, 3:7], scalar_first=True).magnitude()
        assert np.degrees(np.abs(turned - turned[0])).max() < 1, end
        places = world_points(robot, graph.match.points, done.trajectory.qpos[12:20])[:, graph.match.index(end)]
        away = np.linalg.norm(places - place, axis=1).max()
        assert away < 0.5 * np.linalg.norm(way), end
        assert away < 0.01 or "at its joint range" in done.reached or "at their separation" in done.reached, (
            done.reached
        )
