"""The world around a human: rigid bodies with a shape and a pose over time, and their arrays in a trajectory file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.errors import SceneError
from robot_retarget.base.untrusted.arrays import Field
from robot_retarget.base.untrusted.rotations import UNIT_NORM
from robot_retarget.scene.shape import BodyShape, ShapeKind

IDENTITY = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""Pose of the world: x y z, quaternion w x y z."""
DENSITY = 100.0
"""Density of a body without a stated mass [kg/m³]: a carton of 40 × 30 × 30 cm weighs 3.6 kg."""
FRICTION = 0.9
"""Sliding friction of a body that states none, that of carton or wood on rubber [-]."""


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A rigid body. It is fixed, moves along poses in time, or is carried by a joint of the motion."""

    name: str
    shape: BodyShape
    poses: Floats = field(default_factory=lambda: frozen(IDENTITY))
    """(7,) pose of a fixed body, or (T, 7) poses over time: x y z [m], quaternion w x y z. With a carrier the pose (7,)
    relative to the joint."""
    fps: float | None = None
    """Rate of the poses [1/s]; None takes the motion's."""
    carrier: str = ""
    """The joint of the motion that carries the body; empty without."""
    mass: float | None = None
    """[kg]; None derives it from the volume (`DENSITY`)."""
    friction: float = FRICTION
    """[-]"""
    source: str = ""
    """The file and line that state the body, for messages; empty without."""

    def __post_init__(self) -> None:
        poses = frozen(self.poses)
        if poses.shape[-1:] != (7,) or poses.ndim > 2 or not poses.size:
            raise SceneError(f"{self.title}: poses are (7,) or (T, 7), got {poses.shape}")
        table = np.atleast_2d(poses)
        lost = np.flatnonzero(~np.isfinite(table).all(axis=1))
        if lost.size:
            raise SceneError(f"{self.title} has no pose at frame {lost[0]} ({lost.size} of {len(table)} frames)")
        norms = np.linalg.norm(table[:, 3:], axis=1)
        wrong = np.flatnonzero(np.abs(norms - 1) > UNIT_NORM)
        if wrong.size:
            raise SceneError(
                f"{self.title}: the quaternion at frame {wrong[0]} has the norm {norms[wrong[0]]:.4g}, not 1: "
                "expected x y z, then w x y z"
            )
        same = np.where((table[1:, 3:] * table[:-1, 3:]).sum(axis=1) < 0, -1.0, 1.0)  # q and −q are one rotation
        turns = table[:, 3:] * np.cumprod([1.0, *same])[:, None] / norms[:, None]
        table = np.concatenate([table[:, :3], turns], axis=1)
        object.__setattr__(self, "poses", frozen(table.reshape(poses.shape)))
        for name, value in (("mass", self.mass), ("friction", self.friction), ("fps", self.fps)):
            if value is not None and not 0 < value < np.inf:
                raise SceneError(f"{self.title}: {name} is a positive number, got {value}")

    @property
    def title(self) -> str:
        """The body in a message, with its file and line."""
        return f"{self.source}: body {self.name!r}" if self.source else f"body {self.name!r}"

    def __str__(self) -> str:
        size = " × ".join(f"{edge:.3g}" for edge in self.shape.size)
        return f"{self.name} ({self.shape.kind}{f', {size} m' if self.shape.size.any() else ''}, {'at rest' if self.fixed else 'moves'})"

    @property
    def fixed(self) -> bool:
        """Whether the body never moves."""
        return self.poses.ndim == 1 and not self.carrier

    @property
    def weight(self) -> float:
        """Mass [kg]: the stated one, or that of its volume."""
        return self.mass if self.mass is not None else max(DENSITY * self.shape.volume, 1e-3)

    def at(self, frames: slice | np.ndarray) -> "RigidBody":
        """Return the body at some frames."""
        return self if self.poses.ndim == 1 else replace(self, poses=self.poses[frames])

    def resampled(self, frames: Floats) -> "RigidBody":
        """Return the body at fractional frames (N,), interpolated; the ends are held beyond them."""
        return self if self.poses.ndim == 1 else replace(self, poses=interpolated(self.poses, frames))


