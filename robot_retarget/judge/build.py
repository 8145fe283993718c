"""Build the model that a trajectory is played on: servos, floor, bodies around, backlash.

Backlash is a passive hinge in series with every hinge of the robot:

    q = q_s + p,    |p| ≤ backlash

The servo and its encoder turn the shaft q_s, and the link is at q. The play p has the hinge's axis and anchor and is free between
two hard stops.
"""

from typing import Any

import mujoco
import numpy as np

from robot_retarget.base.arrays import Ints
from robot_retarget.base.errors import RobotError, UsageError
from robot_retarget.judge.bodies import Objects, SimulatedBodies
from robot_retarget.judge.plant import CRISP, PLAY, Mode, Plant, limb_inertia, places_of, set_mechanics, soles_and_floor
from robot_retarget.judge.servo_model import Drives
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import feet_of
from robot_retarget.scene.geoms import add_bodies, add_floor, add_floor_of_bodies
from robot_retarget.scene.scene import Scene

FULL_TORQUE_ERROR = 0.2
"""An added servo pulls with all its torque at this error [rad]; an XM430 at its default gain does at 0.217."""
OPEN_STIFFNESS = 20.0
"""Where no torque bound is known, an added servo swings its limb at this rate without damping [rad/s]: an XM430 of 18.9 N m/rad swings its
rotor of 0.045 kg m² at 20.5."""
DAMPING_RATIO = 0.7
"""Damping of an added servo, as a part of critical [-]: it overshoots by 5 %."""
HEAVY = 1e6
"""A held root is this many times as heavy as the robot [-]: limbs move it by a millionth of their way, and gravity by 0.5 mm
in 10 s."""
MOST_BACKLASH = 0.1
"""Largest backlash of a simulation [rad]; that of an XM430 is 0.0044."""
ARMATURE = 1e-3
"""Inertia of a play [kg m²], 2 % of the rotor of an XM430: with less, light links chatter between their stops in simulation."""
STOP = 0.004
"""Time constant of the stops [s]: twice a step of 2 ms, the least that MuJoCo allows."""
IMPEDANCE = 0.99
"""Impedance of the stops [-]: a walking OP3 bends them by up to 0.08°."""


def build_plant(
    robot: Robot,
    mode: Mode,
    drives: Drives | None = None,
    backlash: float = 0.0,
    scene: Scene | None = None,
    objects: Objects = "carried",
) -> Plant:
    """Compile the robot's MJCF for physics.

    With `drives` every hinge gets that servo instead of the actuator, damping, friction and armature of the model.
    Without, the model's position servos are kept; a hinge without one gets one, with gains from its torque bound or its limb's
    inertia, unless gears or closed chains move it (`robot/coupling.py`). Every other actuator, all sensors and keyframes are removed.
    `free` adds a floor where the scene has none; `pinned` takes the scene out of reach and makes the root immovable.
    `backlash` puts a play between every hinge and its link, either way [rad]. The bodies of a `scene` are solid; `objects`
    states whether those that move are carried along their path or free.

    Raises:
        RobotError: the MJCF no longer compiles to the robot that was loaded, or a body has several hinges and backlash.
        UsageError: the backlash is out of bounds.
    """
    try:
        spec = robot.spec()
        kept = _strip(spec, robot, keep=drives is None)
        added = _add_servos(spec, robot, kept) if drives is None else _add_drives(spec, robot, drives)
        floor = mode == "free" and add_floor(spec, robot.model)
        add_play(spec, robot, backlash)
        if scene is not None:
            add_bodies(spec, scene, objects == "free")
            if mode == "pinned":
                add_floor_of_bodies(spec)
        model = spec.compile()
    except ValueError as error:
        raise RobotError(f"{robot.path}: cannot be prepared for simulation: {' '.join(str(error).split())}") from error
    places = places_of(model, robot)
    if len(places.qpos) != robot.model.nq:
        raise RobotError(f"{robot.path}: has {len(places.qpos)} coordinates now, {robot.model.nq} when it was loaded")
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    dofs = places.dofs[robot.dof_index]
    _take_ranges(model, model.dof_jntid[dofs], robot)
    if drives is not None:
        set_mechanics(model, dofs, drives)
    if mode == "pinned":
        _hold_root(model, places.dofs[root_dofs(robot)])
        _leave_scene(model)
    else:
        _harden_floor(model, robot)
    servos = np.full(len(robot.joint_names), -1)
    place = {int(j): k for k, j in enumerate(model.dof_jntid[dofs])}
    for actuator in range(model.nu):
        servos[place[int(model.actuator_trnid[actuator, 0])]] = actuator
    remarks = list(drives.notes) if drives is not None else []
    if mode == "free" and not feet_of(robot).names:
        remarks.append("no feet are recognised: the bodies that touch the floor first may stand on it")
    if backlash:
        remarks.append(f"backlash of ±{np.degrees(backlash):.3g}° in every joint")
    bodies = None if scene is None else SimulatedBodies(scene, model)
    if bodies is not None:
        bodies.touch(robot)
    return Plant(robot, model, servos, (*remarks, *_notes(robot, servos, added, floor)), drives, bodies)


