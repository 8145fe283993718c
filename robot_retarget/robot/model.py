"""A robot: the MuJoCo model, its joints in order, and what each may do."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Floats, Ints, frozen
from robot_retarget.base.errors import RobotError, known
from robot_retarget.base.pages import card
from robot_retarget.robot.source import Quaternion, read_spec
from robot_retarget.trajectory import Trajectory

FREE, BALL, SLIDE, HINGE = (
    mujoco.mjtJoint.mjJNT_FREE,
    mujoco.mjtJoint.mjJNT_BALL,
    mujoco.mjtJoint.mjJNT_SLIDE,
    mujoco.mjtJoint.mjJNT_HINGE,
)

STANDING_KEYS = ("stand", "home", "standing", "default", "initial")
"""Names of keyframes in which a robot stands on flat feet."""
DEFAULT_RANGE = np.pi
"""A hinge without any stated range may turn this far either way [rad]."""
AT_SPEED_BOUND = 1e-3
"""A speed within this share of its bound is bounded: the solver keeps bounds to 1e-4 [-]."""
RANGE_OVERLAP = 0.5
"""Ranges of model and servo map that share less of the smaller one are a mistake [-]: of 25 joints of Poppy half finds five of seven that are
mirrored, and of the shipped robots none."""
DEFAULT_MAX_SPEED = 10.0
"""Where neither the model nor a limits file says [rad/s]: a brisk servo's, 10.8 of an XL330-M288 and 8.1 of an XM430-W210."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A compiled MJCF model and the facts of its n hinges that every later stage reads.

    The root (a free joint, single slides and hinges, or nothing) is not among the hinges.
    """

    name: str
    model: mujoco.MjModel
    path: Path
    """The MJCF or URDF file."""
    joint_names: tuple[str, ...]
    """n hinge names, in the model's order."""
    joint_ids: Ints
    """(n,) their ids in the model."""
    lower: Floats
    upper: Floats
    """(n,) ranges [rad]."""
    max_speed: Floats
    """(n,) [rad/s]."""
    max_torque: Floats
    """(n,) [N m], infinite where the model has no bound."""
    root_joints: Ints
    """Ids of the joints that carry the whole robot: one free joint, up to six single ones, or none."""
    notes: tuple[str, ...] = ()
    freed: Quaternion | None = None
    """Rotation in the reference pose, relative to the file, of a robot with an added free joint."""
    servo_map: ServoMap | None = None
    """The servos that turn its hinges, if known."""
    whole: "Robot | None" = None
    """The robot before some of its joints were frozen (`override.freeze`), which recognition reads; None is itself."""
    arms_down: Callable[["Robot"], Floats] | None = None
    """Gives the standing pose (nq,) of a model without such a keyframe (`stand.with_arms_down`); without it that is `qpos0`."""
    led: Mapping[int, Trajectory] = field(default_factory=dict)
    """Frozen hinges that a trajectory moves instead, by index."""

    def __post_init__(self) -> None:
        for name, dtype in (("joint_ids", np.int64), ("root_joints", np.int64)):
            object.__setattr__(self, name, frozen(getattr(self, name), dtype))
        for name in ("lower", "upper", "max_speed", "max_torque"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        crossed = np.flatnonzero(self.lower > self.upper)
        if crossed.size:
            j = crossed[0]
            raise RobotError(
                f"{self.name}: joint {self.joint_names[j]!r} has the range {self.lower[j]:.4g} … {self.upper[j]:.4g} rad, "
                "lower above upper"
            )

    def __repr__(self) -> str:
        return f"<Robot {self.name}: {', '.join(self._facts().values())}>"

    def _repr_html_(self) -> str:
        limits = zip(self.joint_names, np.degrees(self.lower), np.degrees(self.upper), self.max_speed, strict=True)
        joints = {name: f"{low:.0f} … {high:.0f}°, {speed:.1f} rad/s" for name, low, high, speed in limits}
        return card(self.name, self._facts() | joints, self.notes)

    def _facts(self) -> dict[str, str]:
        root = "a free root" if self.floating else f"a root of {self.root_joints.size} joints"
        return {
            "joints": f"{len(self.joint_names)} joints",
            "mass": f"{float(np.sum(self.model.body_mass)):.2f} kg",
            "root": root if self.root_joints.size else "a fixed root",
        }

    def ranges(self, times: Floats) -> tuple[Floats, Floats]:
        """Return the ranges (T, n) of the hinges at times (T,) [s]: that of a hinge which is led is its angle [rad]."""
        lower, upper = (np.tile(end, (len(times), 1)) for end in (self.lower, self.upper))
        for hinge, trajectory in self.led.items():
            angles = trajectory.angles[:, trajectory.joint_names.index(self.joint_names[hinge])]
            lower[:, hinge] = upper[:, hinge] = np.interp(times * trajectory.fps, np.arange(len(trajectory)), angles)
        return lower, upper

    def spec(self) -> mujoco.MjSpec:
        """Return a new specification, to be changed and compiled; body and joint numbers are the model's."""
        return read_spec(self.path, self.freed)

    @cached_property
    def qpos_index(self) -> Ints:
        """(n,) index of each hinge in qpos."""
        return frozen(self.model.jnt_qposadr[self.joint_ids], np.int64)

    @cached_property
    def dof_index(self) -> Ints:
        """(n,) index of each hinge in qvel."""
        return frozen(self.model.jnt_dofadr[self.joint_ids], np.int64)

    @cached_property
    def single_index(self) -> tuple[Ints, Ints]:
        """The indices of hinges and slides in qpos, and in qvel."""
        single = self.model.jnt_type != FREE
        return frozen(self.model.jnt_qposadr[single], np.int64), frozen(self.model.jnt_dofadr[single], np.int64)

    @cached_property
    def free_index(self) -> list[tuple[int, int]]:
        """Where every free joint begins in qpos, and in qvel."""
        free = self.model.jnt_type == FREE
        return list(zip(self.model.jnt_qposadr[free].tolist(), self.model.jnt_dofadr[free].tolist(), strict=True))

    @property
    def floating(self) -> bool:
        """Whether the root is a free joint."""
        return self.root_joints.size == 1 and self.model.jnt_type[self.root_joints[0]] == FREE

    @property
    def root_address(self) -> int:
        """Where the root's coordinates begin in qpos; of a robot with a root only."""
        return int(self.model.jnt_qposadr[self.root_joints[0]])

    @property
    def root_body(self) -> int:
        """The body that carries the root joints, or the first body of a robot bolted to the world."""
        if self.root_joints.size:
            return int(self.model.jnt_bodyid[self.root_joints[-1]])
        return int(self.model.body_rootid[self.model.jnt_bodyid[self.joint_ids[0]]])

    @property
    def gravity(self) -> float:
        """Gravity in the model [m/s²]."""
        return float(np.linalg.norm(self.model.opt.gravity))

    def neutral(self) -> Floats:
        """The reference configuration `qpos0`, hinges brought within their ranges. (nq,)"""
        qpos = np.array(self.model.qpos0)
        qpos[self.qpos_index] = np.clip(qpos[self.qpos_index], self.lower, self.upper)
        return qpos

    @property
    def standing_key(self) -> Floats | None:
        """(nq,) The keyframe in which the robot stands, where the model has one."""
        keys = {self.model.key(k).name.lower(): k for k in range(self.model.nkey)}
        found = next((keys[name] for name in STANDING_KEYS if name in keys), None)
        return None if found is None else np.array(self.model.key_qpos[found])

    def standing(self) -> Floats:
        """The keyframe in which the robot stands, where the model has one, else `qpos0` with arms down (`stand`). (nq,)"""
        key = self.standing_key
        if key is None:
            key = self.arms_down(self.whole or self) if self.arms_down else self.model.qpos0
        return np.array(key)


def robot_from_model(
    model: mujoco.MjModel,
    path: Path,
    name: str,
    limits: dict[str, dict[str, Any]] | None = None,
    notes: tuple[str, ...] = (),
    freed: Quaternion | None = None,
) -> Robot:
    """Read the joints of a compiled model.

    `limits` adds values that an MJCF lacks, from a limits file (`catalog.read_limits`): tables `range` {joint: [lower,
    upper]} [rad], `speed` {joint: rad/s} and `torque` {joint: N m}; the key `*` applies to all joints.

    Args:
        model: the compiled model.
        path: the model's file.
        name: of the robot.
        limits: tables of a limits file (`catalog.read_limits`).
        notes: sentences about the file.
        freed: rotation of a robot with an added free joint, w x y z.

    Raises:
        RobotError: no hinges, a ball joint, or a limit for an absent joint.
    """
    root = _root_joints(model)
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == HINGE and j not in root]
    ball = [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] == BALL]
    if ball:
        raise RobotError(f"{path}: ball joint {ball[0]!r}: only hinges can be retargeted; write it as three hinges")
    if not hinges:
        raise RobotError(f"{path}: the model has no hinge joint")
    names = tuple(model.joint(j).name or f"joint_{j}" for j in hinges)
    lower, upper, unstated = _ranges(model, hinges, names)
    tables = limits or {}
    bounds = _stated(tables, "range", names)
    for k, pair in bounds.items():
        lower[k], upper[k] = pair
    unlimited = [names[k] for k in unstated if k not in bounds]
    remarks = (f"no range given for {', '.join(unlimited)}: ±{DEFAULT_RANGE:.4g} rad taken",) if unlimited else ()
    speed, torque = np.full(len(names), DEFAULT_MAX_SPEED), _torques(model, hinges)
    for values, key in ((speed, "speed"), (torque, "torque")):
        for k, value in _stated(tables, key, names).items():
            values[k] = value
    remarks = (*notes, *remarks)
    joints, carriers = np.array(hinges), np.array(root, int)
    return Robot(name, model, path, names, joints, lower, upper, speed, torque, carriers, remarks, freed)


