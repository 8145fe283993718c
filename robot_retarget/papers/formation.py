"""A team of robots that must stay a rigid framework, [MucherinoOmer2019, §4.3], left to future work there.

Two robots measure each other while they are in range and nothing stands between them. Each link has a weight
a = a_range · a_sight that falls smoothly from 1 to 0, and the formation of frame t is rigid while the eigenvalue
λ_t = λ_{K(K+1)/2 + 1}(Rᵀ diag(a) R) is positive. The animation minimises

    σ(x) + w Σ_t max(0, λ_least − λ_t)²,    ∂λ/∂x = Σ_e 2 a_e (Rv)_e ∂(Rv)_e + (Rv)_e² ∂a_e,

with v the unit eigenvector.
"""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Floats, Ints, frozen
from robot_retarget.graph.track import Objective
from robot_retarget.papers.evaluation import Reduced, box_of, intervals_of, operator
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.solvers import PointSolution
from robot_retarget.papers.spectral import Single, Spectral, minimise


@dataclass(frozen=True)
class Sensing:
    """The range in which two robots measure each other; each weight falls from 1 to 0 by a cubic step."""

    near: float
    """Up to this distance the link has full weight [m]."""
    far: float
    """From this distance on the weight is 0 [m]."""
    clear: float = 0.0
    """A line of sight this far from every obstacle's centre is free [m]."""
    blocked: float = -1.0
    """A line of sight at most this far from a centre is blocked [m]."""


@dataclass(frozen=True)
class Team:
    """The robots that must stay rigid: indices of the robots and of the obstacles in V, and the sensing range."""

    robots: Ints
    obstacles: Ints
    sensing: Sensing
    least: float
    """λ_least [m²]."""
    weight: float = 100.0
    """w [1/m²]."""

    @property
    def pairs(self) -> Ints:
        """(E, 2) every two robots, as indices into `robots`."""
        return np.stack(np.triu_indices(len(self.robots), 1), axis=1)


def rigidity_matrix(positions: ArrayLike, edges: ArrayLike) -> Floats:
    """R (…, E, V·K): row e is ½ ∂‖x_i − x_j‖²/∂x, that is x_i − x_j at i and its opposite at j.

    Args:
        positions: (…, V, K) [m].
        edges: (E, 2) indices of both ends in V.
    """
    x = np.asarray(positions, dtype=np.float64)
    count, axes = x.shape[-2:]
    ends = np.asarray(edges, dtype=np.int64).reshape(-1, 2)
    r = x[..., ends[:, 0], :] - x[..., ends[:, 1], :]
    matrix = np.zeros((*x.shape[:-2], len(ends), count, axes))
    row = np.arange(len(ends))
    matrix[..., row, ends[:, 0], :] = r
    matrix[..., row, ends[:, 1], :] = -r
    return matrix.reshape(*x.shape[:-2], len(ends), count * axes)


def formation_rigidity(team: Team, animation: ArrayLike) -> Floats:
    """λ_t (T,) of an animation (T, V, K) [m²]; 0 where the formation is flexible.

    Args:
        animation: (T, V, K) [m].
    """
    return _rigidity(team, np.asarray(animation, dtype=np.float64))[0]


def links(team: Team, animation: ArrayLike) -> Floats:
    """a (T, E) of every pair of robots, 1 a whole link and 0 a lost one.

    Args:
        animation: (T, V, K) [m].
    """
    return _links(team, np.asarray(animation, dtype=np.float64))[0]


def solve_formation(graph: PointGraph, start: ArrayLike, team: Team, options: Spectral | None = None) -> PointSolution:
    """Minimise σ (half squared) with the penalty on lost rigidity, from a start (T, V, K) [m].

    Args:
        start: (T, V, K) [m].

    Raises:
        GraphError: the start does not fit the graph.
    """
    x, options = graph.checked(start), options or Spectral(value_tolerance=1e-12)
    began, shape = time.perf_counter(), x.shape
    stress = Reduced(operator(graph), intervals_of(graph.edges), Objective.HALF_SQUARED, graph.dimension)

    def total(z: Floats) -> tuple[float, Floats]:
        value, slope = stress(z[:, None])
        eigenvalue, change = _rigidity(team, z.reshape(shape))
        lack = np.maximum(team.least - eigenvalue, 0.0)
        penalty = team.weight * float(lack @ lack)
        return float(value[0]) + penalty, slope[:, 0] - (2.0 * team.weight * lack[:, None, None] * change).ravel()

    lower, upper = (side.reshape(-1, 1) for side in box_of(graph, x))
    found = minimise(Single(total), x.reshape(-1, 1), lower, upper, options)
    return PointSolution(
        graph=graph,
        positions=frozen(found.z.reshape(shape)),
        objective=Objective.HALF_SQUARED,
        statuses=found.statuses,
        iterations=found.iterations,
        history=found.history,
        seconds=time.perf_counter() - began,
        method="spectral, rigid formation",
    )


def _rigidity(team: Team, x: Floats) -> tuple[Floats, Floats]:
    """λ_t (T,) and ∂λ_t/∂x_t (T, V, K)."""
    robots, pairs = x[:, team.robots], team.pairs
    weight, change = _links(team, x)
    matrix = rigidity_matrix(robots, pairs)
    values, vectors = np.linalg.eigh(np.swapaxes(matrix, 1, 2) @ (weight[..., None] * matrix))
    place = x.shape[2] * (x.shape[2] + 1) // 2
    v = vectors[:, :, place].reshape(robots.shape)
    s = v[:, pairs[:, 0]] - v[:, pairs[:, 1]]
    r = robots[:, pairs[:, 0]] - robots[:, pairs[:, 1]]
    rv = (r * s).sum(-1)
    pull = 2.0 * (weight * rv)[..., None] * s
    total = np.zeros_like(x)
    for end, sign in ((0, 1.0), (1, -1.0)):
        member = np.eye(x.shape[1])[team.robots[pairs[:, end]]]
        total += np.einsum("ev,tek->tvk", member, sign * pull + (rv**2)[..., None] * change[end])
    return values[:, place], total


def _links(team: Team, x: Floats) -> tuple[Floats, tuple[Floats, Floats]]:
    """a (T, E) and its change by the first and the second robot of each pair, (T, E, K)."""
    sensing, pairs = team.sensing, team.pairs
    a, b = x[:, team.robots[pairs[:, 0]]], x[:, team.robots[pairs[:, 1]]]
    between = b - a
    distance = np.linalg.norm(between, axis=-1)
    weight, slope = _step(distance, sensing.far, sensing.near)
    unit = between / np.maximum(distance, 1e-12)[..., None]
    of_a, of_b = -slope[..., None] * unit, slope[..., None] * unit
    for obstacle in team.obstacles:
        away = a - x[:, obstacle][:, None]
        along = np.clip(-(away * between).sum(-1) / np.maximum(distance, 1e-12) ** 2, 0.0, 1.0)[..., None]
        nearest = away + along * between
        gap = np.linalg.norm(nearest, axis=-1)
        sight, fall = _step(gap, sensing.blocked, sensing.clear)
        normal = fall[..., None] * nearest / np.maximum(gap, 1e-12)[..., None]
        of_a = of_a * sight[..., None] + weight[..., None] * (1.0 - along) * normal
        of_b = of_b * sight[..., None] + weight[..., None] * along * normal
        weight = weight * sight
    return weight, (of_a, of_b)


def _step(value: Floats, zero: float, one: float) -> tuple[Floats, Floats]:
    """A cubic from 0 at `zero` to 1 at `one`, and its slope."""
    t = np.clip((value - zero) / (one - zero), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / (one - zero)
