"""Retarget a shipped clip to the OP3-class robot, simulate it, and save the trajectory."""

from pathlib import Path
from tempfile import mkdtemp

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES

motion = rr.read_motion(SAMPLES / "wave.bvh").frames(0, 40)
robot = rr.load_robot("op3")
result = rr.retarget(motion, robot)
report = rr.simulate(result, draws=3)

out = Path(mkdtemp()) / "wave.npz"
result.trajectory.save(out)
print(result.likeness.sentence)
print(f"{report.badge.text}: {out}")