def _take_ranges(model: mujoco.MjModel, joints: Ints, robot: Robot) -> None:
    """Give joints whose range was stated beyond that of the model (a limits file) the stated one."""
    ranges = np.stack([robot.lower, robot.upper], axis=1)
    beyond = ((ranges - model.jnt_range[joints]) * [-1, 1] > 1e-6).any(axis=1)
    model.jnt_range[joints[beyond]] = ranges[beyond]


def _strip(spec: mujoco.MjSpec, robot: Robot, keep: bool) -> set[int]:
    """Leave one position servo per hinge if they are to be kept, and no other actuator; the joints that have one."""
    model, served = robot.model, set()
    for actuator, element in enumerate(list(spec.actuators)):
        joint = int(model.actuator_trnid[actuator, 0])
        if keep and _is_servo(model, actuator) and joint in robot.joint_ids and joint not in served:
            served.add(joint)
        else:
            spec.delete(element)
    for element in [*spec.sensors, *spec.keys]:
        spec.delete(element)
    return served


def _is_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator pulls a joint towards its control: constant gain, and a bias that opposes the position."""
    return bool(
        model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        and model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
        and model.actuator_gainprm[actuator, 0] > 0
        and model.actuator_biasprm[actuator, 1] < 0
    )


def _add_servos(spec: mujoco.MjSpec, robot: Robot, served: set[int]) -> list[str]:
    """Put servos on the hinges without one; their names."""
    model = robot.model
    actuated = set(model.actuator_trnid[model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT, 0].tolist())
    mechanism = Coupling(robot).present
    bare = [k for k, j in enumerate(robot.joint_ids) if j not in served and (j in actuated or not mechanism)]
    if not bare:
        return []
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # Euler leaves a servo's damping explicit
    inertia = limb_inertia(robot)
    joints = list(spec.joints)
    for k in bare:
        joint = joints[robot.joint_ids[k]]
        joint.name = joint.name or robot.joint_names[k]
        torque = float(robot.max_torque[k])
        stiffness = torque / FULL_TORQUE_ERROR if np.isfinite(torque) else inertia[k] * OPEN_STIFFNESS**2
        servo = _servo_on(spec, joint)
        servo.set_to_position(kp=stiffness, kv=2 * DAMPING_RATIO * np.sqrt(stiffness * inertia[k]))
        if np.isfinite(torque):
            servo.forcerange = [-torque, torque]
            servo.forcelimited = True
    return [robot.joint_names[k] for k in bare]


def _servo_on(spec: mujoco.MjSpec, joint: Any) -> Any:
    """An actuator on a hinge that takes every goal: the range of control among a model's defaults is that of its motors."""
    named = f"servo of {joint.name}"
    servo = spec.add_actuator(name=named, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.ctrllimited = False
    return servo


def _add_drives(spec: mujoco.MjSpec, robot: Robot, drives: Drives) -> list[str]:
    """Put the servos of `drives` on all hinges: clip(k_p (u − q) − k_d ω, ±τ_stall)."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    joints = list(spec.joints)
    for k, j in enumerate(robot.joint_ids):
        joint, bound = joints[j], drives.stall_torque[k]
        joint.name = joint.name or robot.joint_names[k]
        joint.actfrclimited, joint.springdamper = False, [0, 0]
        servo = _servo_on(spec, joint)
        servo.set_to_position(kp=drives.stiffness[k], kv=drives.derivative[k])
        servo.forcerange, servo.forcelimited = [-bound, bound], True
    return []


def _harden_floor(model: mujoco.MjModel, robot: Robot) -> None:
    """Soles on the floor settle within `CRISP`: on a softer contact a foot creeps along under no more than its servos' jolts."""
    soft = soles_and_floor(model, robot) & (model.geom_solref[:, 0] > CRISP)
    model.geom_solref[soft] = CRISP, 1.0


def _hold_root(model: mujoco.MjModel, root: Ints) -> None:
    """Make the root immovable; the constraint solver stops at an improvement that its weight does not hide."""
    model.dof_armature[root] = HEAVY * model.body_mass.sum()
    model.opt.tolerance /= HEAVY
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _leave_scene(model: mujoco.MjModel) -> None:
    """Nothing of the world touches the robot any more, be it by masks or by listed pairs."""
    scene = np.flatnonzero(model.geom_bodyid == 0)
    model.geom_contype[scene] = model.geom_conaffinity[scene] = 0
    listed = np.isin(model.pair_geom1, scene) | np.isin(model.pair_geom2, scene)
    model.pair_margin[listed] = -1e6


def _notes(robot: Robot, servos: Ints, added: list[str], floor: bool) -> list[str]:
    notes = []
    if added:
        which = "every joint" if len(added) == len(servos) else ", ".join(added)
        notes.append(
            f"the model has no position servo on {which}: added with full torque at {FULL_TORQUE_ERROR} rad, or "
            f"{OPEN_STIFFNESS:g} rad/s on the limb's inertia where no torque bound is known, damping ratio {DAMPING_RATIO}"
        )
    loose = [robot.joint_names[k] for k in np.flatnonzero(servos < 0)]
    if loose:
        notes.append(f"left to the model's gears and closed chains: {', '.join(loose)}")
    if floor:
        notes.append("the model has no floor: a plane z = 0 added")
    return notes


def add_play(spec: mujoco.MjSpec, robot: Robot, backlash: float) -> None:
    """Add the passive hinges to a specification of the robot.

    Args:
        backlash: either way [rad]; 0 adds none.

    Raises:
        UsageError: the backlash is no angle from 0 to `MOST_BACKLASH`.
        RobotError: a body has several hinges, so that nothing fits between a hinge and its link.
    """
    if not 0 <= backlash <= MOST_BACKLASH:
        raise UsageError(f"backlash must be 0 … {MOST_BACKLASH:g} rad, got {backlash:g}")
    if not backlash:
        return
    model, joints = robot.model, list(spec.joints)
    if (crowded := crowded_body(robot)) is not None:
        raise RobotError(
            f"{robot.path}: body {model.body(crowded).name!r} has several hinges; backlash needs a body for each hinge: leave it out, or split the body"
        )
    for k, j in enumerate(robot.joint_ids):
        joints[j].parent.add_joint(
            name=PLAY + robot.joint_names[k], type=mujoco.mjtJoint.mjJNT_HINGE, axis=model.jnt_axis[j], pos=model.jnt_pos[j],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=_in_units_of(spec, [-backlash, backlash]), margin=0.0,
            solref_limit=[STOP, 1.0], solimp_limit=[IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0], armature=ARMATURE,
            stiffness=0.0, damping=0.0, frictionloss=0.0, springdamper=[0.0, 0.0], ref=0.0, springref=0.0,
        )  # fmt: skip


def crowded_body(robot: Robot) -> int | None:
    """Return a body with several hinges, so that no play fits between a hinge and its link; None without one."""
    bodies, counts = np.unique(robot.model.jnt_bodyid[robot.joint_ids], return_counts=True)
    return int(bodies[counts.argmax()]) if (counts > 1).any() else None


def _in_units_of(spec: mujoco.MjSpec, angles: list[float]) -> list[float]:
    """Angles [rad] in the unit of a specification."""
    return np.degrees(angles).tolist() if spec.compiler.degree else angles
