"""Skeletal structures (S, χ), their animation by angles ρ, and angle transfer, the baseline of the papers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Floats, Ints, frozen
from robot_retarget.base.errors import GraphError
from robot_retarget.human.motion import Motion


@dataclass(frozen=True)
class SkeletalStructure:
    """A tree S with a morphology χ; joints stand after their parents, the root's parent is −1.

    χ is kept as the displacement from the parent [Mucherino2019, §2]; `initial_pose` is the other meaning, a
    position per joint [MucherinoOmer2019, Definition 1], and `structure_from_pose` converts back.

    Raises:
        GraphError: a joint before its parent, or one at its parent's position (χ(u) ≠ χ(v) is required).
    """

    names: tuple[str, ...]
    parents: Ints
    """(V,)."""
    displacements: Floats
    """χ(v), (V, K) from the parent [m]; the root's own is where it stands, usually 0."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "parents", frozen(self.parents, np.int64))
        object.__setattr__(self, "displacements", frozen(self.displacements))
        count = len(self.names)
        shape = self.displacements.shape
        if self.parents.shape != (count,) or len(shape) != 2 or shape[0] != count or shape[1] not in (2, 3):
            raise GraphError(f"{count} joints need parents ({count},) and χ ({count}, 2 or 3): {shape}")
        order = np.arange(count)
        if count == 0 or self.parents[0] != -1 or (self.parents[1:] < 0).any() or (self.parents >= order).any():
            late = next((v for v in order[1:] if not 0 <= self.parents[v] < v), 0)
            name = self.names[late] if count else "none"
            raise GraphError(f"joint {name!r} must stand after its parent, and the root alone has parent −1")
        short = np.flatnonzero(self.lengths[1:] == 0)
        if short.size:
            raise GraphError(f"joint {self.names[short[0] + 1]!r} coincides with its parent")

    @classmethod
    def of(cls, motion: Motion) -> "SkeletalStructure":
        """The body of a motion, its bones as in its rest pose.

        Raises:
            GraphError: a joint coincides with its parent, or there are several roots.
        """
        return cls(motion.skeleton.names, motion.skeleton.parents, motion.skeleton.offsets)

    @property
    def bones(self) -> Ints:
        """E_S as (V − 1, 2) rows parent, child."""
        return np.stack([self.parents[1:], np.arange(1, len(self.names))], axis=1)

    @property
    def lengths(self) -> Floats:
        """(V,) distance to the parent [m], 0 at the root."""
        lengths = np.linalg.norm(self.displacements, axis=1)
        lengths[0] = 0.0
        return lengths

    @property
    def initial_pose(self) -> Floats:
        """χ as positions, (V, K) [m]."""
        pose = self.displacements.copy()
        for joint in range(1, len(pose)):
            pose[joint] += pose[self.parents[joint]]
        return pose

    def scaled(self, factors: ArrayLike) -> "SkeletalStructure":
        """Bones of the same directions, their lengths times `factors` ((V,) or a scalar)."""
        factor = np.broadcast_to(np.asarray(factors, dtype=np.float64), len(self.names))
        return SkeletalStructure(self.names, self.parents, self.displacements * factor[:, None])


def structure_from_pose(names: Sequence[str], parents: ArrayLike, pose: ArrayLike) -> SkeletalStructure:
    """The structure whose initial pose is χ: V → ℝ^K, (V, K) [m].

    Args:
        names: (V,) of joints.
        parents: (V,) index of each joint's parent, −1 at the root.
        pose: (V, K) [m].
    """
    up, x = np.asarray(parents, dtype=np.int64), np.array(pose, dtype=np.float64)
    displacements = x - np.where((up >= 0)[:, None], x[np.maximum(up, 0)], 0.0)
    return SkeletalStructure(tuple(names), up, displacements)


def realize(structure: SkeletalStructure, rho: ArrayLike, root: ArrayLike, order: str = "ZXY") -> Floats:
    """The animation x of (S, χ) under ρ, [Mucherino2019, eq. 3]: R_v = R_parent ρ_v, x_c = x_v + R_v χ(c).

    Playing ρ_A on the structure of B is angle transfer, ρ_B := ρ_A.

    Args:
        structure: (S, χ).
        rho: angle of each joint relative to its parent [rad]: (T, V, 3) Euler angles applied in `order` (as in BVH
            channels), or (T, V) in the plane.
        root: (T, K) position of the root [m].
        order: axes of the three angles, capitals for rotating axes.

    Returns:
        (T, V, K) [m].

    Raises:
        GraphError: ρ does not fit the structure.
    """
    angles, axes = np.asarray(rho, dtype=np.float64), structure.displacements.shape[1]
    expected = (len(structure.names),) if axes == 2 else (len(structure.names), 3)
    if angles.shape[1:] != expected:
        raise GraphError(f"ρ must be (T, {', '.join(map(str, expected))}), got {angles.shape}")
    turns = _plane(angles) if axes == 2 else _space(angles, order)
    x = np.empty((*angles.shape[:2], axes))
    x[:, 0] = root
    for joint in range(1, len(structure.names)):
        parent = structure.parents[joint]
        x[:, joint] = x[:, parent] + turns[:, parent] @ structure.displacements[joint]
        turns[:, joint] = turns[:, parent] @ turns[:, joint]
    return x


def _plane(angles: Floats) -> Floats:
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def _space(angles: Floats, order: str) -> Floats:
    from scipy.spatial.transform import Rotation  # imported here so that importing the package stays fast

    flat = Rotation.from_euler(order, angles.reshape(-1, 3)).as_matrix()
    return flat.reshape(*angles.shape[:-1], 3, 3)


