"""The ROS 2 node publishes what a subscriber of ROS 2 itself understands."""

# ROS 2 is not among the packages of the tests: the cases skip without it.
# pyright: reportMissingImports=false

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from robot_retarget.base.files import SAMPLES
from robot_retarget.robot import load_robot

rclpy = pytest.importorskip("rclpy", reason="rclpy is not installed")
NODE = Path(__file__).parents[2] / "ros2/retarget_node.py"
LIMBS = ("left_arm", "right_arm", "left_leg", "right_leg", "head")


def test_states_root_and_limbs_are_one_pose_within_every_range() -> None:
    from geometry_msgs.msg import PoseStamped
    from sensor_msgs.msg import JointState
    from trajectory_msgs.msg import JointTrajectory

    states, roots, limbs = [], [], {limb: [] for limb in LIMBS}
    rclpy.init()
    node = rclpy.create_node("listener")
    node.create_subscription(JointState, "joint_states", states.append, 10)
    node.create_subscription(PoseStamped, "root_pose", roots.append, 10)
    for limb, heard in limbs.items():
        node.create_subscription(JointTrajectory, f"{limb}/joint_trajectory", heard.append, 10)
    told = ["-p", "robot:=op3", "-p", f"source:={SAMPLES / 'wave.bvh'}", "-p", "ahead:=0.02"]
    process = subprocess.Popen([sys.executable, str(NODE), "--ros-args", *told])
    try:
        until = time.monotonic() + 60
        while process.poll() is None and time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.1)
    finally:
        process.kill()
        node.destroy_node()
        rclpy.shutdown()
    robot = load_robot("op3")
    angles = np.array([state.position for state in states])
    assert len(states) > 30 and list(states[0].name) == list(robot.joint_names)
    assert (
        (angles >= robot.lower - 1e-6).all()
        and (angles <= robot.upper + 1e-6).all()
        and np.ptp(angles, axis=0).max() > 0.5
    )
    named = [name for heard in limbs.values() for name in heard[0].joint_names]
    assert sorted(named) == sorted(robot.joint_names)
    arm = [list(robot.joint_names).index(name) for name in limbs["left_arm"][-1].joint_names]
    (point,) = limbs["left_arm"][-1].points
    assert list(point.positions) == pytest.approx(angles[-1, arm]) and point.time_from_start.nanosec == 20_000_000
    turn = roots[-1].pose.orientation
    assert roots[-1].header.frame_id == "world" and np.linalg.norm([turn.x, turn.y, turn.z, turn.w]) == pytest.approx(1)
