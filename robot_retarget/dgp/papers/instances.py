"""Generated instances of one frame: sensor networks and a stiff mesh."""

from dataclasses import replace

import numpy as np

from robot_retarget.dgp.build import frame_edges
from robot_retarget.dgp.graph import Graph


def sensor_network(count: int, seed: int, *, reach: float = 0.18, width: float = 0.1) -> Graph:
    """A sparse network in the style of the public sensor instances, without its solution.

    Points in a box of 0.9 m: each measures its two predecessors exactly and the third, as well as every point nearer
    than `reach`, to within `width` [m]. About four distances per sensor, hardly more than rigidity needs.
    """
    rng = np.random.default_rng(seed)
    graph = frame_edges(tuple(f"s{sensor}" for sensor in range(count)), 0.9 * rng.uniform(0, 1, (count, 3)))
    graph = graph.select((graph.j - graph.i <= 3) | (graph.lower < reach))
    wide = graph.j - graph.i >= 3
    lower = np.where(wide, np.maximum(graph.lower - width * rng.random(len(graph)), 0.0), graph.lower)
    return replace(graph, lower=lower, upper=lower + width * wide)


def stiff_mesh(seed: int, error: float = 0.02) -> tuple[Graph, Graph]:
    """A closed mesh of triangles (an uneven octahedron of 0.1–0.14 m) whose three diagonals are measured with errors.

    Returns:
        The instance with the diagonals (the "6th distances" of [MucherinoOmer2019, §4.4]) as intervals that hold the
        truth, and the one with every diagonal at its measured value.
    """
    corners = np.concatenate([np.eye(3), -np.eye(3)]) * [0.1, 0.12, 0.14]
    corners += 0.01 * np.random.default_rng(0).uniform(-1, 1, corners.shape)
    graph = frame_edges(("x", "y", "z", "−x", "−y", "−z"), corners)
    diagonal = graph.j - graph.i == 3
    measured = graph.lower * (1.0 + error * diagonal * np.random.default_rng(seed).uniform(-1, 1, len(graph)))
    slack = error * graph.lower * diagonal
    return replace(graph, lower=measured - slack, upper=measured + slack), replace(
        graph, lower=measured, upper=measured
    )
