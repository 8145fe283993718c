"""Where K spheres of K-dimensional space meet: at most two points, mirror images in the plane of the centres."""

import numpy as np

from robot_retarget.base.arrays import Floats


def intersect(centres: Floats, radii: Floats, tolerance: float = 1e-9) -> Floats:
    """The points x with ‖x − c_m‖ = r_m, m = 1 … K.

    Subtracting the first equation leaves K − 1 planes, which meet in a line; the line meets the first sphere at
    s² = r_1² − ‖y‖². A negative s² down to −tolerance · r_1² counts as touching.

    Args:
        centres: (…, K, K), one centre a row, K = 2 or 3 [m].
        radii: (…, K) [m].
        tolerance: relative slack of a touching pair.

    Returns:
        (2, …, K) [m]; NaN where the spheres do not meet or the centres do not span a hyperplane.
    """
    origin, spans = centres[..., 0, :], centres[..., 1:, :] - centres[..., :1, :]
    r, others = radii[..., :1], radii[..., 1:]
    known = (r**2 - others**2 + (spans**2).sum(-1)) / 2.0
    normal = _normal(spans)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = normal / length
        square = np.concatenate([spans, normal[..., None, :]], axis=-2)
        flat = ~(length[..., 0] > 1e-12 * (spans**2).sum((-1, -2)))
        square[flat] = np.eye(square.shape[-1])
        along = np.concatenate([known, np.zeros_like(r)], axis=-1)
        foot = np.linalg.solve(square, along[..., None])[..., 0]
        height = r[..., 0] ** 2 - (foot**2).sum(-1)
        height = np.where((height < 0) & (height >= -tolerance * r[..., 0] ** 2), 0.0, height)
        rise = np.sqrt(height)[..., None] * normal
    rise[flat] = np.nan
    return np.stack([origin + foot + rise, origin + foot - rise])


def _normal(spans: Floats) -> Floats:
    """Perpendicular to K − 1 vectors (…, K − 1, K); its length is the area they span."""
    if spans.shape[-1] == 2:
        return np.stack([-spans[..., 0, 1], spans[..., 0, 0]], axis=-1)
    return np.cross(spans[..., 0, :], spans[..., 1, :])
