"""Judge the motion of another tool: read its file, search it for self-collisions, simulate it."""

from pathlib import Path
from tempfile import mkdtemp

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.collision import warnings_of

robot = rr.load_robot("op3")
path = Path(mkdtemp()) / "theirs.pkl"
made = rr.retarget(rr.read_motion(SAMPLES / "hips_and_bow.bvh").frames(0, 40), robot, balance="off").trajectory
rr.export(made, robot, "gmr", path)  # stands for a file of GMR

trajectory = rr.load_trajectory(path, robot)
warnings = warnings_of(trajectory, robot)
report = rr.simulate(trajectory, robot)
print(f"{len(trajectory)} frames, {int(warnings.flagged.any(axis=1).sum())} with a warning, verdict {report.verdict}")
