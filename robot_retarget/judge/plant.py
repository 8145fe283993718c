"""The physics that a trajectory is played on: the robot's own model with a position servo on every driven hinge."""

import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import RobotError
from robot_retarget.judge.backlash import Places, add_play, places_of
from robot_retarget.judge.bodies import Objects, SimulatedBodies
from robot_retarget.judge.servo_model import Drives
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import feet_of
from robot_retarget.scene.geoms import add_bodies, add_floor_of_bodies
from robot_retarget.scene.ground import SolidGround
from robot_retarget.scene.scene import Scene

Mode = Literal["pinned", "free"]

FULL_TORQUE_ERROR = 0.2
"""An added servo pulls with all its torque at this error [rad]; an XM430 at its default gain does at 0.217."""
OPEN_STIFFNESS = 20.0
"""Where no torque bound is known, an added servo swings its limb at this rate without damping [rad/s]."""
DAMPING_RATIO = 0.7
"""Damping of an added servo, as a part of critical."""
HARD = 0.004
"""Time constant of a sole's contact with the floor [s]; MuJoCo's default of 0.02 is a cushion."""
HEAVY = 1e6
"""A held root is this many times as heavy as the robot: limbs cannot move it, gravity cannot let it fall."""


@dataclass(frozen=True, eq=False)
class Plant:
    """A compiled model whose only actuators are position servos on hinges."""

    robot: Robot
    model: mujoco.MjModel
    servos: Ints
    """(n,) the actuator of each hinge, −1 for one that nothing drives."""
    notes: tuple[str, ...]
    drives: Drives | None = None
    """The servos; None if the model keeps its own actuators."""
    bodies: SimulatedBodies | None = None
    """The bodies around the robot; None without a scene."""

    @cached_property
    def places(self) -> Places:
        """Where the model has the robot's coordinates."""
        return places_of(self.model, self.robot)

    @cached_property
    def ground(self) -> SolidGround:
        """The floor and the bodies at rest."""
        return SolidGround(None if self.bodies is None else self.bodies.scene)

    @cached_property
    def hinges(self) -> Ints:
        """(n,) indices of the angles that the encoders measure, in the model's configuration."""
        return self.places.qpos[self.robot.qpos_index]

    @cached_property
    def dofs(self) -> Ints:
        """(n,) indices of their speeds."""
        return self.places.dofs[self.robot.dof_index]

    @cached_property
    def root_dofs(self) -> Ints:
        """Indices of the root's velocities."""
        return self.places.dofs[root_dofs(self.robot)]

    @cached_property
    def root_coordinates(self) -> Ints:
        """Indices of the root in the robot's configuration."""
        adr = [*self.robot.model.jnt_qposadr, self.robot.model.nq]
        return np.array([c for j in self.robot.root_joints for c in range(adr[j], adr[j + 1])], dtype=np.int64)

    @property
    def servo_map(self) -> ServoMap | None:
        """The map with the limits of the goals; None if the model keeps its own actuators."""
        return None if self.drives is None else self.robot.servo_map

    @cached_property
    def driven(self) -> Ints:
        """Indices of the hinges with a servo, among the robot's hinges."""
        return np.flatnonzero(self.servos >= 0)

    @property
    def bounds(self) -> Floats:
        """(n,) the most torque each servo gives [N m], infinite where nothing bounds it."""
        model, bounds = self.model, np.array(self.robot.max_torque)
        for k in self.driven:
            servo = self.servos[k]
            if model.actuator_forcelimited[servo]:
                bounds[k] = np.abs(model.actuator_forcerange[servo] * model.actuator_gear[servo, 0]).max()
        return bounds

    def with_own_model(self) -> "Plant":
        """Return a plant that shares no model with others if its friction changes from step to step, else itself."""
        varies = self.drives is not None and self.drives.gears is not None
        return replace(self, model=copy.copy(self.model)) if varies else self

    def step(self, data: mujoco.MjData, count: int) -> None:
        """Advance the physics by some steps."""
        drives = self.drives
        if drives is None or drives.gears is None:
            mujoco.mj_step(self.model, data, count)
            return
        for _ in range(count):
            drives.gears.apply(self.model, data, self.dofs, drives.friction, drives.back_emf)
            mujoco.mj_step(self.model, data)

    def with_drives(self, drives: Drives) -> "Plant":
        """Return the plant with the gears and rotors of other drives; their motors are the same."""
        model = copy.copy(self.model)
        _set_mechanics(model, self.dofs, drives)
        return replace(self, model=model, drives=drives)

    def controls(self, goals: Floats) -> Floats:
        """Controls (N, nu) at which every servo rests at its goal (N, n) [rad]: force g c + b₀ + b₁ r q = 0, r the gear.

        Goals are rounded to the servos' ticks where those are known.
        """
        wanted = goals[:, self.driven]
        if self.drives is not None:
            tick = self.drives.tick[self.driven]
            wanted = np.round(wanted / tick) * tick
        offset, slope = self._control_line
        controls = np.zeros((len(goals), self.model.nu))
        controls[:, self.servos[self.driven]] = offset + slope * wanted
        return controls

    @cached_property
    def _control_line(self) -> tuple[Floats, Floats]:
        """Offset and slope (d,) of the controls over the goals of the driven hinges."""
        model, servo = self.model, self.servos[self.driven]
        gain, bias = model.actuator_gainprm[servo, 0], model.actuator_biasprm[servo]
        return -bias[:, 0] / gain, -bias[:, 1] * model.actuator_gear[servo, 0] / gain

    def goal_offsets(self, torque: Floats, speed: Floats) -> Floats:
        """How far before the joints the goals must be (N, n) [rad] for the servos to give `torque` [N m] at `speed` [rad/s].

        τ = r (g c + b₀ + b₁ r q + b₂ r ω) gives u − q = (τ − r² b₂ ω) / (−r² b₁).
        """
        model, driven = self.model, self.driven
        servo = self.servos[driven]
        square = model.actuator_gear[servo, 0] ** 2
        leads = np.zeros_like(torque)
        braked = torque[:, driven] - square * model.actuator_biasprm[servo, 2] * speed[:, driven]
        leads[:, driven] = braked / (-square * model.actuator_biasprm[servo, 1])
        return leads


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
        floor = mode == "free" and _add_floor(spec, robot)
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
    if drives is not None:
        _set_mechanics(model, dofs, drives)
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
        servo = spec.add_actuator(name=f"servo of {joint.name}", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=stiffness, kv=2 * DAMPING_RATIO * np.sqrt(stiffness * inertia[k]))
        if np.isfinite(torque):
            servo.forcerange = [-torque, torque]
            servo.forcelimited = True
    return [robot.joint_names[k] for k in bare]


