"""Follow a performer frame by frame: every call returns the pose of the robot within about a millisecond."""

import time

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES

motion = rr.read_motion(SAMPLES / "wave.bvh").frames(0, 90)  # stands for a live source
robot = rr.load_robot("op3")

start = time.perf_counter()
poses = list(rr.stream(robot, motion))
rate = len(poses) / (time.perf_counter() - start)
print(f"{len(poses)} poses, {rate:.0f} frames/s with the set-up of the problem")