@dataclass(frozen=True, eq=False)
class Scene:
    """Bodies with different names. z points up and z = 0 is the floor."""

    bodies: tuple[RigidBody, ...]
    source: str = ""
    notes: tuple[str, ...] = ()
    scale: float | None = None
    """Size around the robot over the captured size [-]; None scales bodies with the human."""
    world: tuple[float, float, float] | None = None
    """r [-] and o [m] of the map y = r (x − o) from the human's floor to the robot's, once it is chosen."""

    def __post_init__(self) -> None:
        if self.scale is not None and not 0 < self.scale < np.inf:
            raise SceneError(f"the scale of a scene is a positive number, got {self.scale}")
        twice = next((body for k, body in enumerate(self.bodies) if body.name in self.names[:k]), None)
        if twice is not None:
            raise SceneError(f"{twice.title}: another body has this name")

    def __len__(self) -> int:
        return len(self.bodies)

    def __repr__(self) -> str:
        return f"<Scene {self.source or 'made'}: {', '.join(f'{b.name} ({b.shape.kind})' for b in self.bodies)}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return tuple(body.name for body in self.bodies)

    @property
    def frames(self) -> int | None:
        """Number of frames T of the moving bodies; None of a scene at rest."""
        return next((len(body.poses) for body in self.bodies if body.poses.ndim == 2), None)

    def poses(self, frames: int) -> Floats:
        """Return (T, B, 7) poses of all bodies over T frames [m]; of a scene without carriers."""
        shape = (frames, len(self.bodies), 7)
        every = [np.broadcast_to(body.poses, (frames, 7)) for body in self.bodies]
        return np.stack(every, axis=1) if every else np.zeros(shape)

    def at(self, frames: slice | np.ndarray) -> "Scene":
        """Return the scene at some frames."""
        return replace(self, bodies=tuple(body.at(frames) for body in self.bodies))

    def mirrored(self, plane: tuple[Floats, Floats]) -> "Scene":
        """Return the mirror image of a scene without carriers in a plane: a point (3,) [m] and the unit normal (3,)."""
        bodies = []
        for body in self.bodies:
            poses = reflected(np.atleast_2d(body.poses), plane, np.array([0.0, 1.0, 0.0]))
            bodies.append(replace(body, shape=body.shape.mirrored(), poses=poses.reshape(body.poses.shape)))
        return replace(self, bodies=tuple(bodies), world=None)

    def resampled(self, frames: Floats) -> "Scene":
        """Return the scene at fractional frames (N,), interpolated; the ends are held beyond them."""
        return replace(self, bodies=tuple(body.resampled(frames) for body in self.bodies))


def reflected(poses: Floats, plane: tuple[Floats, Floats], left: Floats) -> Floats:
    """Return poses (T, 7) mirrored in a plane: R ↦ M R m.

    Args:
        plane: a point (3,) and the unit normal (3,).
        left: (3,) unit normal of the plane, in the axes of the body, in which it is its own mirror image.
    """
    place, across = plane
    mirror, own = (np.eye(3) - 2 * np.outer(normal, normal) for normal in (across, left))
    turned = mirror @ Rotation.from_quat(np.array(poses[:, 3:]), scalar_first=True).as_matrix() @ own
    places = place + (poses[:, :3] - place) @ mirror
    return np.concatenate([places, Rotation.from_matrix(turned).as_quat(scalar_first=True)], axis=1)


def interpolated(poses: Floats, frames: Floats) -> Floats:
    """Return poses (T, 7) at fractional frames (N,): positions linearly, rotations along the shortest way."""
    at, known = np.clip(frames, 0, len(poses) - 1), np.arange(len(poses))
    places = np.stack([np.interp(at, known, poses[:, k]) for k in range(3)], axis=1)
    if len(poses) == 1:
        return np.concatenate([places, np.repeat(poses[:, 3:], len(at), axis=0)], axis=1)
    turns = Slerp(known, Rotation.from_quat(poses[:, 3:], scalar_first=True))(at)
    return np.concatenate([places, turns.as_quat(scalar_first=True)], axis=1)


