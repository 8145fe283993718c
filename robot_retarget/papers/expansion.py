"""The graph of a retargeting as the papers' graph of free points: vertices v_t that no robot joins.

An edge that measures the distance of two keypoints, or of a keypoint and a place, becomes one edge per frame with the
same interval, π over the square of its scale and its Huber scale in metres, so that its stress is the same to rounding:

    π ϱ_g((d − y)/s) = (π/s²) ϱ_(g s)(d − y).

Properties that the robot keeps by construction become edges: its bones, exact and hard. The expansion omits edges that
are not distances of two free points: directions and places along an axis (compass, orientation, path, foothold, mass:
limits of distances to far beacons), angles (rest), second differences of joints, points that a body carries, and the
limits of the robot.
"""

from collections.abc import Collection, Mapping

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.kinds.own import OwnKind
from robot_retarget.graph.track import HARD, Objective, Track, exact
from robot_retarget.papers.edges import BONE
from robot_retarget.papers.points import PointGraph


def expanded(graph: RobotGraph) -> PointGraph:
    """Return the graph of points over V × T: V the keypoints, and the places of added edges, fixed by their boxes."""
    places = places_of(graph)
    vertices = (*graph.match.keypoints, *places)
    tracks = [track.subset(between_points(track, vertices)) for track in graph.costs]
    held = np.array([places.get(name, np.full(3, np.nan)) for name in vertices])
    below, above = (np.where(np.isnan(held), free, held) for free in (-np.inf, np.inf))
    chosen = (_bones(graph), *(track for track in tracks if len(track)))
    return PointGraph(chosen, vertices, len(graph), 3, box_lower=below, box_upper=above)


PRINTED = (Objective.RELATIVE, Objective.HALF_SQUARED, Objective.SQUARED)
"""The papers' objectives."""


def printed_stress(graph: RobotGraph, measured: Mapping[str, Floats]) -> dict[Objective, Floats]:
    """Return (T,) σ per objective of the papers over `expanded(graph)` without bones, which hold.

    Args:
        graph: a described graph.
        measured: per kind (T, E) the measures, as in `Solution.measured`.
    """
    vertices = (*graph.match.keypoints, *places_of(graph))
    found = {objective: np.zeros(len(graph)) for objective in PRINTED}
    for kind, values in measured.items():
        track = graph.kinds[kind]
        free = between_points(track, vertices)
        for objective, total in found.items():
            total += track.subset(free).stress(values[:, free], objective).sum(axis=1)
    return found


def places_of(graph: RobotGraph) -> dict[str, Floats]:
    """Return the places in the world at which added edges end, by name."""
    found = {}
    for track in graph.tracks:
        if isinstance(track.kind, OwnKind):
            for ends, names in zip(track.kind.ends, track.ends, strict=True):
                found |= {n: e for e, n in zip(ends, names, strict=True) if isinstance(e, np.ndarray)}
    return found


def between_points(track: Track, vertices: Collection[str]) -> np.ndarray:
    """Return (E,) which edges measure the distance of two vertices.

    Args:
        track: E edges of the kind over T frames.
        vertices: names of points.
    """
    return np.array([not track.axes and set(ends) <= set(vertices) for ends in track.ends], dtype=bool)


def _bones(graph: RobotGraph) -> Track:
    """Return the robot's bones with their lengths in its reference pose."""
    match, leg = graph.match, graph.match.robot_leg
    children = np.flatnonzero((match.parents >= 0) & (match.robot_bones > 0))
    ends = tuple((match.keypoints[match.parents[child]], match.keypoints[child]) for child in children)
    length = np.broadcast_to(match.robot_bones[children], (len(graph), len(ends)))
    return exact(BONE, ends, length, HARD, leg)
