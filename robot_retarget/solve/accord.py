"""Footholds in accord: feet that stand at once stand so that a pose can keep both.

Each foothold alone is where the draft put a foot on the whole. Two such may lie nearer than soles come, or turned further
from each other than hips turn, above all where a human turns on the spot, and then no pose keeps both. So the robot is
sent to every two that are held at once; where it cannot keep them they give way to how it then stands to them, by least
squares over all footholds, turned first and then shifted. Along the floor, places are complex numbers x + iy.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import Edges
from robot_retarget.solve.footing import Foothold, lengths
from robot_retarget.solve.frame import FrameSolver
from robot_retarget.solve.problem import frame_parameters
from robot_retarget.solve.starts import ROUGHLY

KEPT = 0.01
"""Footholds are kept when no held corner is further from its place along the floor, over the leg length."""
STEPS = 4
"""So many steps may lead there from the draft, half as many as there are passes: what is further off they do not reach."""
TOGETHER = 30.0
"""How much more a frame counts for how two feet stand to each other than for where each does."""
KNOWN = 1e6
"""Weight of a foothold that does not give way."""

Places = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two footholds that are held at once, and how the feet should stand to each other."""

    one: int
    other: int
    frames: int
    """How long both are held."""
    kept: bool
    """Whether a pose keeps both."""
    corners: Floats
    """(2, 4, 3) of the two feet as they can stand [m]: where they are held if that is kept, else where they were on the way
    there, or in the draft if links were inside each other by then."""
    held: np.ndarray
    """(2, 4)."""

    def turn(self, corners: Floats) -> complex:
        """How the second of two soles (2, 4, 3) is turned from the first, as a unit number."""
        first, second = _along(lengths(corners))
        return (second / first) / abs(second / first)

    def apart(self, corners: Floats) -> complex:
        """From the held corners of the first of two soles (2, 4, 3) to those of the second."""
        first, second = (_along(sole[held]).mean() for sole, held in zip(corners, self.held, strict=True))
        return second - first


def in_accord(
    solver: FrameSolver, edges: Edges, held: np.ndarray, draft: list[Floats], footholds: list[Foothold]
) -> list[Foothold]:
    """The footholds, turned and shifted along the floor where two that are held at once cannot be kept."""
    pairs = [
        _tried(solver, edges, held, draft, footholds, one, other)
        for one, other in combinations(range(len(footholds)), 2)
        if _at_once(footholds[one], footholds[other])
    ]
    if all(pair.kept for pair in pairs):
        return footholds
    return _shifted(_turned(footholds, pairs), pairs)


def _at_once(one: Foothold, other: Foothold) -> range:
    """The frames in which two feet are held."""
    return range(max(one.start, other.start), min(one.stop, other.stop)) if one.foot != other.foot else range(0)


def _tried(
    solver: FrameSolver,
    edges: Edges,
    held: np.ndarray,
    draft: list[Floats],
    footholds: list[Foothold],
    one: int,
    other: int,
) -> Pair:
    """Send the robot to two footholds, from the draft at the middle of the time both are held."""
    both, feet = _at_once(footholds[one], footholds[other]), [footholds[one].foot, footholds[other].foot]
    t = both[len(both) // 2]
    seen = solver.corners(draft[t])
    places = seen.copy()
    places[feet] = footholds[one].corners, footholds[other].corners
    wished = (*frame_parameters(edges, t), *solver.grip.lead(held[t], places, np.zeros(len(places))))
    pose = solver.descend(draft[t], wished, iterations=STEPS, tolerance=ROUGHLY)
    reached = solver.corners(pose.qpos)
    missed = np.linalg.norm((reached - places)[held[t]][:, :2], axis=1).max()
    kept = bool(missed < KEPT * solver.leg)
    able = places if kept else seen if solver.overlapping(pose.qpos) else reached
    return Pair(one, other, len(both), kept, able[feet], held[t, feet])


def _turned(footholds: list[Foothold], pairs: list[Pair]) -> list[Foothold]:
    """Footholds turned about their middles."""
    missing = [np.angle(pair.turn(pair.corners) / pair.turn(_corners(footholds, pair))) for pair in pairs]
    turns = np.exp(1j * given_way(footholds, pairs, np.array(missing)))
    middles = [_along(f.corners).mean() for f in footholds]
    along = [m + u * (_along(f.corners) - m) for f, m, u in zip(footholds, middles, turns, strict=True)]
    return [_at(f, places) for f, places in zip(footholds, along, strict=True)]


def _shifted(footholds: list[Foothold], pairs: list[Pair]) -> list[Foothold]:
    """Footholds moved along the floor; how feet should stand to each other turns as they have turned."""
    missing = []
    for pair in pairs:
        here = _corners(footholds, pair)
        spin = (_along(lengths(here)) / _along(lengths(pair.corners))).sum()
        missing.append(spin / abs(spin) * pair.apart(pair.corners) - pair.apart(here))
    shifts = given_way(footholds, pairs, np.array(missing))
    return [_at(f, _along(f.corners) + shift) for f, shift in zip(footholds, shifts, strict=True)]


def given_way(footholds: list[Foothold], pairs: list[Pair], missing: NDArray) -> NDArray:
    """x that minimises Σ frames |x_k|² + `TOGETHER` Σ frames |x_other − x_one − missing|², over footholds and pairs."""
    firm = np.array([KNOWN if f.known else float(f.stop - f.start) for f in footholds])
    weight = TOGETHER * np.array([float(pair.frames) for pair in pairs])
    difference = np.zeros((len(pairs), len(footholds)))
    for row, pair in zip(difference, pairs, strict=True):
        row[[pair.one, pair.other]] = -1, 1
    normal = np.diag(firm) + difference.T @ (weight[:, None] * difference)
    return np.linalg.solve(normal, difference.T @ (weight * missing))


def _corners(footholds: list[Foothold], pair: Pair) -> Floats:
    return np.stack([footholds[pair.one].corners, footholds[pair.other].corners])


def _along(points: Floats) -> Places:
    return points[..., 0] + 1j * points[..., 1]


def _at(foothold: Foothold, places: Places) -> Foothold:
    return replace(foothold, corners=np.stack([places.real, places.imag, foothold.corners[:, 2]], axis=-1))
