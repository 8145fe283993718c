"""A robot as the performer: its forward kinematics makes the motion that another robot follows."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.keypoints import SIDES, parent_indices
from robot_retarget.contact.soles import contacts_of
from robot_retarget.human.motion import Motion
from robot_retarget.human.recognition import Mark, Recognition
from robot_retarget.human.segments import TURNED_BY
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.robot import Anatomy, Robot, recognise, world_points
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.trajectory import Trajectory


def performed(trajectory: Trajectory, robot: Robot) -> Motion:
    """Return the motion of a robot's keypoints,  x_k(t) = p_b(q_t) + R_b(q_t) o_k,  as that of a performer.

    Joints are the robot's keypoints, in their tree. A joint that turns a segment has the segment's forward, left and up as
    its rotation; every other joint has the rotation of its link. Nothing is estimated: keypoints, bone lengths, the floor
    under the lowest sole and the contacts of its feet are the robot's own.

    Args:
        trajectory: configurations of the robot.
        robot: the robot that moves.

    Raises:
        TrajectoryError: the trajectory belongs to another robot.
        MatchError: the robot is no humanoid.
    """
    require_same_robot(trajectory, robot)
    anatomy, qpos = recognise(robot), trajectory.qpos
    recognition, skeleton = _recognition(anatomy), _skeleton(robot, anatomy)
    feet = contacts_of(trajectory, robot, anatomy)
    around = () if trajectory.scene is None else trajectory.scene.names
    left_out = (f"The bodies around the robot are left out: {', '.join(around)}.",) if around else ()
    return Motion(
        skeleton,
        world_points(robot, anatomy.points, qpos) - [0.0, 0.0, feet.floor],
        _rotations(robot, anatomy, qpos),
        trajectory.fps,
        trajectory.source,
        (*trajectory.notes, *left_out),
        contacts=feet if feet.feet == SIDES else None,
        start_time=float(trajectory.source_time[0]),
        known=recognition,
    )


def _skeleton(robot: Robot, anatomy: Anatomy) -> Skeleton:
    """Keypoints and their tree, at rest in the robot's reference pose."""
    names, parents = anatomy.names, parent_indices(anatomy.names)
    rest = world_points(robot, anatomy.points, robot.neutral()[None])[0]
    return Skeleton(names, parents, np.where(parents[:, None] < 0, 0.0, rest - rest[np.maximum(parents, 0)]))


def _recognition(anatomy: Anatomy) -> Recognition:
    """Every joint is its own keypoint; the pelvis is the middle of the hips, as on the robot that follows."""
    marks = {name: Mark((k,), 1.0, "the robot's own") for k, name in enumerate(anatomy.names)}
    if {"l_hip", "r_hip"} <= marks.keys():
        hips = marks["l_hip"].joints + marks["r_hip"].joints
        marks["pelvis"] = Mark(hips, 1.0, "the middle of the hips")
    segments = {segment: TURNED_BY.get(segment, segment) for segment in anatomy.frames}
    return Recognition(marks, segments=segments, ankle_height=anatomy.ankle_height, names=anatomy.names)


def _rotations(robot: Robot, anatomy: Anatomy, qpos: Floats) -> Floats:
    """(T, K, 4) of the segment that a keypoint turns, or of its link."""
    turns = body_frames(robot, qpos)[1][:, anatomy.points.bodies]
    for segment, (_, axes) in anatomy.frames.items():
        k = anatomy.names.index(TURNED_BY.get(segment, segment))
        turns[:, k] = turns[:, k] @ axes
    return Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(*turns.shape[:2], 4)
