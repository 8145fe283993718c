"""Distances of a body, normalised by the path of bones between two joints [Mucherino2017, §II].

    τ_uv = Σ δ over the bones of the path P_uv,    D̄_uv = ‖x_u − x_v‖ / τ_uv,
    π_uv = (|P_max| − |P_uv| + 2) / |P_max|,       |P| counts the vertices of the path.

D̄ is 1 on a bone and 1 elsewhere only for a stretched limb; contact is 0.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_retarget.base.arrays import Floats

NEAR = 0.35
"""Two points at this share of the path between them are half near [-]: hands in a clap are nearer, stretched limbs farther."""


def paths(parents: ArrayLike) -> NDArray[np.bool_]:
    """(V, V, V): whether the bone above joint b lies on the path from u to v."""
    up = np.asarray(parents, dtype=np.int64)
    above = np.zeros((len(up), len(up)), dtype=bool)
    for joint in range(len(up)):
        if up[joint] >= 0:
            above[joint] = above[up[joint]]
            above[joint, joint] = True
    return above[:, None] ^ above[None]


def path_weights(parents: ArrayLike, lengths: ArrayLike) -> Floats:
    """τ (V, V), the length of the path between every two joints [m].

    Args:
        parents: (V,) index of each joint's parent, −1 at the root.
        lengths: (V,) distance of each joint to its parent [m].
    """
    return paths(parents) @ np.asarray(lengths, dtype=np.float64)


def normalised_distances(positions: ArrayLike, parents: ArrayLike, lengths: ArrayLike) -> Floats:
    """D̄ (…, V, V) of postures (…, V, K), with 0 on the diagonal.

    Args:
        positions: (…, V, K) [m].
        parents: (V,) index of each joint's parent, −1 at the root.
        lengths: (V,) distance of each joint to its parent [m].
    """
    x = np.asarray(positions, dtype=np.float64)
    tau = path_weights(parents, lengths)
    distance = np.linalg.norm(x[..., :, None, :] - x[..., None, :, :], axis=-1)
    return np.divide(distance, tau, out=np.zeros_like(distance), where=tau > 0)


def path_priorities(parents: ArrayLike) -> Floats:
    """π (V, V): 1 on a bone, 2/|P_max| on the longest path; 0 on the diagonal."""
    vertices = paths(parents).sum(axis=2) + 1
    longest = vertices.max()
    priority = (longest - vertices + 2) / longest
    np.fill_diagonal(priority, 0.0)
    return priority
