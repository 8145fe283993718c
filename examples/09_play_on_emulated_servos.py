"""Play a trajectory on emulated Dynamixel servos: the same bytes as on a real bus."""

import robot_retarget as rr
from robot_retarget.actuators.map import load_map
from robot_retarget.base.files import SAMPLES
from robot_retarget.servo.play import play_emulated

robot = rr.load_robot("op3")
motion = rr.read_motion(SAMPLES / "wave.bvh").frames(0, 30)
trajectory = rr.retarget(motion, robot).trajectory

outcome = play_emulated(trajectory, load_map("op3"), physics=False, lockstep=True)
print(f"{outcome.ended.name}: {outcome.reason}")
