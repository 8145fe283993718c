"""Shapes of bodies, in metres: whole edge lengths and diameters, not halves."""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.base.arrays import Floats, Ints, frozen
from robot_retarget.base.errors import SceneError


class ShapeKind(StrEnum):
    """The kinds of shapes."""

    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    PLANE = "plane"
    MESH = "mesh"
    HEIGHT_FIELD = "height field"


EDGES = {ShapeKind.BOX: 3, ShapeKind.CYLINDER: 2, ShapeKind.SPHERE: 1, ShapeKind.PLANE: 0}
"""Count of lengths in the definition of a shape's size: length, width and height of a box; diameter and height of a
cylinder; diameter of a sphere."""


@dataclass(frozen=True, eq=False)
class BodyShape:
    """A shape in its body's frame. Boxes, cylinders and spheres are centred; a plane is z = 0, the body below it.

    Contacts and distances treat a mesh as its convex hull.
    """

    kind: ShapeKind
    size: Floats
    """(3,) box around it [m]; 0 for a plane."""
    vertices: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """(V, 3) of a mesh [m]."""
    faces: Ints = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    """(F, 3) indices of vertices of a mesh, counter-clockwise from outside."""
    heights: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(R, C) of a height field over a centred rectangle, rows along y, columns along x [m]."""

    def __post_init__(self) -> None:
        for name, dtype in (("size", float), ("vertices", float), ("faces", np.int64), ("heights", float)):
            object.__setattr__(self, name, frozen(getattr(self, name), dtype))

    def scaled(self, scale: float) -> "BodyShape":
        """Return the shape with all lengths multiplied by a scale."""
        return replace(self, size=scale * self.size, vertices=scale * self.vertices, heights=scale * self.heights)

    def mirrored(self) -> "BodyShape":
        """Return the mirror image in the plane y = 0."""
        vertices = self.vertices * [1.0, -1.0, 1.0]
        return replace(self, vertices=vertices, faces=self.faces[:, ::-1], heights=self.heights[::-1])

    @cached_property
    def corners(self) -> Floats:
        """(P, 3) points whose convex hull holds the shape, in the body's frame [m]; the origin alone of a plane."""
        if self.kind is ShapeKind.MESH:
            with suppress(QhullError, ValueError):  # a flat mesh has no hull
                return self.vertices[ConvexHull(self.vertices).vertices]
            return self.vertices
        signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        if self.kind is ShapeKind.HEIGHT_FIELD:
            return signs * [*self.size[:2], 0.0] + np.outer(signs[:, 2] + 0.5, [0, 0, self.size[2]])
        return np.zeros((1, 3)) if self.kind is ShapeKind.PLANE else signs * self.size

    @property
    def volume(self) -> float:
        """Volume enclosed by the shape [m³]; 0 of planes and height fields."""
        length, width, height = self.size.tolist()
        match self.kind:
            case ShapeKind.BOX:
                return length * width * height
            case ShapeKind.CYLINDER:
                return np.pi / 4 * length * width * height
            case ShapeKind.SPHERE:
                return np.pi / 6 * length**3
            case ShapeKind.MESH:
                a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
                return abs(float((a * np.cross(b, c)).sum())) / 6
            case _:
                return 0.0

    @property
    def open_edges(self) -> int:
        """Number of edges of a mesh that do not join exactly two faces; 0 of a closed mesh and of any other shape."""
        _, index = np.unique(self.vertices.round(6), axis=0, return_inverse=True)
        faces = index.ravel()[self.faces]
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        return int((np.unique(edges, axis=0, return_counts=True)[1] != 2).sum())


def solid(kind: ShapeKind, size: tuple[float, ...]) -> BodyShape:
    """Return a box, cylinder, sphere or plane.

    Args:
        kind: of the shape.
        size: as many lengths as `EDGES` states [m].

    Raises:
        SceneError: another number of lengths, or one that is not positive.
    """
    if len(size) != EDGES[kind] or not all(0 < edge < np.inf for edge in size):
        raise SceneError(f"a {kind} has {EDGES[kind]} positive lengths as its size, got {list(size)}")
    length, width, height = {0: (0, 0, 0), 1: size * 3, 2: (size[0], *size) if len(size) == 2 else (), 3: size}[
        len(size)
    ]
    return BodyShape(kind, np.array([length, width, height], dtype=float))


def mesh(vertices: Floats, faces: Ints) -> BodyShape:
    """Return a mesh of vertices (V, 3) [m] and faces (F, 3)."""
    return BodyShape(ShapeKind.MESH, np.ptp(vertices, axis=0), vertices, faces)


def height_field(heights: Floats, length: float, width: float) -> BodyShape:
    """Return a height field (R, C) over a rectangle `length` along x and `width` along y [m].

    Raises:
        SceneError: fewer than two rows or columns, a height below 0, or a length that is not positive.
    """
    heights = np.asarray(heights, dtype=float)
    if heights.ndim != 2 or min(heights.shape) < 2 or not np.isfinite(heights).all() or heights.min() < 0:
        raise SceneError("a height field has 2 or more rows and columns of heights of 0 or more")
    if not (0 < length < np.inf and 0 < width < np.inf):
        raise SceneError(f"a height field has a positive length and width, got {length:g} and {width:g}")
    return BodyShape(ShapeKind.HEIGHT_FIELD, np.array([length, width, heights.max()]), heights=heights)
