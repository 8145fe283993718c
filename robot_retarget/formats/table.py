"""The one table of formats; a new format is a `TrajectoryFormat` in one of the modules here and a name in this table."""

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
from robot_retarget.formats.source import TrajectoryFormat

FORMATS: dict[str, TrajectoryFormat] = {
    each.name: each
    for each in (
        archives.NATIVE,
        named_csv.CSV,
        rows.UNITREE,
        rows.KIMODO,
        pickles.GMR,
        tracking.BEYONDMIMIC,
        tracking.MJLAB,
        omniretarget.OMNIRETARGET,
        omniretarget.TRAINING,
        archives.LOCOMUJOCO,
        archives.PYROKI,
        rows.PROTOMOTIONS_CSV,
        pickles.MIMICKIT,
        pickles.PHC,
        pickles.PROTOMOTIONS,
        keyframe_kit.FORMAT,
        archives.CORE,
        named_csv.SOMA,
        mujoco_files.KEYFRAMES,
        mujoco_files.SCENE_FOLDER,
        joint_trajectory.JOINT_TRAJECTORY,
        joint_trajectory.LIMB_TRAJECTORIES,
        bag.FORMAT,
        skeleton.FORMAT,
        servo_files.SERVO_TICKS,
        servo_files.OP3_ACTION,
        archives.ISAACLAB_AMP,
        sonic.FORMAT,
        lerobot.FORMAT,
    )
}
