"""The one forward kinematics: CasADi expressions of an MJCF's body frames and of points fixed to them.

A configuration q is moved by a tangent vector v of MuJoCo's velocity space, q ⊕ v (`mj_integratePos` over one
second): free joints translate in the world frame and turn in their own, single joints add. Every function takes q and
differentiates by v, so that quaternions need no special care anywhere else.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints, frozen
from robot_retarget.robot.model import FREE, HINGE, Robot

MANY = 24
"""Number of configurations from which arrays move them faster than calls of MuJoCo do."""
POSED = 1024
"""Frames whose bodies are placed at once: 2.3 MB of places and quaternions for 40 bodies."""


@dataclass(frozen=True)
class Points:
    """Points fixed to bodies."""

    bodies: Ints
    """(P,) body ids."""
    offsets: Floats
    """(P, 3) in the body's frame [m]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", frozen(self.bodies, np.int64))
        object.__setattr__(self, "offsets", frozen(np.reshape(self.offsets, (-1, 3))))

    def __len__(self) -> int:
        return len(self.bodies)


def body_frames(robot: Robot, qpos: Floats) -> tuple[Floats, Floats]:
    """World positions (T, B, 3) [m] and rotations (T, B, 3, 3) of every body at qpos (T, nq), by MuJoCo.

    Args:
        qpos: (T, nq) configurations.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    positions, rotations = np.empty((len(qpos), model.nbody, 3)), np.empty((len(qpos), model.nbody, 3, 3))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        positions[t], rotations[t] = data.xpos, data.xmat.reshape(-1, 3, 3)
    return positions, rotations


def world_points(robot: Robot, points: Points, qpos: Floats) -> Floats:
    """World positions (T, P, 3) [m] of points at qpos (T, nq).

    Args:
        points: points fixed to bodies.
        qpos: (T, nq) configurations.
    """
    places = np.empty((len(qpos), len(points), 3))
    for first in range(0, len(qpos), POSED):
        block = slice(first, first + POSED)
        positions, rotations = body_frames(robot, qpos[block])
        turned = np.einsum("tpij,pj->tpi", rotations[:, points.bodies], points.offsets)
        places[block] = positions[:, points.bodies] + turned
    return places


class PlacedPoints:
    """World positions of points at one configuration after the other, with memory that is allocated once."""

    def __init__(self, robot: Robot, points: Points):
        self._model, self._data = robot.model, mujoco.MjData(robot.model)
        self._origins, self._turns = self._data.xpos, self._data.xmat.reshape(-1, 3, 3)
        self._bodies, self._offsets = points.bodies, points.offsets[..., None]

    def at(self, qpos: Floats) -> Floats:
        """Return the positions (P, 3) at a configuration (nq,) [m]."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        turned = self._turns.take(self._bodies, axis=0) @ self._offsets
        return self._origins.take(self._bodies, axis=0) + turned[..., 0]


def mass_function(robot: Robot) -> ca.Function:
    """q (nq) ↦ the centre of mass of the robot  Σ m_b c_b / Σ m_b  (3) [m] and its Jacobian by v (3, nv)."""
    bodies = Bodies(robot)
    return bodies.function("mass", list(mass_shares(robot, bodies)))


def heavy_bodies(robot: Robot) -> Ints:
    """Return the bodies of the robot that have masses."""
    model = robot.model
    return np.flatnonzero((model.body_rootid == model.body_rootid[robot.root_body]) & (model.body_mass > 0))


def mass_shares(robot: Robot, bodies: "Bodies") -> tuple[ca.SX, ca.SX]:
    """The centre of mass (3) [m] and its Jacobian by v (3, nv), as expressions of the bodies' q.

    Args:
        bodies: the robot's bodies as expressions.
    """
    model, heavy = robot.model, heavy_bodies(robot)
    shares = model.body_mass[heavy] / model.body_mass[heavy].sum()
    centres = bodies.places(Points(heavy, model.body_ipos[heavy]))
    carried = carrying(model)[heavy] * shares[:, None]
    share = carried.sum(axis=0)
    columns = [
        share[dof] * bodies.velocity(dof, centres @ ca.DM(carried[:, dof] / share[dof])) if share[dof] else ca.SX(3, 1)
        for dof in range(model.nv)
    ]
    return centres @ ca.DM(shares), ca.horzcat(*columns)


