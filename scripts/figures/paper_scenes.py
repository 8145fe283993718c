"""The animations of [MucherinoOmer2019, Figs 1–5], in the plane, and the instances made from them.

The paper shows pictures; this package chooses coordinates, frame counts and priorities where the paper omits them.
"""

from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.papers.build import bone_edges, empty, pair_edges, trace_edges
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.skeletal import SkeletalStructure, realize, structure_from_pose

DEPTH = 3
"""τ of the paper."""
RAISED = 10.0
"""π of the edges in E⁺; those of E* have 1."""


@dataclass(frozen=True)
class Crowd:
    """Objects that move, obstacles that stay, and the pairs that must not come too close."""

    names: tuple[str, ...]
    animation: Floats
    """(T, V, 2) [m]."""
    obstacles: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]

    def traces(self, anchored: bool) -> PointGraph:
        """E*: the movements of the objects; obstacles are fixed, and with `anchored` the first and last frame too."""
        graph = trace_edges(self.names, self.animation, DEPTH)
        fixed = np.tile(np.isin(self.names, self.obstacles), (graph.frames, 1))
        if anchored:
            fixed[[0, -1]] = True
        resting = fixed.ravel()[graph.edges.i] & fixed.ravel()[graph.edges.j]
        return replace(graph.select(~resting), fixed=fixed)

    def thresholds(self, threshold: float) -> PointGraph:
        """Every pair in every frame, δ = [Δ, ∞]: the candidates for E⁺."""
        graph, _ = empty(self.names, self.animation)
        return pair_edges(graph, self.pairs, threshold, priority=RAISED)


def _line(start: tuple[float, float], stop: tuple[float, float], frames: int) -> Floats:
    return np.linspace(start, stop, frames)


def meeting(frames: int = 50) -> Crowd:
    """Fig. 1: two objects from opposite sides of a 1 × 1 box, very close to each other half-way."""
    tracks = _line((0, 0.49), (1, 0.49), frames), _line((1, 0.51), (0, 0.51), frames)
    return Crowd(("a", "b"), np.stack(tracks, axis=1), (), (("a", "b"),))


def crossing(frames: int = 50) -> Crowd:
    """Fig. 2: the same at a right angle."""
    tracks = _line((0, 0.5), (1, 0.5), frames), _line((0.51, 0), (0.51, 1), frames)
    return Crowd(("a", "b"), np.stack(tracks, axis=1), (), (("a", "b"),))


def clock(frames: int = 50) -> Crowd:
    """Return Fig. 3: three quarters of a turn about the centre of the box, with two obstacles next to the path."""
    angle = np.radians(90.0 - np.linspace(0.0, 270.0, frames))
    track = 0.5 + 0.35 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    at = np.radians([20.0, -110.0])
    reach = np.array([0.37, 0.33])[:, None]
    rocks = 0.5 + reach * np.stack([np.cos(at), np.sin(at)], axis=1)
    animation = np.concatenate([track[:, None], np.tile(rocks, (frames, 1, 1))], axis=1)
    return Crowd(
        ("hand", "rock 1", "rock 2"), animation, ("rock 1", "rock 2"), (("hand", "rock 1"), ("hand", "rock 2"))
    )


def pedestrians(frames: int = 50, gap: float = 0.06, offset: float = 0.005) -> Crowd:
    """Fig. 4: two people side by side, an obstacle in the middle of their way (a little off the line of symmetry).

    Args:
        frames: number of frames |T|.
        gap: distance of the two people [m].
        offset: of the obstacle from the line of symmetry [m].
    """
    tracks = [_line((0, 0.5 + side), (1, 0.5 + side), frames) for side in (gap / 2, -gap / 2)]
    rock = np.full((frames, 2), (0.5, 0.5 + offset))
    pairs = (("a", "rock"), ("b", "rock"))
    return Crowd(("a", "b", "rock"), np.stack([*tracks, rock], axis=1), ("rock",), pairs)


def together(scene: Crowd, priority: float = RAISED) -> PointGraph:
    """Fig. 4c: one bone between the two pedestrians in every frame, as long as in the animation.

    Args:
        scene: of `pedestrians`.
        priority: π of the bone.
    """
    graph, x = empty(scene.names, scene.animation)
    return bone_edges(graph, structure_from_pose(("a", "b"), [-1, 0], x[0, :2]), priority)


