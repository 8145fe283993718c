"""Graphs small enough to write down."""

from typing import Any

import numpy as np

from robot_retarget.dgp import Graph


def graph_of(
    names: str, pairs: str, lower: Any, upper: Any = None, *, frames: int = 1, dimension: int = 2, **more: Any
):
    """Objects named by single letters, edges by two (`"ab bc"`)."""
    ends = np.array([[names.index(end) for end in pair] for pair in pairs.split()]).reshape(-1, 2)
    return table(
        tuple(names), frames, dimension, ends[:, 0], ends[:, 1], lower, lower if upper is None else upper, **more
    )


def table(vertices: tuple[str, ...], frames: int, dimension: int, i: Any, j: Any, lower: Any, upper: Any, **more: Any):
    """A graph from plain lists."""
    ends = np.asarray(i), np.asarray(j)
    return Graph(vertices, frames, dimension, *ends, np.asarray(lower), np.asarray(upper), **more)
