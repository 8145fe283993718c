"""Format `mjlab`: what mjlab's `csv_to_npz.py` makes.

Joints and bodies **depth first**, as MuJoCo has them; `body_lin_vel_w` is that of the bodies' frames. Root and joint
velocities by central differences over two frames, bodies moved by them. mjlab does not read `fps`: it plays a frame a step.
"""

from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.npz.tracking import DEPTH_FIRST, tracking_format

FORMAT: TrajectoryFormat = tracking_format(
    "mjlab", "joints and bodies depth first, with velocities", "mjlab (tracking tasks)", DEPTH_FIRST, mass=False
)
