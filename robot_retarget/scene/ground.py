"""The ground on which a robot stands: the floor z = 0 and the surfaces of the bodies at rest."""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.scene.geoms import SceneModel
from robot_retarget.scene.scene import Scene

SUNK = 0.02
"""Surfaces up to this height over a sole are under it: it sinks in a little [m]."""
SIDE = 5
"""Points along each side of a sole that find its part on a surface that is smaller ..."""
HALVINGS = 6
"""... whose edge is found by halving the way between them: a millimetre on a sole of 25 cm."""
REST = 0.003
"""Points this much higher than the lowest one rest on the ground as well [m]."""
SAME = 4
"""Soles that agree to this number of decimals stand alike [m]."""


@dataclass(frozen=True, eq=False)
class SolidGround:
    """The floor and the bodies at rest; bodies that move carry no feet."""

    scene: Scene | None = None
    _known: dict[bytes, tuple[Floats, Floats, Floats]] = field(default_factory=dict, repr=False)

    @cached_property
    def _model(self) -> SceneModel | None:
        bodies = () if self.scene is None else tuple(body for body in self.scene.bodies if body.fixed)
        return SceneModel(replace(self.scene, bodies=bodies)) if self.scene and bodies else None

    @property
    def level(self) -> bool:
        """Whether there is nothing but the floor."""
        return self._model is None

    def under(self, points: Floats, above: float = SUNK) -> tuple[Floats, Floats]:
        """Return heights (T, K) [m] and upward normals (T, K, 3) of the ground under points.

        Args:
            points: (T, K, 3) [m].
            above: surfaces up to this height over a point are under it [m].
        """
        if self._model is None:
            return np.zeros(points.shape[:2]), np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        heights, normals, _ = self._model.heights(points, self._model.scene.poses(len(points)), above)
        return heights, normals

    def over(self, points: Floats, above: float = SUNK) -> Floats:
        """Return heights (T, K) of points (T, K, 3) over the ground under them [m]; `above` as in `under`."""
        return points[..., 2] - self.under(points, above)[0]

    def plane(self, points: Floats, above: float) -> tuple[Floats, Floats]:
        """Return a point (3,) [m] and the normal (3,) of the surface on which points (P, 3) stand: under them, that nearest in height.

        Args:
            points: of a sole [m].
            above: surfaces up to this height over them are under them [m].
        """
        heights, normals = (found[0] for found in self.under(points[None], above))
        nearest = int(np.abs(heights - points[:, 2].mean()).argmin())
        return np.append(points[nearest, :2], heights[nearest]), normals[nearest]

    def footing(self, sole: Floats) -> tuple[Floats, Floats, Floats]:
        """Return points (P, 3) that span the part of a sole on the ground [m], their heights over it (P,) [m] and its normals (P, 3).

        On the floor they are the corners. Elsewhere the sole may be larger than what it stands on.

        Args:
            sole: (4, 3) corners [m].
        """
        if self.level:
            return sole, sole[:, 2], np.broadcast_to([0.0, 0.0, 1.0], sole.shape)
        key = sole.round(SAME).tobytes()
        if key not in self._known:
            self._known[key] = self._footing(sole)
        return self._known[key]

    def _footing(self, sole: Floats) -> tuple[Floats, Floats, Floats]:
        points = filled(sole)
        heights = self.over(points[None])[0]
        highest = float(heights.min()) + REST
        edge = self._edge(points.reshape(SIDE, SIDE, 3), (heights < highest).reshape(SIDE, SIDE), highest)
        points = np.concatenate([points[heights < highest], edge])
        with suppress(QhullError, ValueError):  # a point or a line has no hull
            points = points[ConvexHull(points[:, :2]).vertices]
        under, normals = (found[0] for found in self.under(points[None]))
        return points, points[:, 2] - under, normals

    def _edge(self, points: Floats, rests: Bools, highest: float) -> Floats:
        """Return the last resting points (E, 3) between neighbours (SIDE, SIDE, 3) of which one rests: under `highest` over the ground [m]."""
        pairs = [
            (points[:-1], points[1:], rests[:-1], rests[1:]),
            (points[:, :-1], points[:, 1:], rests[:, :-1], rests[:, 1:]),
        ]
        inner = np.concatenate([np.where(a[..., None], p, q)[a != b] for p, q, a, b in pairs])
        outer = np.concatenate([np.where(a[..., None], q, p)[a != b] for p, q, a, b in pairs])
        for _ in range(HALVINGS if len(inner) else 0):
            middle = (inner + outer) / 2
            stands = (self.over(middle[None])[0] < highest)[:, None]
            inner, outer = np.where(stands, middle, inner), np.where(stands, outer, middle)
        return inner


def filled(soles: Floats) -> Floats:
    """Return (…, SIDE², 3) points in rows over soles (…, 4, 3), whose corners are front left, front right, rear left, rear right."""
    front, left = (share.ravel() for share in np.meshgrid(*2 * [np.linspace(0.0, 1.0, SIDE)], indexing="ij"))
    shares = np.stack([front * left, front * (1 - left), (1 - front) * left, (1 - front) * (1 - left)], axis=1)
    return shares @ soles
