"""The root of a robot on its feet, from the angles of its joints: the standing foot is flat on the floor and stays in its place."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MatchError
from robot_retarget.robot.anatomy import Anatomy
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise

OTHER_CARRIES = 1e-3
"""The other foot carries the robot once it would be this far below the floor [m]: a hundred times the unevenness of both treads in
the standing poses of the OP3, the G1 and ToddlerBot, measured."""


def planted(robot: Robot, angles: Floats) -> Floats:
    """Return the configurations (T, nq) of a robot that stands on the floor with the given angles.

    One foot is flat and does not move. The other one takes over when it would be below the floor. The first foot is where the
    standing pose has it. A robot without feet or without a free root keeps the root of its standing pose.

    Args:
        robot: the robot.
        angles: (T, n) of its hinges [rad].
    """
    qpos, feet = np.tile(robot.standing(), (len(angles), 1)), _feet(robot)
    qpos[:, robot.qpos_index] = angles
    if feet is None:
        return qpos
    places, turns = body_frames(robot, np.concatenate([robot.standing()[None], qpos]))
    bodies = np.tile(np.eye(4), (*places.shape[:2], 1, 1))
    bodies[..., :3, :3], bodies[..., :3, 3] = turns, places
    soles = {side: bodies[:, feet.frames[f"{side}_foot"][0]] @ _sole(feet, side) for side in "lr"}
    lowest = {side: _lowest(feet, bodies, soles[side], other) for side, other in ("lr", "rl")}
    side = max("lr", key=lambda foot: lowest[foot][1])
    place, start = _level(soles[side][0]), robot.root_address
    for t in range(1, len(bodies)):
        best = max("lr", key=lambda foot: lowest[foot][t])
        if lowest[side][t] < -OTHER_CARRIES:
            place, side = _level(place @ np.linalg.solve(soles[side][t], soles[best][t])), best
        root = place @ np.linalg.solve(soles[side][t], bodies[t, robot.root_body])
        turn = Rotation.from_matrix(root[:3, :3]).as_quat(canonical=True, scalar_first=True)
        qpos[t - 1, start : start + 7] = [*root[:3, 3], *turn]
    return qpos


def _feet(robot: Robot) -> Anatomy | None:
    """The anatomy of a robot that can stand on its feet."""
    try:
        anatomy = recognise(robot)
    except MatchError:
        return None
    return anatomy if robot.floating and anatomy.treads.keys() == {"l", "r"} else None


def _sole(feet: Anatomy, side: str) -> Floats:
    """(4, 4) forward, left and up of a foot in its body, its origin in the middle of the tread."""
    found, axes = np.eye(4), feet.frames[f"{side}_foot"][1]
    points = feet.treads[side].offsets @ axes
    found[:3, :3], found[:3, 3] = axes, axes @ [*points[:, :2].mean(axis=0), points[:, 2].min()]
    return found


def _lowest(feet: Anatomy, bodies: Floats, sole: Floats, other: str) -> Floats:
    """(T,) height of the lowest point of the other tread while a sole (T, 4, 4) is flat on the floor [m]."""
    tread, up = feet.treads[other], np.linalg.inv(sole)[:, 2]
    points = np.concatenate([tread.offsets, np.ones((len(tread), 1))], axis=1)
    return np.einsum("ti,tpij,pj->tp", up, bodies[:, tread.bodies], points).min(axis=1)


def _level(sole: Floats) -> Floats:
    """(4, 4) the pose of a sole with its heading and place, flat on the floor."""
    found = np.eye(4)
    found[:3, :3] = Rotation.from_euler("z", np.arctan2(sole[1, 0], sole[0, 0])).as_matrix()
    found[:2, 3] = sole[:2, 3]
    return found
