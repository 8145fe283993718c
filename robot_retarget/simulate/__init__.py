"""MuJoCo: what becomes of a trajectory on servos."""

from robot_retarget.stage import make_callable

make_callable(__name__)
