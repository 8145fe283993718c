"""A robot, and the bodies around it, where the latest pose has them, for a page that is served."""

import json
from collections.abc import Mapping
from threading import Condition
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.human.surroundings import first_frame
from robot_retarget.robot.model import Robot
from robot_retarget.scene.scene import Scene
from robot_retarget.tools.view.web.page import Viewer
from robot_retarget.tools.view.web.shapes import shapes_of, shapes_of_scene
from robot_retarget.tools.view.web.show import SCALAR_LAST, poses, seen
from robot_retarget.tools.view.web.take import Take
from robot_retarget.trajectory import Trajectory


class LiveRobot:
    """The latest pose, shared with waiting pages. Older poses are dropped."""

    def __init__(self, robot: Robot, scene: Scene | None = None) -> None:
        self._robot, self._shapes = robot, shapes_of(robot)
        around = None if scene is None else first_frame(scene)
        drawn = () if around is None else seen(shapes_of_scene(around))
        self._names = [around.names[body] for body in drawn] if around is not None else []
        self._count, self._pose = 0, b""
        self._changed = Condition()
        still = Trajectory(robot.standing()[None], 1.0, robot.joint_names, robot.name, source="live", scene=around)
        self.viewer: Viewer = Viewer((Take(robot, still),))

    def show(self, qpos: Floats, bodies: Mapping[str, Floats] | None = None, size: float = 1.0) -> None:
        """The robot stands so now (nq,), and the bodies around it, `size` times as large as captured, have these poses (7,)."""
        rows: dict[str, Any] = {"robot": np.round(poses(self._robot, qpos[None], self._shapes), 4).ravel().tolist()}
        if bodies:
            around = np.array([bodies[name] for name in self._names]).reshape(-1, 7)[:, SCALAR_LAST]
            rows |= {"bodies": np.round(around, 4).ravel().tolist(), "size": size}
        with self._changed:
            self._count, self._pose = self._count + 1, json.dumps(rows).encode()
            self._changed.notify_all()

    def next(self, seen: int, timeout: float) -> tuple[int, bytes] | None:
        """The latest pose as the page takes it, and its number, once that is not the one seen last."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._count != seen, timeout):
                return None
            return self._count, self._pose