def _root_joints(model: mujoco.MjModel) -> list[int]:
    """The free joint, or the leading single joints of the first jointed body when a slide is among them."""
    if model.njnt == 0:
        return []
    first = int(model.jnt_bodyid[0])
    own = [j for j in range(model.njnt) if model.jnt_bodyid[j] == first]
    if model.jnt_type[own[0]] == FREE:
        return [own[0]]
    chain = list(own)
    body = first
    while len(chain) < 6:  # six single joints may stand on a chain of massless bodies
        children = np.flatnonzero(model.body_parentid == body)
        if len(children) != 1 or model.body_jntnum[children[0]] == 0:
            break
        body = int(children[0])
        chain += range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
    slides = [j for j in chain if model.jnt_type[j] == SLIDE]
    return chain[:6] if len(slides) == 3 else own if any(model.jnt_type[j] == SLIDE for j in own) else []


def _ranges(model: mujoco.MjModel, hinges: list[int], names: tuple[str, ...]) -> tuple[Floats, Floats, list[int]]:
    """Joint ranges; without one the range of a position servo; without that ±π (those are returned third)."""
    lower, upper = np.full(len(names), -DEFAULT_RANGE), np.full(len(names), DEFAULT_RANGE)
    open_ended = []
    servo = {int(model.actuator_trnid[a, 0]): a for a in range(model.nu) if _is_position_servo(model, a)}
    for k, j in enumerate(hinges):
        if model.jnt_limited[j]:
            lower[k], upper[k] = model.jnt_range[j]
        elif j in servo and model.actuator_ctrllimited[servo[j]]:
            lower[k], upper[k] = model.actuator_ctrlrange[servo[j]]
        else:
            open_ended.append(k)
    return lower, upper, open_ended


