"""Format `unitree`: rows as in Unitree's retargeted LAFAN1.

No header, 30 frames per second; root x y z [m], quaternion **x y z w**, then the hinges in the model's order [rad].
"""

from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.text.rows import rows_format

FORMAT: TrajectoryFormat = rows_format(
    "unitree",
    "Unitree LAFAN1 rows without a header: xyz, quaternion xyzw, joints",
    "mjlab and whole_body_tracking (csv_to_npz), unitree_rl_lab",
    "xyzw",
)
