"""Stress by kind of edge, and the edges between keypoints with the largest cost."""

from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.solver.solution import Solution
from robot_retarget.tools.view.web.pack import Packer

EDGES = 60
"""Number of edges in the page, the costliest over the clip first; it draws five of them until more are chosen."""
FINE = 1e-3
"""Resolution of edges: metres, and shares of the largest."""


def stress_of(solution: Solution, packer: Packer) -> dict[str, Any]:
    """The cost of every kind by frame, and the edges: kind, ends, target interval, measured distance, π, stress."""
    kinds = {name: values for name, values in solution.stress.items() if np.any(values > 0)}
    cost = np.stack(list(kinds.values()), axis=1) if kinds else np.zeros((len(solution.cost), 0))
    return {"kinds": list(kinds), "cost": packer.add(cost, _step(cost)), "edges": _edges(solution, packer)}


def _edges(solution: Solution, packer: Packer) -> dict[str, Any] | None:
    keypoints = solution.graph.match.keypoints
    found: list[tuple[str, str, str]] = []
    columns: list[Floats] = []
    for kind, measured in solution.measured.items():
        track, stress = solution.graph.kinds[kind], solution.edge_stress(kind)
        for k, (a, b) in enumerate(track.ends):
            if not track.axes and a in keypoints and b in keypoints:
                found.append((kind, a, b))
                columns.append(
                    np.stack([track.lower[:, k], track.upper[:, k], measured[:, k], track.priority[:, k], stress[:, k]])
                )
    if not found:
        return None
    every = np.stack(columns, axis=2)
    chosen = np.argsort(-every[4].sum(axis=0), kind="stable")[:EDGES]
    names = ("lower", "upper", "measured", "priority", "stress")
    packed = {
        name: packer.add(values[:, chosen], FINE if name in names[:3] else _step(values[:, chosen]))
        for name, values in zip(names, every, strict=True)
    }
    return {"ends": [found[k] for k in chosen.tolist()], **packed}


def _step(values: Floats) -> float:
    """A thousandth of the largest value."""
    return float(np.max(values, initial=0.0)) * FINE or FINE