def _is_position_servo(model: mujoco.MjModel, actuator: int) -> bool:
    joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    return bool(joint and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE)


def _torques(model: mujoco.MjModel, hinges: list[int]) -> Floats:
    """The least bound that the joint itself or its actuators put on the torque [N m]."""
    torque = np.full(len(hinges), np.inf)
    place = {j: k for k, j in enumerate(hinges)}
    for k, j in enumerate(hinges):
        if model.jnt_actfrclimited[j]:
            torque[k] = np.abs(model.jnt_actfrcrange[j]).max()
    for a in range(model.nu):
        k = place.get(int(model.actuator_trnid[a, 0]))
        if k is not None:
            torque[k] = min(torque[k], _actuator_bound(model, a) * abs(model.actuator_gear[a, 0]))
    return torque


def _actuator_bound(model: mujoco.MjModel, actuator: int) -> float:
    """The largest force an actuator gives, before its gear: its own bound, or a motor's full control."""
    if model.actuator_forcelimited[actuator]:
        return float(np.abs(model.actuator_forcerange[actuator]).max())
    motor = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    if motor and model.actuator_ctrllimited[actuator]:
        return float(np.abs(model.actuator_ctrlrange[actuator]).max() * abs(model.actuator_gainprm[actuator, 0]))
    return float("inf")


