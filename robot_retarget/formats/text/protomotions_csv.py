"""Format `protomotions-csv`: rows that ProtoMotions converts to its `.motion`.

No header, 30 frames per second; root x y z [m], quaternion **w x y z**, then the hinges in the model's order [rad].
"""

from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.text.rows import rows_format

FORMAT: TrajectoryFormat = rows_format(
    "protomotions-csv",
    "ProtoMotions rows without a header: xyz, quaternion wxyz, joints",
    "ProtoMotions (data/scripts, csv to motion)",
    "wxyz",
)
