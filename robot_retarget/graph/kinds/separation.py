"""Separation: surfaces of links stay apart, by MuJoCo's distances; lying links stay above the floor."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.graph.kinds.kind import FRAME, RetargetContext, Role
from robot_retarget.graph.track import Track, limit
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.robot.geoms import allowed
from robot_retarget.robot.separation import Separation as Surfaces


@dataclass(frozen=True)
class SeparationKind:
    """Distance of the surfaces of two links [m], at least the margin, or their distance at rest if that is smaller."""

    name: str = "separation"
    role: Role = Role.INEQUALITY
    stencil: tuple[int, ...] = FRAME
    margin: float = 0.006
    """Over the leg [-]: distances bend along a step, by a third of this."""

    def targets(self, context: RetargetContext) -> Track | None:
        """[margin, ∞) for every pair of links that may touch."""
        body = context.robot.model.body
        ends = [(body(a).name, body(b).name) for a, b in sorted(allowed(context.robot))]
        return limit(self, ends, self.margin * context.leg, np.inf, len(context.human)) if ends else None

    def proximity(self, track: Track, robot: Robot, match: Match, reach: float) -> Surfaces:
        """Return the distances of the track's pairs; a pair without an edge may overlap."""
        feet = frozenset(int(sole.bodies[0]) for sole in match.anatomy.soles.values())
        margins = track.lower[0]
        farthest = max(reach, 2 * float(margins.max()))  # a step may cover the second half
        surfaces = Surfaces(robot, farthest, float(margins.max()), feet=feet if robot.root_joints.size else None)
        own = {frozenset(ends): margin for ends, margin in zip(track.ends, margins, strict=True)}
        names = [robot.model.body(int(link)).name for link in np.asarray(robot.model.body_weldid)]
        table = np.array([[own.get(frozenset((a, b)), -np.inf) for b in names] for a in names])
        links = np.asarray(surfaces.model.geom_bodyid)
        surfaces.rest[:] = np.minimum(surfaces.rest, table[links[:, None], links])
        return surfaces
