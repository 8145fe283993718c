"""Contact labels: every export with a place for them says which soles stand; the oracle is MuJoCo's kinematics."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from format_moves import robot_called

from robot_retarget.base.arrays import Bools
from robot_retarget.base.untrusted.pickles import load_pickle
from robot_retarget.formats import FORMATS, export, import_motion
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.robot import load_robot
from robot_retarget.trajectory import Trajectory


@pytest.fixture(scope="module")
def hop() -> Trajectory:
    """The OP3 stands for a second, is 5 cm up for a second, and stands again."""
    robot = robot_called("op3")
    qpos = np.tile(robot.standing(), (150, 1))
    qpos[50:100, 2] += 0.05
    return Trajectory(qpos, 50.0, robot.joint_names, robot.name, "hop")


def low(moved: Trajectory) -> Bools:
    """(T,) whether the model's lowest point is where it is in the first frame, by MuJoCo."""
    model = robot_called("op3").model
    data, heights = mujoco.MjData(model), []
    for qpos in moved.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        heights.append(data.geom_xpos[:, 2].min())
    return np.array(heights) < heights[0] + 0.01


def written(moved: Trajectory, format: str, path: Path) -> tuple[Bools, Trajectory]:
    """(T, 2) labels of left and right foot in a file, and the motion that is read from it."""
    robot = robot_called("op3")
    export(moved, robot, format, path)
    match format:
        case "core":
            labels = np.load(path)["contact_labels"][:, :2]
        case "mjlab" | "beyondmimic":
            assert np.load(path)["foot_names"].tolist() == ["left_foot", "right_foot"]
            labels = np.load(path)["foot_contacts"]
        case "csv":
            labels = np.genfromtxt(path, delimiter=",", skip_header=1)[:, -2:] > 0
        case "phc":
            labels = next(iter(load_pickle(path).values()))["contact_mask"] > 0
        case _:
            bodies = load_pickle(path)["rigid_body_contacts"]
            labels = bodies[:, bodies.any(axis=0)]
    return np.asarray(labels), import_motion(path, robot, format)


@pytest.mark.parametrize("format", ["core", "mjlab", "beyondmimic", "csv", "phc", "protomotions"])
def test_labels_say_where_a_sole_is_on_the_ground_and_still(hop: Trajectory, format: str, tmp_path: Path) -> None:
    labels, read_back = written(hop, format, tmp_path / f"a{FORMATS[format].suffix}")
    assert labels.shape == (150, 2) and (labels[:, 0] == labels[:, 1]).all()
    truth = low(hop)
    off = np.flatnonzero(labels[:, 0] != truth)
    assert set(off) <= {48, 49, 50, 99, 100, 101}, "only frames in which the robot leaves or meets the ground differ"
    np.testing.assert_allclose(read_back.qpos, hop.qpos, atol=1e-6)


def test_a_flight_is_a_frame_in_which_no_sole_is_on_the_ground_at_any_speed(hop: Trajectory, tmp_path: Path) -> None:
    export(hop, robot_called("op3"), "core", tmp_path / "a.npz")
    found = np.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(found["flight_labels"], ~low(hop))
    starts = found["left_contact_segments"]
    assert starts.shape == (2, 2) and starts[0, 0] == 0 and starts[1, 1] == 150


def test_a_robot_without_feet_has_no_labels(tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    model.write_text('<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body></worldbody></mujoco>')
    robot = load_robot(model)
    moved = Trajectory(np.zeros((3, 1)), 30.0, robot.joint_names, robot.name, "a")
    assert RobotMotion(moved, robot, robot.joint_names).foot_contacts == {}
