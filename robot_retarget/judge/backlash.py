"""Backlash of gears: a passive hinge in series with every hinge of the robot.

    q = q_s + p,    |p| ≤ backlash

The servo and its encoder turn the shaft q_s, and the link is at q. The play p has the hinge's axis and anchor and is free between
two hard stops.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import RobotError, UsageError
from robot_retarget.robot.model import Robot
from robot_retarget.scene.geoms import PREFIX

MOST = 0.1
"""Largest backlash of a simulation [rad]; that of an XM430 is 0.0044."""
ARMATURE = 1e-3
"""Inertia of a play [kg m²], 2 % of the rotor of an XM430: with less, light links chatter between their stops in simulation."""
STOP = 0.004
"""Time constant of the stops [s]: twice a step of 2 ms, the least that MuJoCo allows."""
IMPEDANCE = 0.99
"""Impedance of the stops [-]: a walking OP3 bends them by up to 0.08°."""
PLAY = "play of "
"""Names of the passive hinges begin with this."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where a plant's model has the robot's coordinates: in the robot's order, with P play angles between them."""

    qpos: Ints
    """(nq,) indices of the robot's configuration in the model's."""
    dofs: Ints
    """(nv,) indices of the robot's velocities in the model's."""
    loose: Ints
    """(P,) indices of the hinges with play in the robot's configuration; P is 0 or n."""
    play: Ints
    """(P,) ids of the passive hinges in the model ..."""
    play_qpos: Ints
    """... and their indices in the model's configuration."""
    rest: Floats
    """The model's reference configuration: play in the middle, free bodies of a scene where they begin."""

    def model_qpos(self, qpos: Floats) -> Floats:
        """Return configurations (…, nq) of the robot as those of the model, with the play in the middle."""
        found = np.tile(self.rest, (*np.shape(qpos)[:-1], 1))
        found[..., self.qpos] = qpos
        return found

    def configuration(self, states: Floats) -> Floats:
        """Return configurations of the model as those of the robot (…, nq): the angle of a joint is that of its shaft plus its play."""
        found = states[..., self.qpos]
        found[..., self.loose] += states[..., self.play_qpos]
        return found


def add_play(spec: mujoco.MjSpec, robot: Robot, backlash: float) -> None:
    """Add the passive hinges to a specification of the robot.

    Args:
        backlash: either way [rad]; 0 adds none.

    Raises:
        UsageError: the backlash is no angle from 0 to `MOST`.
        RobotError: a body has several hinges, so that nothing fits between a hinge and its link.
    """
    if not 0 <= backlash <= MOST:
        raise UsageError(f"backlash must be 0 … {MOST:g} rad, got {backlash:g}")
    if not backlash:
        return
    _require_single(robot)
    model, joints = robot.model, list(spec.joints)
    for k, j in enumerate(robot.joint_ids):
        joints[j].parent.add_joint(
            name=PLAY + robot.joint_names[k], type=mujoco.mjtJoint.mjJNT_HINGE, axis=model.jnt_axis[j], pos=model.jnt_pos[j],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=_in_units_of(spec, [-backlash, backlash]), margin=0.0,
            solref_limit=[STOP, 1.0], solimp_limit=[IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0], armature=ARMATURE,
            stiffness=0.0, damping=0.0, frictionloss=0.0, springdamper=[0.0, 0.0], ref=0.0, springref=0.0,
        )  # fmt: skip


def places_of(model: mujoco.MjModel, robot: Robot) -> Places:
    """Find the robot's coordinates in a model with or without passive hinges and free bodies of a scene."""
    names = [model.joint(j).name for j in range(model.njnt)]
    passive = np.array([name.startswith(PLAY) for name in names], dtype=bool)
    added = passive | np.array([name.startswith(PREFIX) for name in names], dtype=bool)
    joint_of = np.searchsorted(model.jnt_qposadr, np.arange(model.nq), side="right") - 1
    play = np.flatnonzero(passive)
    return Places(
        np.flatnonzero(~added[joint_of]), np.flatnonzero(~added[model.dof_jntid]),
        robot.qpos_index if play.size else np.zeros(0, np.int64), play, model.jnt_qposadr[play].astype(np.int64), np.array(model.qpos0),
    )  # fmt: skip


def _require_single(robot: Robot) -> None:
    bodies, counts = np.unique(robot.model.jnt_bodyid[robot.joint_ids], return_counts=True)
    if (counts > 1).any():
        name = robot.model.body(int(bodies[counts.argmax()])).name
        raise RobotError(
            f"{robot.path}: body {name!r} has {counts.max()} hinges; backlash needs a body for each hinge: leave it out, or split the body"
        )


def _in_units_of(spec: mujoco.MjSpec, angles: list[float]) -> list[float]:
    """Angles [rad] in the unit of a specification."""
    return np.degrees(angles).tolist() if spec.compiler.degree else angles
