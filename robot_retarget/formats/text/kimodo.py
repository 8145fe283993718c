"""Format `kimodo`: rows as Kimodo writes for the G1.

No header, 30 frames per second; root x y z [m], quaternion **w x y z**: the shape of Unitree's rows, in another order, then the hinges in the model's order [rad].
"""

from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.text.rows import rows_format

FORMAT: TrajectoryFormat = rows_format(
    "kimodo", "Kimodo G1 rows without a header: xyz, quaternion wxyz, joints", "Kimodo's tools", "wxyz"
)
