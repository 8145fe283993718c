"""Add an edge of your own: the left hand stays 20 cm from the head during ten frames."""

import numpy as np

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.robot import world_points

motion = rr.read_motion(SAMPLES / "wave.bvh").frames(0, 40)
robot = rr.load_robot("op3")
graph = rr.describe(motion, robot)
edited = graph.with_edge("l_hand", "head", 0.2, frames=(20, 30), priority=500.0)

distances = {}
for name, one in (("before", graph), ("after", edited)):
    result = rr.solve(one, balance="off")
    points = world_points(robot, result.match.points, result.trajectory.qpos)
    hand, head = (points[:, result.match.keypoints.index(end)] for end in ("l_hand", "head"))
    distances[name] = float(np.linalg.norm(hand - head, axis=1)[20:31].mean())
    print(f"{name}: {distances[name]:.3f} m on average in frames 20 to 30")
