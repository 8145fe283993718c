"""Write reference motion for a trainer, and read it back as a trajectory."""

from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES

robot = rr.load_robot("op3")
motion = rr.read_motion(SAMPLES / "walk.bvh").frames(0, 40)
trajectory = rr.retarget(motion, robot, balance="off").trajectory

path = Path(mkdtemp()) / "walk.npz"
rr.export(trajectory, robot, "mjlab", path)
again = rr.load_trajectory(path, robot)
with np.load(path) as file:
    print({key: file[key].shape for key in file.files})
print(f"{len(trajectory)} frames at {trajectory.fps:g}/s became {len(again)} at {again.fps:g}/s")
