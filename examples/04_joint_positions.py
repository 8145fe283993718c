"""Retarget joint positions (T, J, 3) [m] that your own code made, with their names and parents."""

from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES

clip = rr.read_motion(SAMPLES / "squat.bvh").frames(0, 30)  # stands for your own source of positions
path = Path(mkdtemp()) / "positions.npz"
skeleton = clip.skeleton
np.savez(path, positions=clip.positions, names=skeleton.names, parents=skeleton.parents, fps=clip.fps)

motion = rr.read_motion(path)
result = rr.retarget(motion, rr.load_robot("op3"))
print(motion)
print(result)
