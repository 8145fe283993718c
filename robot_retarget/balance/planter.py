"""Frames of a graph with the soles on given places and the centre of mass over given spots.

Two kinds of edges more than the human asks for, `foothold` at places that balance chooses and `mass`, and the same solver:
arms, trunk and head follow the human's distances and directions as far as feet and mass let them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.graph import Graph
from robot_retarget.describe.kinds.mass import Mass
from robot_retarget.describe.soles import CORNERS, sole_corners
from robot_retarget.describe.track import HARD, Track
from robot_retarget.human.match import Match
from robot_retarget.robot import Points, Robot, world_points
from robot_retarget.robot.kinematics import carrying, mass_function
from robot_retarget.solve.compiled import dense_function
from robot_retarget.solve.options import Options
from robot_retarget.solve.problem import build_problem, wishes_of
from robot_retarget.solve.sqp import Box, FrameSolver


@dataclass(frozen=True)
class PlantOptions:
    """How a planted robot is held; lengths are shares of a leg."""

    margin: float = 0.05
    """Arms stay so far from all else: servos lag, and links that are planned to pass closely touch ..."""
    legs_margin: float = 0.025
    """... and other links: legs lag less, have to pass each other in a step, and to bend under a trunk."""
    reach: float = 0.08
    """Links nearer than this are watched."""
    speed: float = 0.8
    """Share of the joints' speeds that is used: servos under load are slower."""
    bent: float = 0.12
    """A knee is bent so far at least: nearly straight, a leg has two ways to stand [rad]."""
    swing: float = 1e3
    """π of a swing foot on its way, over the squared leg."""
    height: float = 20.0
    """π of the pelvis' height, over the squared leg."""
    upright: float = 20.0
    """π of the pelvis' orientation in a stand, and of its joints [1/rad²] as the robot stands ..."""
    standing: float = 1.0
    """... which a lead-in comes from and a lead-out goes to."""
    crouch: float = 0.04
    """The pelvis of a stand is so much lower than in the robot's standing pose: straight knees cannot shift weight."""


