"""Rotations from files, checked before SciPy sees them: its matrices do not return from an infinite number."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import FileError

UNIT_NORM = 1e-3
"""Largest deviation of the norm of a unit quaternion from one [-]: single precision strays by 1e-7, the mean of frames 10° apart by 1e-3."""
LENGTHS = (0.5, 2.0)
"""A quaternion of another length is no rotation [-]: those of resampled motions are up to a fifth short of 1."""
SHEAR = 0.2
"""Largest entry of RᵀR − I of a matrix that is read as a rotation [-]: means of neighbouring frames stray by .1."""
MOST_TURNED = 1000.0
"""Of a vector of rotation; more is another unit or damage [rad]."""


def checked_quaternions(values: Any, what: str, gaps: bool = False) -> Floats:
    """Return unit quaternions (…, 4) in the order of the file.

    Args:
        values: (…, 4).
        what: their name, for the message.
        gaps: whether zeros and numbers that are not finite are places where the body was lost; they become NaN.

    Raises:
        FileError: a quaternion has another length than about 1.
    """
    turns = np.asarray(values, dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.sqrt((turns**2).sum(axis=-1))
    lost = ~np.isfinite(turns).all(axis=-1) | (lengths == 0) if gaps else np.zeros(lengths.shape, dtype=bool)
    wrong = ~lost & ~((lengths >= LENGTHS[0]) & (lengths <= LENGTHS[1]))
    if wrong.any():
        place = np.argwhere(wrong)[0].tolist()
        raise FileError(f"{what}: the quaternion at {place} has the length {lengths[wrong][0]:.3g}, expected 1")
    return np.where(lost[..., None], np.nan, turns / np.where(lost, 1.0, lengths)[..., None])


def quaternions_of_matrices(values: Any, what: str) -> Floats:
    """Return quaternions (…, 4) w x y z of rotation matrices (…, 3, 3).

    Raises:
        FileError: a matrix is not orthogonal, mirrors, or has a number that is not finite.
    """
    matrices = np.asarray(values, dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):
        strayed = np.abs(np.swapaxes(matrices, -1, -2) @ matrices - np.eye(3)).max(axis=(-1, -2))
        wrong = ~(strayed < SHEAR)
    mirrors = np.linalg.det(np.where(wrong[..., None, None], np.eye(3), matrices)) < 0
    if (wrong | mirrors).any():
        place = np.argwhere(wrong | mirrors)[0].tolist()
        raise FileError(f"{what}: the matrix at {place} is {'left-handed' if mirrors[tuple(place)] else 'no rotation'}")
    shape = matrices.shape[:-2]
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(*shape, 4)


def quaternions_of_vectors(values: Any, what: str) -> Floats:
    """Return quaternions (…, 4) w x y z of rotation vectors (…, 3) [rad].

    Raises:
        FileError: a number is not finite or larger than `MOST_TURNED`.
    """
    vectors = np.asarray(values, dtype=float)
    wrong = ~(np.abs(vectors) <= MOST_TURNED)
    if wrong.any():
        place, found = np.argwhere(wrong)[0].tolist(), vectors[wrong][0]
        raise FileError(f"{what}: a turn of {found:.3g} rad at {place}, more than {MOST_TURNED:g}")
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat(scalar_first=True).reshape(*vectors.shape[:-1], 4)
