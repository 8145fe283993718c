"""The one table of formats; a new format is a file in one of the folders here and a line in this table."""

from robot_retarget.formats.binary import op3_action
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.npz import (
    beyondmimic,
    core,
    isaaclab_amp,
    locomujoco,
    mjlab,
    native,
    omniretarget,
    omniretarget_training,
    pyroki,
)
from robot_retarget.formats.pickles import gmr, keyframe_kit, mimickit, phc, protomotions
from robot_retarget.formats.scenes import (
    bag,
    joint_trajectory,
    keyframes,
    lerobot,
    limb_trajectories,
    scene,
    skeleton,
    sonic,
)
from robot_retarget.formats.text import kimodo, named_csv, protomotions_csv, servo_ticks, soma, unitree

FORMATS: dict[str, TrajectoryFormat] = {
    module.FORMAT.name: module.FORMAT
    for module in (
        native,
        named_csv,
        unitree,
        kimodo,
        gmr,
        beyondmimic,
        mjlab,
        omniretarget,
        omniretarget_training,
        locomujoco,
        pyroki,
        protomotions_csv,
        mimickit,
        phc,
        protomotions,
        keyframe_kit,
        core,
        soma,
        keyframes,
        scene,
        joint_trajectory,
        limb_trajectories,
        bag,
        skeleton,
        servo_ticks,
        op3_action,
        isaaclab_amp,
        sonic,
        lerobot,
    )
}