def extrapolated(before: Floats, now: Floats, steps: Floats) -> Floats:
    """Return poses (N, B, 7) of bodies that continue with the step from poses `before` to `now` (B, 7), `steps` (N,) from now."""
    first, last = (Rotation.from_quat(np.array(poses[:, 3:]), scalar_first=True) for poses in (before, now))
    way, turn = now[:, :3] - before[:, :3], (last * first.inv()).as_rotvec()
    places = now[:, :3] + steps[:, None, None] * way
    turned = (
        Rotation.from_rotvec((steps[:, None, None] * turn).reshape(-1, 3)).as_matrix().reshape(len(steps), -1, 3, 3)
    )
    turns = Rotation.from_matrix((turned @ last.as_matrix()).reshape(-1, 3, 3)).as_quat(scalar_first=True)
    return np.concatenate([places, turns.reshape(len(steps), -1, 4)], axis=2)


def composed(outer: Floats, inner: Floats) -> Floats:
    """Return the poses (…, 7) of bodies with poses `inner` relative to frames with poses `outer`."""
    shape = np.broadcast_shapes(outer.shape, inner.shape)
    carrier, carried = (np.array(np.broadcast_to(poses, shape)).reshape(-1, 7) for poses in (outer, inner))
    turn, own = (Rotation.from_quat(poses[:, 3:], scalar_first=True) for poses in (carrier, carried))
    place = carrier[:, :3] + turn.apply(carried[:, :3])
    return np.concatenate([place, (turn * own).as_quat(scalar_first=True)], axis=1).reshape(shape)


def inverse(poses: Floats) -> Floats:
    """Return the poses (N, 7) of the world relative to bodies with poses (N, 7)."""
    turn = Rotation.from_quat(np.array(poses[:, 3:]), scalar_first=True).inv()
    return np.concatenate([-turn.apply(np.array(poses[:, :3])), turn.as_quat(scalar_first=True)], axis=1)


def as_pose(points: Floats) -> Floats:
    """Return the poses (N, 7) of points (N, 3) without rotation [m]."""
    return np.concatenate([points, np.broadcast_to(IDENTITY[3:], (len(points), 4))], axis=1)


def world_corners(body: RigidBody, poses: Floats) -> Floats:
    """Return (T, P, 3) corners of a body at poses (T, 7) [m]."""
    turn = Rotation.from_quat(poses[:, 3:], scalar_first=True).as_matrix()
    return poses[:, None, :3] + body.shape.corners @ turn.swapaxes(1, 2)


FIELDS = {
    "scene_names": Field("text", ("B",), required=False),
    "scene_shapes": Field("text", ("B",), required=False),
    "scene_sizes": Field("number", ("B", 3), required=False),
    "scene_poses": Field("number", ("T", "B", 7), required=False),
    "scene_fixed": Field("integer", ("B",), bounds=(0, 1), required=False),
    "scene_mass": Field("number", ("B",), required=False),
    "scene_friction": Field("number", ("B",), required=False),
    "scene_vertices": Field("number", ("V", 3), required=False),
    "scene_faces": Field("integer", ("F", 3), required=False),
    "scene_heights": Field("number", ("H",), required=False),
    "scene_counts": Field("integer", ("B", 4), required=False),
    "scene_scale": Field("number", bounds=(0, np.inf), required=False),
    "scene_world": Field("number", (3,), required=False),
}
"""Of the trajectory file: per body its name, shape, edges [m], poses, whether it is fixed, mass [kg] and friction; the vertices,
faces and heights of all bodies one after the other, and per body the numbers of vertices, faces, rows and columns; and the size over
the captured one, 0 or absent for bodies that are scaled with the human, and the map from the human's floor, 0 or absent if unknown."""
OPTIONAL = ("scene_scale", "scene_world")
"""Fields that older files lack."""


