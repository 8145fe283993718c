"""The table of formats: those of the modules here, in the order of `formats.toml`; a new format is a row there and `declared` in a module."""

from robot_retarget.formats import (
    archives,
    bag,
    joint_trajectory,
    keyframe_kit,
    lerobot,
    mujoco_files,
    named_csv,
    omniretarget,
    pickles,
    rows,
    servo_files,
    skeleton,
    sonic,
    tracking,
)
from robot_retarget.formats.source import ROWS, TrajectoryFormat

_MODULES = (
    *(archives, bag, joint_trajectory, keyframe_kit, lerobot, mujoco_files, named_csv, omniretarget),
    *(pickles, rows, servo_files, skeleton, sonic, tracking),
)
_FOUND = {one.name: one for module in _MODULES for one in vars(module).values() if isinstance(one, TrajectoryFormat)}
FORMATS: dict[str, TrajectoryFormat] = {name: _FOUND[name] for name in ROWS}
