"""Format `beyondmimic`: what whole_body_tracking's `csv_to_npz.py` makes in Isaac Lab.

Joints and bodies **breadth first**; `body_lin_vel_w` is that of the bodies' centres of mass, as Isaac Lab has it. Root and
joint velocities by central differences over two frames, bodies moved by them.
"""

from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.npz.tracking import BREADTH_FIRST, tracking_format

FORMAT: TrajectoryFormat = tracking_format(
    "beyondmimic",
    "joints and bodies breadth first, with velocities",
    "whole_body_tracking (BeyondMimic)",
    BREADTH_FIRST,
    mass=True,
)