def arrays_of(scene: Scene, frames: int) -> dict[str, Any]:
    """Return the arrays of a scene whose moving bodies have poses at every frame."""
    bodies, shapes = scene.bodies, [body.shape for body in scene.bodies]
    return {
        "scene_names": np.array(scene.names, dtype=np.str_),
        "scene_shapes": np.array([str(shape.kind) for shape in shapes], dtype=np.str_),
        "scene_sizes": np.array([shape.size for shape in shapes]).reshape(-1, 3),
        "scene_poses": scene.poses(frames),
        "scene_fixed": np.array([body.fixed for body in bodies], dtype=np.int64),
        "scene_mass": np.array([body.weight for body in bodies]),
        "scene_friction": np.array([body.friction for body in bodies]),
        "scene_vertices": np.concatenate([np.zeros((0, 3)), *(shape.vertices for shape in shapes)]),
        "scene_faces": np.concatenate([np.zeros((0, 3), np.int64), *(shape.faces for shape in shapes)]),
        "scene_heights": np.concatenate([np.zeros(0), *(shape.heights.ravel() for shape in shapes)]),
        "scene_counts": np.array([[len(s.vertices), len(s.faces), *s.heights.shape] for s in shapes]).reshape(-1, 4),
        "scene_scale": scene.scale or 0.0,
        "scene_world": np.array(scene.world or (0.0, 0.0, 0.0)),
    }


def scene_from(values: Mapping[str, Any]) -> Scene | None:
    """Return the scene of the fields of a file; None without one.

    Raises:
        SceneError: a field is missing, a shape is unknown, or the numbers of a mesh do not fit.
    """
    if "scene_names" not in values:
        return None
    missing = next((name for name in FIELDS if name not in (*values, *OPTIONAL)), None)
    if missing is not None:
        raise SceneError(f"no key {missing!r}, which belongs to a scene")
    counts, poses = values["scene_counts"], np.asarray(values["scene_poses"], float)
    starts = np.concatenate([np.zeros((1, 3), int), np.cumsum(_numbers(counts), axis=0)])
    if (counts < 0).any() or starts[-1].tolist() != [
        len(values[f"scene_{k}"]) for k in ("vertices", "faces", "heights")
    ]:
        raise SceneError("scene_counts does not fit the vertices, faces and heights")
    shapes = [_shape(values, k, starts[k], counts[k]) for k in range(len(counts))]
    bodies = tuple(_body(values, poses, k, shape) for k, shape in enumerate(shapes))
    ratio, x, y = map(float, values.get("scene_world", (0.0, 0.0, 0.0)))
    return Scene(
        bodies, scale=float(values.get("scene_scale", 0.0)) or None, world=(ratio, x, y) if ratio > 0 else None
    )


def _numbers(counts: np.ndarray) -> np.ndarray:
    """Return (B, 3) numbers of vertices, faces and heights."""
    return np.stack([counts[:, 0], counts[:, 1], counts[:, 2] * counts[:, 3]], axis=1)


def _shape(values: Mapping[str, Any], body: int, start: np.ndarray, counts: np.ndarray) -> BodyShape:
    kind = str(values["scene_shapes"][body])
    if kind not in list(ShapeKind):
        raise SceneError(f"scene_shapes has the unknown shape {kind!r}")
    vertices, faces, rows, columns = counts.tolist()
    own = values["scene_faces"][start[1] : start[1] + faces]
    if own.size and (own.min() < 0 or own.max() >= vertices):
        raise SceneError(f"scene_faces of body {body} name vertices that it has not")
    return BodyShape(
        ShapeKind(kind),
        values["scene_sizes"][body],
        values["scene_vertices"][start[0] : start[0] + vertices],
        own,
        values["scene_heights"][start[2] : start[2] + rows * columns].reshape(rows, columns),
    )


def _body(values: Mapping[str, Any], poses: Floats, body: int, shape: BodyShape) -> RigidBody:
    own = poses[0, body] if values["scene_fixed"][body] else poses[:, body]
    mass, friction = float(values["scene_mass"][body]), float(values["scene_friction"][body])
    return RigidBody(str(values["scene_names"][body]), shape, own, mass=mass, friction=friction)
