"""Graphs small enough to write down."""

from dataclasses import replace
from typing import Any

import numpy as np

from robot_retarget.papers import PointGraph
from robot_retarget.papers.build import edge_track
from robot_retarget.papers.edges import POSTURE, PointKind


def graph_of(names: str, pairs: str, lower: Any, upper: Any = None, *, dimension: int = 2, **more: Any) -> PointGraph:
    """Objects named by single letters, edges by two (`"ab bc"`)."""
    ends = np.array([[names.index(end) for end in pair] for pair in pairs.split()]).reshape(-1, 2)
    return table(tuple(names), dimension, ends[:, 0], ends[:, 1], lower, lower if upper is None else upper, **more)


def table(
    vertices: tuple[str, ...],
    dimension: int,
    i: Any,
    j: Any,
    lower: Any,
    upper: Any,
    *,
    priority: Any = 1.0,
    **more: Any,
) -> PointGraph:
    """A graph of one frame from plain lists."""
    graph = PointGraph((), vertices, 1, dimension)
    track = edge_track(POSTURE, graph, np.asarray(i), np.asarray(j), lower, upper, priority)
    return replace(graph, tracks=(track,), **more)


def of_kind(graph: PointGraph, kind: PointKind) -> PointGraph:
    """The same edges, all of one kind."""
    return replace(graph, tracks=tuple(replace(track, kind=kind) for track in graph.tracks))


def with_huber(graph: PointGraph, huber_delta: float) -> PointGraph:
    """The same edges, all with one Huber scale [m]."""
    return replace(graph, tracks=tuple(replace(track, huber_delta=huber_delta) for track in graph.tracks))
