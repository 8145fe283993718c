"""A crowd: ten people cross a square on straight ways and meet in the middle; nobody shall come nearer than 0.5 m."""

from itertools import combinations

import numpy as np

from robot_retarget import papers

angle = np.linspace(0.0, 2 * np.pi, 10, endpoint=False)
start, stop = (4.0 * np.stack([np.cos(angle + turn), np.sin(angle + turn)], axis=1) for turn in (0.0, 3.0))
walkers = np.linspace(start, stop, 60)  # (T, V, 2) [m]

graph = papers.motion_graph(walkers, postures=False)
apart = papers.pair_edges(graph, list(combinations(graph.vertices, 2)), 0.5)
crowd = papers.solve_with_thresholds(graph, apart, walkers, papers.solve)

print(
    f"least distance {papers.distances(apart, walkers).min():.3f} m before, {papers.distances(apart, crowd.positions).min():.3f} m after"
)