class Bodies:
    """The bodies of a robot as CasADi expressions of q, and the motion of points and directions per dof.

    With unit rate of its dof, a hinge about the axis a through the anchor c moves a point x by a × (x − c) and turns a
    direction e by a × e; a slide moves points by a.
    """

    model: mujoco.MjModel
    q: ca.SX

    def __init__(self, robot: Robot):
        self.model, self.q = robot.model, ca.SX.sym("q", robot.model.nq)
        self.axes = [ca.SX(3, 1)] * self.model.nv
        """Axis of each dof."""
        self.anchors: list[ca.SX | None] = [None] * self.model.nv
        """None for a slide."""
        self.frames: list[tuple[ca.SX, ca.SX]] = [(ca.SX.zeros(3), ca.SX.eye(3))]
        """Position and rotation of each."""
        for body in range(1, self.model.nbody):
            self.frames.append(self._body(body))

    def places(self, points: Points) -> ca.SX:
        """(3, P) where points are [m]."""
        origins = [self.frames[body][0] for body in points.bodies.tolist()]
        return ca.horzcat(ca.SX(3, 0), *origins) + self.directions(points.bodies, points.offsets)

    def directions(self, bodies: Ints, vectors: Floats) -> ca.SX:
        """(3, D) vectors (D, 3) fixed to bodies (D,)."""
        turned = [self.frames[body][1] @ ca.DM(e) for body, e in zip(bodies.tolist(), vectors, strict=True)]
        return ca.horzcat(ca.SX(3, 0), *turned)

    def velocity(self, dof: int, x: ca.SX) -> ca.SX:
        """(3, P) of points (3, P) that a dof carries, per its rate."""
        anchor = self.anchors[dof]
        if anchor is None:
            return ca.repmat(self.axes[dof], 1, x.shape[1])
        return self.turn(dof, x - ca.repmat(anchor, 1, x.shape[1]))

    def turn(self, dof: int, e: ca.SX) -> ca.SX:
        """(3, D) of directions (3, D) that a dof carries, per its rate."""
        return ca.skew(self.axes[dof]) @ e if self.anchors[dof] is not None else ca.SX(*e.shape)

    def travel(self, x: ca.SX, carried: np.ndarray) -> ca.SX:
        """(3P, nv) the Jacobian of points (3, P) carried by dofs (P, nv), x y z one point after the other.

        Args:
            x: (3, P) points [m].
            carried: (P, nv) whether a dof moves a point.
        """
        return self._columns(self.velocity, x, carried)

    def turning(self, e: ca.SX, carried: np.ndarray) -> ca.SX:
        """(3D, nv) that of directions (3, D)."""
        return self._columns(self.turn, e, carried)

    def function(self, name: str, outputs: list[ca.SX]) -> ca.Function:
        """q ↦ expressions."""
        return ca.Function(name, [self.q], outputs)

    def _columns(self, moved: Callable[[int, ca.SX], ca.SX], vectors: ca.SX, carried: np.ndarray) -> ca.SX:
        jacobian = ca.SX(vectors.numel(), self.model.nv)
        for dof in range(self.model.nv):
            own = np.flatnonzero(carried[:, dof])
            if own.size:
                rows = (3 * own[:, None] + np.arange(3)).ravel().tolist()
                jacobian[rows, dof] = ca.vec(moved(dof, vectors[:, own.tolist()]))
        return ca.sparsify(jacobian)

    def _body(self, body: int) -> tuple[ca.SX, ca.SX]:
        model = self.model
        position, rotation = self.frames[int(model.body_parentid[body])]
        position = position + rotation @ ca.DM(model.body_pos[body])
        rotation = rotation @ ca.DM(_matrix(tuple(model.body_quat[body])))
        for joint in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
            position, rotation = self._moved(joint, position, rotation)
        return position, rotation

    def _moved(self, joint: int, position: ca.SX, rotation: ca.SX) -> tuple[ca.SX, ca.SX]:
        """A body frame carried on by one of its joints, whose axes are noted."""
        model, a, d = self.model, int(self.model.jnt_qposadr[joint]), int(self.model.jnt_dofadr[joint])
        if model.jnt_type[joint] == FREE:
            position, rotation = self.q[a : a + 3], _quaternion(self.q[a + 3 : a + 7])
            self.axes[d : d + 6] = [*ca.horzsplit(ca.SX.eye(3)), *ca.horzsplit(rotation)]
            self.anchors[d + 3 : d + 6] = [position] * 3
            return position, rotation
        step, anchor = self.q[a] - float(model.qpos0[a]), position + rotation @ ca.DM(model.jnt_pos[joint])
        self.axes[d] = rotation @ ca.DM(model.jnt_axis[joint])
        if model.jnt_type[joint] != HINGE:
            return position + self.axes[d] * step, rotation
        self.anchors[d] = anchor
        turned = rotation @ _about(ca.DM(model.jnt_axis[joint]), step)
        return anchor - turned @ ca.DM(model.jnt_pos[joint]), turned


