"""Kinds of surfaces: soles above the floor, links apart."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.graph.kind import ClipRows, Form, Kind, RetargetContext, Role, RowState, Track
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import limit
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.robot.distances import Separation as Surfaces
from robot_retarget.robot.geoms import allowed, solid_geoms

# Floor: the points of the soles stay above the floor.


class FloorKind(Kind):
    """The height of every sole point [m], at least 0."""

    name = "floor"
    role = Role.INEQUALITY
    follows_human = False
    raises_root = True

    def targets(self, context: RetargetContext) -> Track | None:
        """Return an edge from every sole point to the floor, its height within [0, ∞); None for a robot with a fixed root."""
        soles = context.match.anatomy.soles if context.robot.root_joints.size else {}
        ends = [(f"{foot} sole point {k}", "floor") for foot, sole in soles.items() for k in range(len(sole))]
        return limit(self, ends, 0.0, np.inf, len(context.human)) if ends else None

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Heights [m]."""
        found = []
        for name, _ in track.ends:
            foot, point = name.split(" sole point ")
            sole = body.match.anatomy.soles[foot]
            found.append(body.point(int(sole.bodies[int(point)]), sole.offsets[int(point)])[2])
        return ca.vertcat(*found)


# Separation: surfaces of links stay apart, by MuJoCo's distances; lying links stay above the floor.

FLOOR = "floor"


@dataclass(frozen=True)
class SeparationKind(Kind):
    """Distance of the surfaces of two links [m], at least the margin, or their distance at rest if that is smaller."""

    name: str = "separation"
    role = Role.INEQUALITY
    form = Form.NUMERIC
    follows_human = False
    margin: float = 0.006
    """Over the leg [-]: distances bend along a step, by a third of this. Half and double leave a dance of the G1 as it
    is (limbs to 0.01°), and raise the jerk of a boxing OP3 from 218 to 230 rad/s³."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Return [margin, ∞) for every pair of links that may touch, and [0, ∞) from the floor for links other than feet."""
        robot, body = context.robot, context.robot.model.body
        pairs = [(body(a).name, body(b).name) for a, b in sorted(allowed(robot))]
        feet = _feet(robot, context.match)
        lying = [] if feet is None else [(body(a).name, FLOOR) for a in solid_geoms(robot) if a not in feet]
        margins = np.repeat([self.margin * context.leg, 0.0], [len(pairs), len(lying)])
        ends = [*pairs, *lying]
        return limit(self, ends, margins, np.inf, len(context.human)) if ends else None

    def clip_rows(self, track: Track, states: RowState) -> ClipRows:
        """Return the distances of near surfaces; surfaces without an edge may overlap."""
        watched = _watched(track, states)
        found, slope = watched.surfaces.along(states.qpos, states.threads)
        pair = found.geoms @ (len(watched.edges), 1)
        edges, rest = watched.edges.take(pair), watched.surfaces.rest.take(pair)
        rows = ClipRows(found.frame, found.distance, slope, edges, rest)
        return rows if edges.min(initial=0) >= 0 else rows.some(np.flatnonzero(edges >= 0))

    def overlap(self, track: Track, states: RowState) -> Floats:
        """Return the depths of the deepest overlaps of two links [m]."""
        watched, found = _watched(track, states), np.zeros(len(states.qpos))
        for k, (depth, geoms) in enumerate(watched.surfaces.overlaps_along(states.qpos, states.threads)):
            if len(depth):
                found[k] = depth[watched.edges[tuple(geoms.T)] >= 0].max(initial=0.0)
        return found

    def penetration(self, track: Track, states: RowState) -> Floats:
        """Return the depths of the lowest links other than feet under the floor [m]."""
        return _watched(track, states).surfaces.floor_penetration(states.qpos)


@dataclass(frozen=True, eq=False)
class _Watched:
    """The surfaces of a track's edges. The floor is the geom −1, so the place of a pair in flat tables counts from the end."""

    surfaces: Surfaces
    edges: Ints
    """(G + 1, G + 1) the edge of every two geoms, −1 without one; the floor comes last."""


def _watched(track: Track, state: RowState) -> _Watched:
    if "watched" not in state.memory:
        robot = state.robot
        surfaces = Surfaces(robot, max(state.reach, 2 * float(track.lower.max())), _feet(robot, state.match))
        links = np.append(np.asarray(robot.model.body_weldid)[surfaces.model.geom_bodyid], robot.model.nbody)
        state.memory["watched"] = _Watched(surfaces, _edges(robot, track)[np.ix_(links, links)])
    return state.memory["watched"]


def _edges(robot: Robot, track: Track) -> Ints:
    """Return (B + 1, B + 1) the edge of every two bodies, −1 without one; the floor comes last."""
    names = [*(robot.model.body(body).name for body in range(robot.model.nbody)), FLOOR]
    places = {name: place for place, name in enumerate(dict.fromkeys(names))}
    ends = np.array([[places[a], places[b]] for a, b in track.ends], dtype=int).reshape(-1, 2)
    table, own = np.full((len(places),) * 2, -1), [places[name] for name in names]
    table[ends, ends[:, ::-1]] = np.arange(len(ends))[:, None]
    return table[np.ix_(own, own)]


def _feet(robot: Robot, match: Match) -> frozenset[int] | None:
    """Return the links with soles, which have their own rows over the floor; None for a robot that the floor cannot reach."""
    return frozenset(int(sole.bodies[0]) for sole in match.anatomy.soles.values()) if robot.root_joints.size else None
