"""The support of a robot: the convex hull of the points that carry it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from robot_retarget.arrays import Floats


@dataclass(frozen=True)
class Polygon:
    """A convex support {x : A x ≤ b}, b shrunk towards its middle."""

    normals: Floats
    """(E, 2) outward unit normals."""
    bounds: Floats
    """(E,) [m]."""
    middle: Floats
    """(2,) [m]."""

    def shrunk(self, keep: float) -> "Polygon":
        """Return the same shape, scaled by `keep` about its middle."""
        inner = self.normals @ self.middle
        return Polygon(self.normals, inner + keep * (self.bounds - inner), self.middle)

    def margin(self, point: Floats) -> float:
        """Return the distance of a point (2,) inside the edges, negative outside [m]."""
        return float((self.bounds - self.normals @ point).min())


def support(corners: Floats) -> Polygon:
    """Return the convex hull of points (N, 3) or (N, 2) on the floor [m]."""
    flat = corners[:, :2]
    hull = ConvexHull(flat)
    vertices = flat[hull.vertices]
    edges, area = _unique(hull.equations), hull.volume
    turned = np.roll(vertices, -1, axis=0)
    cross = vertices[:, 0] * turned[:, 1] - turned[:, 0] * vertices[:, 1]
    middle = ((vertices + turned) * cross[:, None]).sum(0) / (6 * area)
    return Polygon(edges[:, :2], -edges[:, 2], middle)


def _unique(equations: Floats) -> Floats:
    """Return the edges of a hull, without edges collinear with their neighbour."""
    rounded = np.round(equations, 9)
    return equations[np.sort(np.unique(rounded, axis=0, return_index=True)[1])]