def integrate(robot: Robot, qpos: Floats, velocity: Floats) -> Floats:
    """q ⊕ v: configurations (…, nq) moved by tangent vectors (…, nv).

    Args:
        qpos: (…, nq) configurations.
        velocity: (…, nv) tangent vectors.
    """
    moved = np.array(qpos)
    if moved.ndim == 1:
        mujoco.mj_integratePos(robot.model, moved, velocity, 1.0)
        return moved
    if moved.size < MANY * robot.model.nq:
        rows = moved.reshape(-1, robot.model.nq), velocity.reshape(-1, robot.model.nv)
        for one, change in zip(*rows, strict=True):
            mujoco.mj_integratePos(robot.model, one, change, 1.0)
        return moved
    angles, rates = robot.single_index
    moved[..., angles] += velocity[..., rates]
    for q, v in robot.free_index:
        moved[..., q : q + 3] += velocity[..., v : v + 3]
        moved[..., q + 3 : q + 7] = _turned(moved[..., q + 3 : q + 7], velocity[..., v + 3 : v + 6])
    return moved


def tangent_names(robot: Robot) -> list[str]:
    """Return (nv,) names of the tangent directions: a hinge's name, or `root 0`, `root 1` …"""
    names = [f"root {k}" for k in range(robot.model.nv)]
    for dof, joint in zip(robot.dof_index, robot.joint_names, strict=True):
        names[dof] = joint
    return names


def difference(robot: Robot, start: Floats, end: Floats) -> Floats:
    """The tangent vectors (…, nv) that lead from configurations to others: start ⊕ v = end.

    Args:
        start: (…, nq) configurations, or one for all.
        end: (…, nq) configurations.
    """
    velocity = np.empty((*end.shape[:-1], robot.model.nv))
    if end.ndim == 1:
        mujoco.mj_differentiatePos(robot.model, velocity, 1.0, start, end)
        return velocity
    begins = np.broadcast_to(start, end.shape)
    if end.size < MANY * robot.model.nq:
        rows = velocity.reshape(-1, robot.model.nv), *(side.reshape(-1, robot.model.nq) for side in (begins, end))
        for change, before, after in zip(*rows, strict=True):
            mujoco.mj_differentiatePos(robot.model, change, 1.0, before, after)
        return velocity
    angles, rates = robot.single_index
    velocity[..., rates] = end[..., angles] - begins[..., angles]
    for q, v in robot.free_index:
        velocity[..., v : v + 3] = end[..., q : q + 3] - begins[..., q : q + 3]
        velocity[..., v + 3 : v + 6] = _turn(begins[..., q + 3 : q + 7], end[..., q + 3 : q + 7])
    return velocity


def _turned(quaternions: Floats, turn: Floats) -> Floats:
    """Return unit quaternions (…, 4), w x y z, turned about their own axes by rotation vectors (…, 3) [rad]."""
    half, step = _norm(turn) / 2, np.empty(quaternions.shape)
    step[..., 0], step[..., 1:] = np.cos(half), turn * (np.sinc(half / np.pi) / 2)[..., None]
    found = _bilinear(quaternions, step, PRODUCT)
    return found / _norm(found)[..., None]