def _stated(tables: dict[str, dict[str, Any]], key: str, names: tuple[str, ...]) -> dict[int, Any]:
    """Return the values of a table of a limits file by the place of their joint among names."""
    table = tables.get(key, {})
    return {k: table.get(name, table.get("*")) for k, name in enumerate(names) if name in table or "*" in table}


# The servos that turn a robot's joints, and the limits that they set on planned motions.


def with_servos(robot: Robot, servo_map: ServoMap) -> Robot:
    """Return the robot on the servos of a map: ranges and speeds are limited to those of its goals.

    Args:
        servo_map: the servos that turn its joints.

    Raises:
        RobotError: a joint has no servo, or its range does not overlap that of its servo.
        MapError: a map without servos has a gain for an absent joint.
    """
    if not servo_map.servos:
        servo_map.require_gains_of(robot.joint_names)
        return replace(robot, servo_map=servo_map)
    bare = [joint for joint in robot.joint_names if joint not in (*servo_map.joints, *servo_map.passive)]
    if bare:
        raise RobotError(f"{robot.name}: no servo for the joint {bare[0]!r}; {known(servo_map.joints)}")
    lower, upper, speed = (np.array(values) for values in (robot.lower, robot.upper, robot.max_speed))
    apart = list[str]()
    for k, joint in enumerate(robot.joint_names):
        if joint in servo_map.joints:
            ends = (lower[k], upper[k]), servo_map[joint].reach
            lower[k], upper[k] = max(ends[0][0], ends[1][0]), min(ends[0][1], ends[1][1])
            speed[k] = min(speed[k], servo_map.limits.speed)
            if upper[k] - lower[k] < RANGE_OVERLAP * min(high - low for low, high in ends):
                apart.append(
                    f"{joint} by " + " and by ".join("{:.0f} … {:.0f}°".format(*np.degrees(end)) for end in ends)
                )
    strange = f"the model and the servo map turn {', '.join(apart)}: look over the signs and zeros of the map"
    notes = (*robot.notes, strange) if apart else robot.notes
    return replace(robot, lower=lower, upper=upper, max_speed=speed, servo_map=servo_map, notes=notes)


def assumed_speed_notes(robot: Robot, angles: Floats, fps: float) -> list[str]:
    """Return a note on joints whose motion (T, n) [rad] is as fast as their assumed bound allows, which the file does not state."""
    top = np.abs(np.diff(angles, axis=0)).max(axis=0, initial=0.0) * fps
    bound = (robot.max_speed == DEFAULT_MAX_SPEED) & (top > (1 - AT_SPEED_BOUND) * DEFAULT_MAX_SPEED)
    if not bound.any():
        return []
    names = ", ".join(robot.joint_names[k] for k in np.flatnonzero(bound))
    return [
        f"{names}: at {DEFAULT_MAX_SPEED:g} rad/s, a bound that is assumed because the model has none; [speed] of its "
        "limits.toml states the right one"
    ]


# A robot's content as a hash: included files, meshes, limits and servo map count, the place of its file does not.


def robot_sha256(robot: Robot) -> str:
    """Return the sha256 of the compiled model, of the limits of its hinges and of its servo map."""
    model = np.empty(mujoco.mj_sizeModel(robot.model), np.uint8)
    mujoco.mj_saveModel(robot.model, None, model)
    digest = hashlib.sha256(model.tobytes())
    for limit in (robot.lower, robot.upper, robot.max_speed, robot.max_torque):
        digest.update(np.asarray(limit).tobytes())
    digest.update(repr((robot.name, robot.joint_names, robot.servo_map)).encode())
    return digest.hexdigest()