def _add_drives(spec: mujoco.MjSpec, robot: Robot, drives: Drives) -> list[str]:
    """Put the servos of `drives` on all hinges: clip(k_p (u − q) − k_d ω, ±τ_stall)."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    joints = list(spec.joints)
    for k, j in enumerate(robot.joint_ids):
        joint, bound = joints[j], drives.stall_torque[k]
        joint.name = joint.name or robot.joint_names[k]
        joint.actfrclimited, joint.springdamper = False, [0, 0]
        servo = spec.add_actuator(name=f"servo of {joint.name}", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=drives.stiffness[k], kv=drives.derivative[k])
        servo.forcerange, servo.forcelimited = [-bound, bound], True
    return []


def _set_mechanics(model: mujoco.MjModel, dofs: Ints, drives: Drives) -> None:
    """What turns with the shafts: the back-EMF acts beyond the clip of the duty, so it is a damping of the joint."""
    model.dof_damping[dofs] = drives.back_emf + drives.damping
    model.dof_frictionloss[dofs] = drives.friction
    model.dof_armature[dofs] = drives.armature
    mujoco.mj_setConst(model, mujoco.MjData(model))


def limb_inertia(robot: Robot, model: mujoco.MjModel | None = None) -> Floats:
    """(n,) what each hinge swings in the standing pose, the rest of the robot held still [kg m²]; `model` as in a plant."""
    chosen = robot.model if model is None else model
    data, places = mujoco.MjData(chosen), places_of(chosen, robot)
    data.qpos[:] = places.model_qpos(robot.standing())
    mujoco.mj_forward(chosen, data)
    columns = np.zeros((chosen.nv, chosen.nv))
    for column, unit in zip(columns, np.eye(chosen.nv), strict=True):
        mujoco.mj_mulM(chosen, data, column, unit)
    return np.diag(columns)[places.dofs[robot.dof_index]]


def _add_floor(spec: mujoco.MjSpec, robot: Robot) -> bool:
    """A plane z = 0 where the scene has no plane or height field."""
    flat = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    if np.isin(robot.model.geom_type, flat).any():
        return False
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05], contype=1, conaffinity=0xFFFF)
    return True


def _harden_floor(model: mujoco.MjModel, robot: Robot) -> None:
    """Soles on the floor settle within `HARD`: on a softer contact a foot creeps along under no more than its servos' jolts."""
    own = np.isin(model.geom_bodyid, [0, *feet_of(robot).all_bodies])
    soft = own & (model.geom_solref[:, 0] > HARD)
    model.geom_solref[soft] = HARD, 1.0


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
