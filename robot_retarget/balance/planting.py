"""Poses with the soles on given places and the centre of mass over a given spot, as near to a wished pose as they can be.

    minimise  Σ h ‖x_corner(q) − p‖²/ℓ²  +  m ‖x_mass(q) − c‖²/ℓ²  +  Σ w (q ⊖ q_wished)²

within joint ranges, above the floor, links apart: the frame solver's problem without any edge to a human.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.describe.match import Match
from robot_retarget.robot import Points, Robot
from robot_retarget.robot.kinematics import carrying, mass_function, point_function
from robot_retarget.robot.links import Links
from robot_retarget.solve.between import on_the_way
from robot_retarget.solve.compiled import dense_function
from robot_retarget.solve.footing import CORNERS, sole_corners
from robot_retarget.solve.frame import OVERLAP, Box, FrameSolver, Options
from robot_retarget.solve.problem import Problem
from robot_retarget.solve.quadratic import Pull

OVER = 3e3
"""Weight of the centre of mass along the floor, over the squared leg length: feet come first, all else after."""

MARGIN = 0.05
"""Arms stay this share of a leg apart from all else: servos lag, and links that are planned to pass closely touch ..."""
LEGS_MARGIN = 0.025
"""... and other links this share: legs lag less, have to pass each other in a step, and to bend under a trunk."""
SIGHT = 0.08
"""Links nearer than this share of a leg are watched."""
GLANCE = 0.02
"""As `Options.glance`: the far end of a limb moves by less than between what is watched and what is kept."""
BENT = 0.12
"""A knee is bent so far at least [rad]."""
CLEARANCE = 0.06
"""Hands stay this share of a leg over the floor."""
TOLERANCE = 1e-7
"""As `Options.tolerance`."""
ASTRAY = 0.5
"""A pose that costs more than this is sought again from elsewhere."""


@dataclass(frozen=True)
class Draw:
    """How strongly a pose is drawn to the wished one."""

    arms: float = 1.0
    """Hinges that no leg moves with: arms, head, waist [1/rad²]."""
    legs: float = 0.05
    """Hinges between pelvis and soles [1/rad²]."""
    tilt: float = 20.0
    """The root's orientation [1/rad²]."""
    travel: float = 0.1
    """The root's place along the floor, over the squared leg length."""
    height: float = 20.0
    """The root's height, over the squared leg length."""


class Planter:
    """Plants one robot: feet F in the order of `feet`, corners in `footing.CORNERS` order."""

    def __init__(self, robot: Robot, match: Match, draw: Draw | None = None):
        self.robot, self.feet = robot, tuple(match.anatomy.soles)
        self.leg, self.forward = match.robot_leg, match.anatomy.forward
        corners = [sole_corners(match.anatomy, foot) for foot in self.feet]
        self.soles = Points(np.concatenate([c.bodies for c in corners]), np.concatenate([c.offsets for c in corners]))
        problem = planting_problem(robot, match)
        self.solver = FrameSolver(problem, Options(tolerance=TOLERANCE, margin=MARGIN, reach=SIGHT, glance=GLANCE))
        self.solver.ranges = _knees_bent(robot, match)
        self.mass = dense_function("mass", *_mass(robot))
        self.weight = _weights(self.solver, match, draw or Draw())
        self.legs = _leg_dofs(self.solver, match)
        if self.solver.landscape.separation is not None:
            self.solver.landscape.separation.let_near(~_on_arms(robot, match), LEGS_MARGIN * self.leg)

    @property
    def leg_coordinates(self) -> Ints:
        """Where the hinges between pelvis and soles stand in qpos."""
        return self.robot.qpos_index[self.legs[self.robot.dof_index]]

    def corners(self, qpos: Floats) -> Floats:
        """(T, F, 4, 3) the soles' corners at configurations (T, nq) [m]."""
        return np.array([self.solver.corners(q) for q in qpos])

    def centres(self, qpos: Floats) -> Floats:
        """(T, 3) centres of mass [m]."""
        return np.array([self.mass(q)[0] for q in qpos])

    def plant(
        self,
        start: Floats,
        wished: Floats,
        places: Floats,
        centre: Floats | None,
        grip: Floats,
        steps: int = 8,
        box: Box | None = None,
        before: Floats | None = None,
    ) -> Floats:
        """A configuration (nq,) whose corners are at places (F, 4, 3) and whose mass stands over `centre` (2,).

        Args:
            start: from where to search.
            wished: what it is drawn to.
            grip: (F,) weights of the feet, over the squared leg length.
            box: what the hinges may be, if not all of their ranges.
            before: a configuration on the way from which links do not pass through each other.
        """
        h = np.repeat(grip, 3 * CORNERS)
        over = [0.0, 0.0, 0.0] if centre is None else [OVER, OVER, 0.0]
        spot = [0.0, 0.0, 0.0] if centre is None else [*centre, 0.0]
        pull = Pull(wished, np.zeros(self.robot.model.nv), self.weight)
        target = (h, places.ravel(), np.array(over), np.array(spot))
        found = self.solver.descend(start, target, pull=pull, iterations=steps, box=box)
        if found.cost > ASTRAY:
            again = self.solver.descend(wished, target, pull=pull, iterations=3 * steps, box=box)
            found = min(found, again, key=lambda pose: pose.cost)
        if before is not None and self.solver.depth_between(before, found.qpos) > OVERLAP:
            ways = on_the_way(self.robot, before, found.qpos)
            around = self.solver.descend(found.qpos, target, pull=pull, iterations=steps, box=box, between=ways)
            found = found if self.solver.overlapping(around.qpos) else around
        return self.solver.lifted(found).qpos


