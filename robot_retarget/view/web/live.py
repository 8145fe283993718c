"""A robot that stands where the latest pose has it, for a page that is served."""

import json
from threading import Condition

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.model import Robot
from robot_retarget.trajectory import Trajectory
from robot_retarget.view.web.page import Viewer
from robot_retarget.view.web.shapes import shapes_of
from robot_retarget.view.web.show import poses
from robot_retarget.view.web.take import Take


class LiveRobot:
    """The latest pose, shared with waiting pages. Older poses are dropped."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._shapes = robot, shapes_of(robot)
        self._count, self._pose = 0, b""
        self._changed = Condition()
        still = Trajectory(robot.standing()[None], 1.0, robot.joint_names, robot.name, source="live")
        self.viewer: Viewer = Viewer((Take(robot, still),))

    def show(self, qpos: Floats) -> None:
        """The robot stands so now (nq,)."""
        rows = np.round(poses(self._robot, qpos[None], self._shapes), 4)
        with self._changed:
            self._count, self._pose = self._count + 1, json.dumps(rows.ravel().tolist()).encode()
            self._changed.notify_all()

    def next(self, seen: int, timeout: float) -> tuple[int, bytes] | None:
        """The latest pose as the page takes it, and its number, once that is not the one seen last."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._count != seen, timeout):
                return None
            return self._count, self._pose
