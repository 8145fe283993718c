"""Poses on a page in the browser."""

from robot_retarget.live.loop import LivePose
from robot_retarget.robot import Robot
from robot_retarget.scene.scene import Scene
from robot_retarget.tools.view.web.live import LiveRobot
from robot_retarget.tools.view.web.serve import PORT, Served, serve


class PageSink:
    """A page that follows; `served` says where.

    Raises:
        UsageError: its port is taken.
    """

    def __init__(self, robot: Robot, port: int = PORT, scene: Scene | None = None) -> None:
        self._robot = LiveRobot(robot, scene)
        self.served: Served = serve(self._robot.viewer, port, following=self._robot)

    def show(self, pose: LivePose) -> None:
        self._robot.show(pose.qpos, pose.bodies, pose.size)
