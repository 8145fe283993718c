"""A graph solved for the robot's joints: one frame, a whole clip, or frame by frame."""

from robot_retarget.stage import make_callable

make_callable(__name__)