class Planter:
    """Plants the robot of one graph: feet F in the order of `feet`, corners in the order of `soles.CORNER_NAMES`."""

    def __init__(self, graph: Graph, options: PlantOptions | None = None):
        self.graph, self.robot, self.match, self.options = graph, graph.robot, graph.match, options or PlantOptions()
        self.leg, self.feet = graph.match.robot_leg, tuple(graph.match.anatomy.soles)
        own = self.options
        tracks = [*graph.tracks, Mass().track(np.zeros((len(graph), 2)), self.leg)]
        problem = build_problem(self.robot, self.match, tracks, native=True)
        self.solver = FrameSolver(problem, Options(margin=own.margin, reach=own.reach, speed=own.speed))
        self.solver.ranges = knees_bent(self.robot, self.match, own.bent)
        if self.solver.costs.separation is not None:
            self.solver.costs.separation.let_near(~_on_arms(self.robot, self.match), own.legs_margin * self.leg)
        q = ca.MX.sym("q", self.robot.model.nq)
        self._mass = dense_function("mass", [q], [mass_function(self.robot)(q)[0]])

    def corners(self, qpos: Floats) -> Floats:
        """(T, F, 4, 3) the soles' corners at configurations (T, nq) [m]."""
        found = [world_points(self.robot, sole_corners(self.match.anatomy, foot), qpos) for foot in self.feet]
        return np.stack(found, axis=1)

    def centres(self, qpos: Floats) -> Floats:
        """(T, 3) centres of mass [m]."""
        return np.array([self._mass(q)[0] for q in qpos])

    @cached_property
    def soles(self) -> Points:
        """All corners of all soles."""
        corners = [sole_corners(self.match.anatomy, foot) for foot in self.feet]
        return Points(np.concatenate([c.bodies for c in corners]), np.concatenate([c.offsets for c in corners]))

    @cached_property
    def leg_dofs(self) -> np.ndarray:
        """(nv,) whether a dof moves a sole but not the pelvis."""
        moves = carrying(self.robot.model)
        soles = [moves[int(sole.bodies[0])] for sole in self.match.anatomy.soles.values()]
        return np.logical_or.reduce(soles) & ~moves[self.match.anatomy.spots["pelvis"].body]

    @property
    def leg_coordinates(self) -> np.ndarray:
        """Where the hinges between pelvis and soles stand in qpos."""
        return self.robot.qpos_index[self.leg_dofs[self.robot.dof_index]]

    def planted(self, tracks: Sequence[Track], places: Floats, planted: np.ndarray, centre: Floats) -> list[Track]:
        """Tracks (K frames) with soles at places (K, F, 4, 3), feet (K, F) planted, and mass over spots (K, 2) [m]."""
        grip = np.where(planted, HARD, self.options.swing)
        priority = np.repeat(grip, 3 * CORNERS, axis=1)
        flat = places.reshape(len(places), -1)
        feet = [
            replace(track, lower=flat, upper=flat, priority=priority) if track.name == "foothold" else track
            for track in tracks
        ]
        return [*feet, Mass().track(centre, self.leg)]

    def stand(self, start: Floats, places: Floats, centre: Floats) -> Floats:
        """(nq,) the balanced stand: soles on places (F, 4, 3), mass over a spot (2,), all else as the robot stands."""
        tracks = self.planted(self._as_standing(start), places[None], np.ones((1, len(self.feet)), bool), centre[None])
        pose = self.solver.descend(start, wishes_of(tracks).at(0), iterations=60, tolerance=1e-7)
        return self.solver.lifted(pose).qpos

    def _as_standing(self, start: Floats) -> list[Track]:
        """One frame that asks for joints as the robot stands, and the pelvis as it is in a configuration."""
        found = []
        for track in self.graph.tracks:
            one = track.at([0])
            measured = self.measured(track.name, start)[None]
            if track.name == "rest":
                one = replace(one, priority=np.full((1, len(track)), self.options.standing))
            elif track.name in ("path", "orientation"):
                own = [
                    a == "pelvis" and axis == "z" if track.name == "path" else a == "pelvis"
                    for (a, _), axis in zip(track.ends, track.axes, strict=True)
                ]
                weight = np.where(own, self.options.upright, 0.0)[None]
                one = replace(one, lower=measured, upper=measured, priority=weight)
            else:
                one = one.weighed(0.0)
            found.append(one)
        return found

    def measured(self, kind: str, qpos: Floats) -> Floats:
        """(E,) what the edges of a kind measure at a configuration."""
        first = 0
        for track in self.graph.tracks:
            if track.name == kind:
                return self.solver.problem.values(qpos)[first : first + len(track)]
            first += len(track)
        return np.zeros(0)


def knees_bent(robot: Robot, match: Match, bent: float) -> Box:
    """The joint ranges, less those in which a knee is straight or bent backward."""
    lower, upper = robot.lower.copy(), robot.upper.copy()
    for knee in ("l_knee", "r_knee"):
        own = robot.model.jnt_bodyid[robot.joint_ids] == match.anatomy.spots[knee].body
        for hinge in np.flatnonzero(own)[-1:]:
            if abs(upper[hinge]) > abs(lower[hinge]):
                lower[hinge] = max(lower[hinge], bent)
            else:
                upper[hinge] = min(upper[hinge], -bent)
    return Box(lower, upper)


def _on_arms(robot: Robot, match: Match) -> np.ndarray:
    """(B,) bodies that a hinge between chest and hands moves."""
    moves, spots = carrying(robot.model), match.anatomy.spots
    hands = [moves[spots[hand].body] for hand in ("l_hand", "r_hand") if hand in spots]
    chest = moves[match.anatomy.frames["chest"][0]]
    return np.asarray(moves[:, np.logical_or.reduce([*hands, chest]) & ~chest].any(axis=1))
