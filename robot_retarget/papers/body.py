"""The 22-joint body of [Mucherino2017, Table I], and a walking posture for it.

The lengths are the paper's, with its misprint mended: the parent of RA is RK, the knee, where the table says RN. The
paper shows its walking posture only as a picture; the bone directions here are this package's own.
"""

import numpy as np

from robot_retarget.papers.skeletal import SkeletalStructure

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