def _turn(start: Floats, end: Floats) -> Floats:
    """Return the rotation vectors (…, 3) of at most half a turn that lead from quaternions (…, 4) to others [rad]."""
    way = _bilinear(start, end, QUOTIENT)
    sine = _norm(way[..., 1:])
    angle = 2 * np.arctan2(sine, way[..., 0])
    angle -= 2 * np.pi * (angle > np.pi)
    return way[..., 1:] * (angle / np.maximum(sine, np.finfo(float).tiny))[..., None]


def _bilinear(first: Floats, second: Floats, table: Floats) -> Floats:
    """(…, 4) the products of quaternions by a table (16, 4) of the products of units."""
    return (first[..., :, None] * second[..., None, :]).reshape(*first.shape[:-1], 16) @ table


def _norm(vectors: Floats) -> Floats:
    """Return the lengths (…) of vectors (…, n)."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def _products(conjugated: bool) -> Floats:
    """Return (16, 4) the product of every two quaternion units, the first of them conjugated or not."""
    table, units, found = np.empty((4, 4, 4)), np.eye(4), np.empty(4)
    for i, first in enumerate(units):
        left = first * ([1, -1, -1, -1] if conjugated else 1)
        for j, second in enumerate(units):
            mujoco.mju_mulQuat(found, left, second)
            table[i, j] = found
    return table.reshape(16, 4)


PRODUCT, QUOTIENT = _products(False), _products(True)
"""(16, 4) of p q, and of p⁻¹ q."""


def _about(axis: ca.DM, angle: ca.SX) -> ca.SX:
    """Rodrigues: the rotation by `angle` about a unit axis."""
    k = ca.skew(axis)
    return ca.SX.eye(3) + ca.sin(angle) * k + (1 - ca.cos(angle)) * (k @ k)


def _quaternion(wxyz: ca.SX) -> ca.SX:
    """The rotation of a quaternion, normalised as MuJoCo does."""
    unit = wxyz / ca.norm_2(wxyz)
    w, u = unit[0], unit[1:4]
    k = ca.skew(u)
    return ca.SX.eye(3) + 2 * w * k + 2 * (k @ k)


@lru_cache(maxsize=4096)
def _matrix(wxyz: tuple[float, ...]) -> Floats:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.array(wxyz))
    return matrix.reshape(3, 3)


def carrying(model: mujoco.MjModel) -> np.ndarray:
    """(B, nv) whether a dof moves a body."""
    table = np.zeros((model.nbody, model.nv), dtype=bool)
    for body in range(1, model.nbody):
        table[body] = table[model.body_parentid[body]]
        first = model.body_dofadr[body]
        table[body, first : first + model.body_dofnum[body]] = True
    return table


# The motion from one frame to the next, on which links must not pass through each other either.

CHECKED_TURN = 0.07
"""Largest change of a hinge between two checks of the links [rad]: the hand of an arm of 0.3 m, as the OP3 has it,
moves 2 cm."""


@dataclass(frozen=True)
class SweptConfiguration:
    """A configuration between this frame and a neighbour in time, at which links are kept apart as well."""

    neighbour: Floats
    share: float
    """Position between the two: 0 at the neighbour, 1 at this frame."""

    def at(self, robot: Robot, q: Floats) -> Floats:
        """Return the configuration (nq,) for a frame at q."""
        return integrate(robot, self.neighbour, self.share * difference(robot, self.neighbour, q))


def parts_between(robot: Robot, first: Floats, second: Floats) -> Ints:
    """Return (…) the number of equal parts of the way between configurations (…, nq), each below `CHECKED_TURN` in every hinge."""
    turn = np.abs(second - first)[..., robot.qpos_index].max(axis=-1, initial=0.0)
    return (turn / CHECKED_TURN).astype(np.int64) + 1


def swept_configurations(robot: Robot, neighbour: Floats, q: Floats) -> tuple[SweptConfiguration, ...]:
    """Return evenly spaced configurations between two frames, one at least, less than `CHECKED_TURN` apart in every hinge.

    Args:
        neighbour: (nq,) configuration of the neighbour in time.
        q: (nq,) configuration of the frame.
    """
    checks = int(parts_between(robot, neighbour, q))
    return tuple(SweptConfiguration(neighbour, k / (checks + 1)) for k in range(1, checks + 1))
