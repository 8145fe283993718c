"""A robot's content as a hash: included files, meshes, limits and servo map count, the place of its file does not."""

import hashlib

import mujoco
import numpy as np

from robot_retarget.robot.model import Robot


def robot_sha256(robot: Robot) -> str:
    """Return the sha256 of the compiled model, of the limits of its hinges and of its servo map."""
    model = np.empty(mujoco.mj_sizeModel(robot.model), np.uint8)
    mujoco.mj_saveModel(robot.model, None, model)
    digest = hashlib.sha256(model.tobytes())
    for limit in (robot.lower, robot.upper, robot.max_speed, robot.max_torque):
        digest.update(np.asarray(limit).tobytes())
    digest.update(repr((robot.name, robot.joint_names, robot.servo_map)).encode())
    return digest.hexdigest()
