"""Figures of a retargeted trajectory against the human motion it came from, for the measuring scripts: those of `robot_retarget.scores`."""

from dataclasses import dataclass, fields

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot, world_points
from robot_retarget.scores import physics, pose
from robot_retarget.scores.pair import Pair
from robot_retarget.scores.subject import Subject, soles_of
from robot_retarget.trajectory import Trajectory

MEASURES = (
    pose.limbs, pose.distances, pose.contacts, physics.self_penetration, physics.skate, physics.ground, physics.jerk,
)  # fmt: skip
COLUMNS = {
    "limb_deg": "limb_deg_mean",
    "distance_err": "distance_err_mean",
    "contacts": "contact_recall",
    "overlap_pct": "self_pen_pct",
    "depth_cm": "self_pen_max_cm",
    "skate_cm_s": "skate_cm_s",
    "float_cm": "float_med_cm",
    "jerk": "jerk_rms",
}
"""Columns of the tables, and the figures of scores that they show."""


@dataclass(frozen=True)
class Figures:
    """Of one trajectory; `nan` where there is nothing to measure."""

    limb_deg: float
    """Angle between a human bone and the robot's, arms, legs and trunk, seen from the own pelvis [deg]."""
    distance_err: float
    """|d/τ of the robot − d/τ of the human| over all keypoint pairs, τ the path between them [-]."""
    contacts: float
    """Share of the human's hand contacts that the robot makes too."""
    overlap_pct: float
    """Frames in which links overlap, but for those that do where the robot rests [%]."""
    depth_cm: float
    """The deepest overlap [cm]."""
    skate_cm_s: float
    """Speed of the slowest sole point of a foot whose toes stand in the human motion [cm/s]."""
    float_cm: float
    """Median height of the lowest sole point [cm]."""
    jerk: float
    """Root of the mean squared third difference of the joints [rad/s³]."""
    step_rad: float
    """The largest change of one joint from frame to frame [rad]."""


def figures(robot: Robot, match: Match, human: Floats, qpos: Floats, fps: float) -> Figures:
    """Judge configurations (T, nq) against human keypoints (T, K, 3) [m] in the order of `match.keypoints`."""
    trajectory = Trajectory(qpos, fps, robot.joint_names, robot.name)
    pair = Pair(match, human, world_points(robot, match.points, qpos))
    subject = Subject(trajectory, robot, soles_of(robot, match.anatomy), pair)
    found = {name: value for measure in MEASURES for name, value in measure.values(subject).items()}
    values = {column: found[name] for column, name in COLUMNS.items()}
    step = float(np.abs(np.diff(subject.angles, axis=0)).max(initial=0.0))
    return Figures(**{column: np.nan if v is None else float(v) for column, v in values.items()}, step_rad=step)


def mean(several: list[Figures]) -> Figures:
    """Column by column over what could be measured; `depth_cm` and `step_rad` take the largest."""
    table = {f.name: np.array([getattr(one, f.name) for one in several]) for f in fields(Figures)}
    pick = {name: np.nanmax if name in ("depth_cm", "step_rad") else np.nanmean for name in table}
    return Figures(**{name: float(pick[name](v)) if np.isfinite(v).any() else np.nan for name, v in table.items()})
