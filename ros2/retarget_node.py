"""ROS 2 node: a humanoid follows a performer or a motion file, as joint states and a trajectory command for each limb.

    python ros2/retarget_node.py --ros-args -p robot:=op3 -p source:=vmc -p host:=0.0.0.0

Published for every frame of the source, and 60 times a second while none arrives:

    joint_states            sensor_msgs/JointState            every hinge [rad]
    root_pose               geometry_msgs/PoseStamped         the root in `world` [m], quaternion x y z w
    LIMB/joint_trajectory   trajectory_msgs/JointTrajectory   one point: the limb's joints [rad], due `ahead` after now [s]

LIMB is left_arm, right_arm, left_leg, right_leg, head or torso, those that the robot has.
"""

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import robot_retarget as rr
from robot_retarget.live.loop import LivePose, Loop
from robot_retarget.live.sources import opened
from robot_retarget.robot import recognise
from robot_retarget.robot.anatomy import joints_by_limb

PARAMETERS = {"robot": "op3", "servos": "", "source": "vmc", "port": 0, "host": "127.0.0.1", "sender": "", "ahead": 0.0}
"""Defaults; `port` 0 is the protocol's own, `ahead` is the time in which a controller reaches a point [s]."""


class RetargetNode(Node):
    """Publishes the poses of a stream."""

    def __init__(self) -> None:
        super().__init__("retarget")
        said = {name: self.declare_parameter(name, value).value for name, value in PARAMETERS.items()}
        self.robot = rr.load_robot(said["robot"], servos=said["servos"] or None)
        self.source = opened(
            said["source"], said["port"] or None, said["host"], sender=said["sender"], say=self.get_logger().info
        )
        self._ahead = Duration(seconds=said["ahead"]).to_msg()
        self._states = self.create_publisher(JointState, "joint_states", 10)
        self._root = self.create_publisher(PoseStamped, "root_pose", 10)
        self._limbs = {
            self.create_publisher(JointTrajectory, f"{limb}/joint_trajectory", 10): joints
            for limb, joints in joints_by_limb(self.robot, recognise(self.robot)).items()
        }

    def run(self) -> None:
        """Follow the source until it ends."""
        Loop(self.source, lambda skeleton: rr.Stream(self.robot, skeleton), self, self.get_logger().info).run()

    def show(self, pose: LivePose) -> None:
        """Publish a pose."""
        stamp = self.get_clock().now().to_msg()
        angles = dict(zip(self.robot.joint_names, pose.qpos[self.robot.qpos_index].tolist(), strict=True))
        states = JointState(name=list(angles), position=list(angles.values()))
        states.header.stamp = stamp
        self._states.publish(states)
        for publisher, joints in self._limbs.items():
            point = JointTrajectoryPoint(positions=[angles[joint] for joint in joints], time_from_start=self._ahead)
            publisher.publish(JointTrajectory(joint_names=list(joints), points=[point]))
        if self.robot.floating:
            self._root.publish(self._root_pose(pose.qpos[self.robot.root_address :][:7].tolist(), stamp))

    @staticmethod
    def _root_pose(root: list[float], stamp: object) -> PoseStamped:
        message = PoseStamped()
        message.header.frame_id, message.header.stamp = "world", stamp
        place, turn = message.pose.position, message.pose.orientation
        place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z = root
        return message


def main() -> None:
    """Run until the source ends or Ctrl-C."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = RetargetNode()
    except rr.RobotRetargetError as error:
        raise SystemExit(f"retarget: {error}") from None
    try:
        node.run()
    except KeyboardInterrupt:
        pass
    finally:
        node.source.close()
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
