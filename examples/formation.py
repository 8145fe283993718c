"""A formation: six robots in two columns pass an obstacle in their way and keep seeing each other."""

import numpy as np

from robot_retarget import papers

columns = np.array([(0.14 * row, 0.5 + 0.07 * side) for row in range(3) for side in (1, -1)])
way = np.linspace((0.0, 0.0), (1.2, 0.0), 20)
x = np.concatenate([way[:, None] + columns, np.full((20, 1, 2), (0.74, 0.505))], axis=1)  # (T, 6 robots, 1 rock; 2) [m]
team = papers.Team(
    np.arange(6), np.array([6]), papers.Sensing(near=0.22, far=0.34, clear=0.08, blocked=0.03), least=0.005
)

graph = papers.motion_graph(x, postures=False, fixed=["6"])
apart = papers.pair_edges(graph, [(robot, "6") for robot in "012345"], 0.15)
rigid = papers.solve_formation(graph.joined(apart), x, team)

for what, found in (("straight on", x), ("rigid", rigid.positions)):
    least = papers.formation_rigidity(team, found).min()
    print(
        f"{what}: least rigidity {least:.4f} m², obstacle no nearer than {papers.distances(apart, found).min():.3f} m"
    )