def transfer_directions(positions: ArrayLike, parents: ArrayLike, lengths: ArrayLike) -> Floats:
    """Angle transfer where only positions are known: every bone keeps its direction and takes a new length.

    Args:
        positions: (T, V, K) or (V, K) [m].
        parents: (V,), −1 at the root, which does not move.
        lengths: (V,) new distance to the parent [m]; the root's is not read.

    Raises:
        GraphError: a joint coincides with its parent, so that its bone has no direction.
    """
    x, up = np.asarray(positions, dtype=np.float64), np.asarray(parents, dtype=np.int64)
    new, wanted = x.copy(), np.asarray(lengths, dtype=np.float64)
    for joint in np.flatnonzero(up >= 0):
        bone = x[..., joint, :] - x[..., up[joint], :]
        length = np.linalg.norm(bone, axis=-1, keepdims=True)
        if not (length > 0).all():
            raise GraphError(f"joint {joint} coincides with its parent {up[joint]}: its bone has no direction")
        new[..., joint, :] = new[..., up[joint], :] + wanted[joint] * bone / length
    return new


# The 22-joint body of [Mucherino2017, Table I], and a walking posture for it.
#
# The lengths are the paper's, with its misprint mended: the parent of RA is RK, the knee, where the table says RN. The
# paper shows its walking posture only as a picture; the bone directions here are this package's own.

_JOINTS = (
    # joint, parent, length [m], direction in the walking posture (x forward, y left, z up; not normalised)
    ("C", "H", 0.160, (0.03, 0, 1)),
    ("CA", "C", 0.179, (0.06, 0, 1)),
    ("CB", "CA", 0.069, (0.08, 0, 1)),
    ("N", "CB", 0.069, (0.15, 0, 1)),
    ("HD", "N", 0.106, (0.25, 0, 1)),
    ("RC", "CB", 0.072, (0, -1, 0.35)),
    ("RS", "RC", 0.158, (0.10, -1, -0.02)),
    ("RE", "RS", 0.273, (0.42, -0.10, -0.90)),
    ("RW", "RE", 0.258, (0.75, 0.10, -0.62)),
    ("LC", "CB", 0.072, (0, 1, 0.35)),
    ("LS", "LC", 0.158, (-0.10, 1, -0.02)),
    ("LE", "LS", 0.273, (-0.42, 0.12, -0.90)),
    ("LW", "LE", 0.258, (-0.15, 0.06, -0.98)),
    ("RH", "H", 0.108, (-0.05, -1, -0.25)),
    ("RK", "RH", 0.435, (-0.28, -0.02, -0.96)),
    ("RA", "RK", 0.453, (-0.45, 0, -0.89)),
    ("RT", "RA", 0.125, (0.80, -0.10, -0.60)),
    ("LH", "H", 0.108, (0.05, 1, -0.25)),
    ("LK", "LH", 0.435, (0.42, 0.02, -0.91)),
    ("LA", "LK", 0.453, (0.18, 0, -0.98)),
    ("LT", "LA", 0.125, (0.98, 0.12, 0.10)),
)

ARMS = ("RE", "RW", "LE", "LW")
LEGS = ("RK", "RA", "LK", "LA")
SPINE = ("C", "CA", "CB")


def table_one_body() -> SkeletalStructure:
    """The body of Table I; its initial pose is the walking posture."""
    names = ("H", *(joint for joint, *_ in _JOINTS))
    parents = np.array([-1, *(names.index(parent) for _, parent, *_ in _JOINTS)])
    directions = np.array([direction for *_, direction in _JOINTS], dtype=np.float64)
    lengths = np.array([length for _, _, length, _ in _JOINTS])
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return SkeletalStructure(names, parents, np.vstack([np.zeros(3), lengths[:, None] * unit]))


def resized(body: SkeletalStructure, factors: dict[str, float]) -> SkeletalStructure:
    """The body with the bones above some joints scaled.

    Args:
        body: (S, χ).
        factors: factor of the bone above each named joint [-].
    """
    return body.scaled([factors.get(name, 1.0) for name in body.names])


def posture_cases() -> dict[str, dict[str, float]]:
    """Changes of the body to adapt the walking posture to; Table II of the paper prints one of them readably."""
    everything = table_one_body().names
    child = dict.fromkeys(LEGS + ARMS, 0.7) | dict.fromkeys(SPINE, 0.8) | {"N": 1.2, "HD": 1.2}
    return {
        "uniform ×1.2": dict.fromkeys(everything, 1.2),
        "arms +20 %": dict.fromkeys(ARMS, 1.2),
        "arms −40 %": dict.fromkeys(ARMS, 0.6),
        "arms +60 %": dict.fromkeys(ARMS, 1.6),
        "upper arms −20 %": dict.fromkeys(("RE", "LE"), 0.8),
        "forearms +50 %": dict.fromkeys(("RW", "LW"), 1.5),
        "legs +20 %": dict.fromkeys(LEGS, 1.2),
        "legs +60 %": dict.fromkeys(LEGS, 1.6),
        "legs −40 %": dict.fromkeys(LEGS, 0.6),
        "spine +20 %": dict.fromkeys(SPINE, 1.2),
        "spine +60 %": dict.fromkeys(SPINE, 1.6),
        "child-like": child,
        "right arm +60 %": {"RE": 1.6, "RW": 1.6},
    }
