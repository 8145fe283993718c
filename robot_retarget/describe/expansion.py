"""The graph of a retargeting as the papers' graph of free points: vertices v_t that no robot joins.

An edge that measures the distance of two keypoints, or of a keypoint and a place, becomes one edge per frame with the
same interval, π over the square of its scale and its Huber scale in metres, so that its stress is the same to rounding:

    π ϱ_g((d − y)/s) = (π/s²) ϱ_(g s)(d − y).

Properties that the robot keeps by construction become edges: its bones, exact and hard. The expansion omits edges that
are not distances of two free points: directions and places along an axis (compass, orientation, path, foothold, mass:
limits of distances to far beacons), angles (rest), second differences of joints, points that a body carries, and the
limits of the robot.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.kinds.own import Own
from robot_retarget.dgp.graph import Graph as Instance
from robot_retarget.dgp.graph import Kind
from robot_retarget.dgp.track import HARD, Track

if TYPE_CHECKING:
    from robot_retarget.describe.graph import Graph

LABELS = {"touch": Kind.TOUCH}
"""Kinds of edges with a label in the papers' graph; the others are postures."""


def expanded(graph: "Graph") -> Instance:
    """Return the papers' graph over V × T: V the keypoints, and the places of added edges, fixed by their boxes."""
    places = places_of(graph)
    vertices = (*graph.match.keypoints, *places)
    tracks = [track.subset(between_points(track, vertices)) for track in graph.costs]
    held = np.array([places.get(name, np.full(3, np.nan)) for name in vertices])
    boxes = (np.tile(np.where(np.isnan(held), free, held), (len(graph), 1, 1)) for free in (-np.inf, np.inf))
    bones = replace(_bones(graph, vertices), **dict(zip(("box_lower", "box_upper"), boxes, strict=True)))
    return bones.joined(*(_edges(track, vertices, len(graph)) for track in tracks if len(track)))


def places_of(graph: "Graph") -> dict[str, Floats]:
    """Return the places in the world at which added edges end, by name."""
    found = {}
    for track in graph.tracks:
        if isinstance(track.kind, Own):
            for ends, names in zip(track.kind.ends, track.ends, strict=True):
                found |= {n: e for e, n in zip(ends, names, strict=True) if isinstance(e, np.ndarray)}
    return found


def between_points(track: Track, vertices: Collection[str]) -> np.ndarray:
    """Return (E,) which edges measure the distance of two vertices."""
    return np.array([not track.axes and set(ends) <= set(vertices) for ends in track.ends], dtype=bool)


def _edges(track: Track, vertices: tuple[str, ...], frames: int) -> Instance:
    """Return a track frame after frame; an edge with π = 0 is absent."""
    ends = np.array([[vertices.index(end) for end in pair] for pair in track.ends])
    ids = np.arange(frames)[:, None, None] * len(vertices) + ends
    present = track.priority > 0
    i, j = ids[present].T
    return Instance(
        vertices,
        frames,
        3,
        i,
        j,
        track.lower[present],
        track.upper[present],
        (track.priority / track.scale**2)[present],
        np.array(LABELS.get(track.name, Kind.POSTURE), np.int8),
        np.broadcast_to(track.huber_delta * track.scale, present.shape)[present],
    )


def _bones(graph: "Graph", vertices: tuple[str, ...]) -> Instance:
    """Return the robot's bones with their lengths in its reference pose."""
    match, leg = graph.match, graph.match.robot_leg
    children = np.flatnonzero((match.parents >= 0) & (match.robot_bones > 0))
    first = np.arange(len(graph))[:, None] * len(vertices)
    i, j = ((first + ends).ravel() for ends in (match.parents[children], children))
    length = np.tile(match.robot_bones[children], len(graph))
    return Instance(
        vertices, len(graph), 3, i, j, length, length, np.array(HARD / leg**2), np.array(Kind.BONE, np.int8)
    )
