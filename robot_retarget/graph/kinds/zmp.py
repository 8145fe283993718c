"""Zero moment point: where the contact forces of a motion push stays within the hull of the soles that stand.

Every link is a point mass at its centre; accelerations a are second differences over the frames t − 1, t and t + 1:

    p = Σ m ((a_z + g) x − a z) / Σ m (a_z + g)        along the floor, z above it

The hull is the smallest box around the standing soles along the line from one sole to the other, or along the one sole that
stands: the soles of both feet swept along that line fill it but for its corners.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from robot_retarget.graph.kind import Kind, RetargetContext, Track
from robot_retarget.graph.soles import HEEL, TOE, placed_feet
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import SECOND_DIFFERENCE
from robot_retarget.robot.kinematics import heavy_bodies

POINT = "zero moment point"
ALONG = ("along", "across")
"""Axes of the hull."""
BETWEEN = " and "
"""Between the names of two soles."""
LEVEL = 1e-9
"""Added to the squared length of the line between two soles [m²], which may be above each other."""
BRIEF = 0.05
"""Huber scale of the distance beyond the hull, over the leg [-]: the whole body does not move for one brief blow of an arm."""
LEAST_LOAD = 0.7
"""Least force across the floor, over the weight [-]: a smaller force, as before a flight, leaves a small moment wherever it pushes."""


@dataclass(frozen=True)
class ZmpKind(Kind):
    """How far the zero moment point is out of the hull of the soles that stand, along it and across it [m], at most 0."""

    name: str = "zmp"
    stencil: tuple[int, ...] = SECOND_DIFFERENCE
    planned: bool = True
    rate: float = 0.0
    """Frames per second [1/s]."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Two edges for every set of soles that may stand, π where it does; None among bodies, which are no level floor."""
        human, weight = context.human, context.weights.zmp
        feet = [foot for foot in placed_feet(context.match, context.robot) if foot in human.contacts]
        if weight == 0 or not feet or context.scene is not None:
            return None
        stands = {foot: human.contacts[foot].any(axis=1) & ~human.supported for foot in feet}
        sets = [(foot,) for foot in feet] + [tuple(feet)] * (len(feet) > 1)
        here = [np.logical_and.reduce([stands[foot] == (foot in own) for foot in feet]) for own in sets]
        priority = weight * np.repeat(np.stack(here, axis=1), len(ALONG), axis=1)
        ends = tuple((POINT, BETWEEN.join(own) + " sole") for own in sets for _ in ALONG)
        return Track(
            replace(self, rate=human.fps),
            ends,
            np.full(priority.shape, -np.inf),
            np.zeros(priority.shape),
            priority,
            np.full(len(ends), context.leg),
            ALONG * len(sets),
            BRIEF,
        )

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """How far the point is beyond the ends of the hull [m]."""
        point = self._point(body)
        found = [_beyond(point, body, end.removesuffix(" sole").split(BETWEEN)) for _, end in track.ends[:: len(ALONG)]]
        return ca.vertcat(*found)

    def _point(self, body: SymbolicRobot) -> ca.SX:
        """(2,) the zero moment point on the floor [m]."""
        bodies, model = heavy_bodies(body.robot), body.robot.model
        before, x, after = (
            ca.horzcat(*(body.at(k).point(int(b), model.body_ipos[b]) for b in bodies)) for k in self.stencil
        )
        gravity, mass = -model.opt.gravity[2], ca.DM(model.body_mass[bodies])
        a = self.rate**2 * (before - 2 * x + after)
        load = a[2, :].T + gravity
        total = ca.fmax(ca.dot(mass, load), LEAST_LOAD * gravity * ca.sum1(mass))
        return (x[:2, :] @ (mass * load) - a[:2, :] @ (mass * x[2, :].T)) / total


def _beyond(point: ca.SX, body: SymbolicRobot, feet: list[str]) -> ca.SX:
    """(2,) by how much a point (2,) is beyond the box around soles, along it and across it [m]."""
    soles = [[corner[:2] for corner in body.corners(foot)] for foot in feet]
    if len(soles) > 1:
        way = sum(soles[1]) - sum(soles[0])
    else:
        way = sum(soles[0][k] for k in TOE) - sum(soles[0][k] for k in HEEL)
    ahead = way / ca.sqrt(ca.sumsqr(way) + LEVEL)
    found = []
    for axis in (ahead, ca.vertcat(-ahead[1], ahead[0])):
        reach = [ca.dot(axis, corner) for sole in soles for corner in sole]
        own = ca.dot(axis, point)
        found.append(ca.fmax(own - ca.mmax(ca.vertcat(*reach)), ca.mmin(ca.vertcat(*reach)) - own))
    return ca.vertcat(*found)