_FIGURE = (
    # joint, parent, displacement in the initial pose [m] (x right, y up), angle at the end of the movement [°]
    ("hips", None, (0.0, 0.95), 0.0),
    ("spine", "hips", (0.0, 0.25), 0.0),
    ("neck", "spine", (0.0, 0.25), 0.0),
    ("head", "neck", (0.0, 0.14), 0.0),
    ("l_shoulder", "neck", (0.16, -0.04), 153.73),
    ("l_elbow", "l_shoulder", (0.0, -0.28), 118.77),
    ("l_hand", "l_elbow", (0.0, -0.27), 0.0),
    ("r_shoulder", "neck", (-0.16, -0.04), -153.73),
    ("r_elbow", "r_shoulder", (0.0, -0.28), -118.77),
    ("r_hand", "r_elbow", (0.0, -0.27), 0.0),
    ("l_hip", "hips", (0.10, -0.05), 0.0),
    ("l_knee", "l_hip", (0.02, -0.42), 0.0),
    ("l_foot", "l_knee", (0.0, -0.42), 0.0),
    ("r_hip", "hips", (-0.10, -0.05), 0.0),
    ("r_knee", "r_hip", (-0.02, -0.42), 0.0),
    ("r_foot", "r_knee", (0.0, -0.42), 0.0),
)


def figure() -> SkeletalStructure:
    """Fig. 5: a human skeleton in the plane, arms hanging in its initial pose."""
    names = [joint for joint, *_ in _FIGURE]
    parents = np.array([names.index(parent) if parent else -1 for _, parent, *_ in _FIGURE])
    return SkeletalStructure(tuple(names), parents, np.array([displacement for *_, displacement, _ in _FIGURE]))


def raised_hands(structure: SkeletalStructure, frames: int = 100) -> Crowd:
    """Fig. 5: the hands rise until they meet just over the centre of the head, recorded as angles.

    Played on a body with other bones this is angle transfer. The feet and hips stand still; hands may touch each
    other but not the head.

    Args:
        structure: a body with the joints of `figure`.
        frames: number of frames |T|.
    """
    turn = np.radians([angle for *_, angle in _FIGURE])
    rho = np.linspace(0.0, 1.0, frames)[:, None] * turn
    x = realize(structure, rho, np.tile(structure.displacements[0], (frames, 1)))
    resting = tuple(name for name in structure.names if name == "hips" or name[2:] in ("hip", "knee", "foot"))
    return Crowd(structure.names, x, resting, (("l_hand", "head"), ("r_hand", "head")))


def shortened_arms(structure: SkeletalStructure, factor: float = 0.8) -> SkeletalStructure:
    """Fig. 5b, c: the same body with upper arms 20 % shorter.

    Args:
        structure: a body with the joints of `figure`.
        factor: of the upper arms [-].
    """
    return structure.scaled([factor if name in ("l_elbow", "r_elbow") else 1.0 for name in structure.names])


def team(frames: int = 40) -> Crowd:
    """Six robots in two columns that meet an obstacle in the middle of their way, [MucherinoOmer2019, §4.3]."""
    columns = [(row * 0.14, side * 0.07) for row in range(3) for side in (1.0, -1.0)]
    tracks = [_line((0.0 + dx, 0.5 + dy), (1.2 + dx, 0.5 + dy), frames) for dx, dy in columns]
    rock = np.full((frames, 2), (0.74, 0.505))
    names = tuple("abcdef")
    pairs = tuple((name, "rock") for name in names)
    return Crowd((*names, "rock"), np.stack([*tracks, rock], axis=1), ("rock",), pairs)


def reaching(frames: int = 100) -> tuple[Floats, Floats]:
    """[Mucherino2019, Fig. 2]: a wrist swings from its side to the opposite, steady shoulder and stops just before it.

    It rests in the last frame, where D and the Euclidean distance coincide.

    Returns:
        The positions of wrist and opposite shoulder, (T, 2, 2), and the shoulder of the arm that moves, (2,) [m].
    """
    time = np.minimum(np.arange(frames) / (frames - 2), 1.0)
    progress = 10.0 * time**3 - 15.0 * time**4 + 6.0 * time**5
    angle, radius = np.radians(-45.0 - 126.1 * progress), 0.5 - 0.176 * progress
    own, opposite = np.array([0.18, 1.4]), np.array([-0.18, 1.4])
    wrist = own + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.stack([wrist, np.tile(opposite, (frames, 1))], axis=1), own