def planting_problem(robot: Robot, match: Match) -> Problem:
    """The functions of a frame without edges; its model takes (q, h, p, m, c): weights and places of corners and mass."""
    anatomy, feet = match.anatomy, tuple(match.anatomy.soles)
    soles = [anatomy.soles[foot] for foot in feet] + [sole_corners(anatomy, foot) for foot in feet]
    hands = _hand_boxes(robot, match)
    own = [hands, *soles]
    points = Points(np.concatenate([s.bodies for s in own]), np.concatenate([s.offsets for s in own]))
    held = 3 * CORNERS * len(feet)
    q, h, p = ca.MX.sym("q", robot.model.nq), ca.MX.sym("h", held), ca.MX.sym("p", held)
    m, c = ca.MX.sym("m", 3), ca.MX.sym("c", 3)
    x, jacobian = point_function(robot, points)(q)
    centre, slope = mass_function(robot)(q)
    rooted = ca.sqrt(ca.vertcat(h, m)) / match.robot_leg
    residual = rooted * ca.vertcat(x[-held:] - p, centre - c)
    rows = ca.diag(rooted) @ ca.vertcat(jacobian[-held:, :], slope)
    low = list(range(2, x.numel() - held, 3))
    over = x[low] - ca.DM([CLEARANCE * match.robot_leg if k < len(hands) else 0.0 for k in range(len(low))])
    outputs = [ca.sumsqr(residual), rows.T @ residual, rows.T @ rows, over, jacobian[low, :]]
    return Problem(
        robot,
        match,
        dense_function("planting", [q, h, p, m, c], outputs),
        dense_function("cost", [q, h, p, m, c], outputs[:1]),
        dense_function("stress", [q], [ca.MX(0, 1)]),
        dense_function("heights", [q], [x[low[len(hands) :]]]),
        dense_function("corners", [q], [x[-held:]]),
        feet,
        len(low),
    )


def _knees_bent(robot: Robot, match: Match) -> Box:
    """The joint ranges, less those in which a knee is straight or bent backward: there a leg has two ways to stand."""
    lower, upper = robot.lower.copy(), robot.upper.copy()
    for knee in ("l_knee", "r_knee"):
        own = robot.model.jnt_bodyid[robot.joint_ids] == match.anatomy.spots[knee].body
        for hinge in np.flatnonzero(own)[-1:]:
            if abs(upper[hinge]) > abs(lower[hinge]):
                lower[hinge] = max(lower[hinge], BENT)
            else:
                upper[hinge] = min(upper[hinge], -BENT)
    return Box(lower, upper)


def _hand_boxes(robot: Robot, match: Match) -> Points:
    """The corners of a box around each forearm's end, in its body's frame: a hand on the floor tips a robot over."""
    links, bodies, offsets = Links(robot), [], []
    for hand in ("l_hand", "r_hand"):
        if hand not in match.anatomy.spots:
            continue
        link = links.links_of(match.anatomy.spots[hand].body)
        surface = np.concatenate([links.surface(k) for k in link])
        local = np.array([links.local(link[0], point) for point in surface])
        ends = np.stack([local.min(axis=0), local.max(axis=0)])
        box = [[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
        bodies, offsets = [*bodies, *[link[0]] * len(box)], [*offsets, *box]
    return Points(np.array(bodies, int), np.array(offsets).reshape(-1, 3))


def _mass(robot: Robot) -> tuple[list[ca.MX], list[ca.MX]]:
    q = ca.MX.sym("q", robot.model.nq)
    return [q], [mass_function(robot)(q)[0]]


def _weights(solver: FrameSolver, match: Match, draw: Draw) -> Floats:
    """(nv,) of the pull: root, legs and the rest."""
    robot = solver.robot
    weight = np.where(_leg_dofs(solver, match), draw.legs, draw.arms)
    first = int(robot.model.jnt_dofadr[robot.root_joints[0]])
    along, across = draw.travel / solver.leg**2, draw.height / solver.leg**2
    weight[first : first + 6] = [along, along, across, draw.tilt, draw.tilt, draw.tilt]
    return weight


def _on_arms(robot: Robot, match: Match) -> np.ndarray:
    """(B,) bodies that a hinge between chest and hands moves."""
    moves, spots = carrying(robot.model), match.anatomy.spots
    hands = [moves[spots[hand].body] for hand in ("l_hand", "r_hand") if hand in spots]
    chest = moves[match.anatomy.frames["chest"][0]]
    return np.asarray(moves[:, np.logical_or.reduce([*hands, chest]) & ~chest].any(axis=1))


def _leg_dofs(solver: FrameSolver, match: Match) -> np.ndarray:
    """(nv,) whether a dof moves a sole but not the pelvis."""
    moves = carrying(solver.robot.model)
    pelvis = moves[match.anatomy.spots["pelvis"].body]
    soles = [moves[int(sole.bodies[0])] for sole in match.anatomy.soles.values()]
    return np.logical_or.reduce(soles) & ~pelvis
