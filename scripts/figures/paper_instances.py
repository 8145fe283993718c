"""Generated instances of one frame: sensor networks and a stiff mesh."""

import numpy as np

from robot_retarget.papers.build import frame_edges
from robot_retarget.papers.points import PointGraph


def sensor_network(count: int, seed: int, *, reach: float = 0.18, width: float = 0.1) -> PointGraph:
    """A sparse network in the style of the public sensor instances, without its solution.

    Points in a box of 0.9 m: each measures its two predecessors exactly and the third, as well as every point nearer
    than `reach`, to within `width` [m]. About four distances per sensor, hardly more than rigidity needs.

    Args:
        count: number of sensors.
        seed: of the random numbers.
        reach: pairs nearer than this are measured [m].
        width: width of an interval [m].
    """
    rng = np.random.default_rng(seed)
    graph = frame_edges(tuple(f"s{sensor}" for sensor in range(count)), 0.9 * rng.uniform(0, 1, (count, 3)))
    edges = graph.edges
    graph = graph.select((edges.j - edges.i <= 3) | (edges.lower < reach))
    edges, draw = graph.edges, rng.random(len(graph.edges))
    wide = edges.j - edges.i >= 3
    lower = np.where(wide, np.maximum(edges.lower - width * draw, 0.0), edges.lower)
    return graph.with_targets(lower=lower, upper=lower + width * wide)


def stiff_mesh(seed: int, error: float = 0.02) -> tuple[PointGraph, PointGraph]:
    """A closed mesh of triangles (an uneven octahedron of 0.1–0.14 m) whose three diagonals are measured with errors.

    Args:
        seed: of the random numbers.
        error: largest relative error of a measured diagonal [-].

    Returns:
        The instance with the diagonals (the "6th distances" of [MucherinoOmer2019, §4.4]) as intervals that hold the
        truth, and the one with every diagonal at its measured value.
    """
    corners = np.concatenate([np.eye(3), -np.eye(3)]) * [0.1, 0.12, 0.14]
    corners += 0.01 * np.random.default_rng(0).uniform(-1, 1, corners.shape)
    graph = frame_edges(("x", "y", "z", "−x", "−y", "−z"), corners)
    edges = graph.edges
    diagonal = edges.j - edges.i == 3
    measured = edges.lower * (1.0 + error * diagonal * np.random.default_rng(seed).uniform(-1, 1, len(edges)))
    slack = error * edges.lower * diagonal
    interval = graph.with_targets(lower=measured - slack, upper=measured + slack)
    return interval, graph.with_targets(lower=measured, upper=measured)
