"""Frames of a graph with the soles at given places and the centre of mass over given points.

The same solver runs with two additional kinds of edges, `foothold` at places that balance chooses and `mass`. Arms,
trunk and head follow the human's distances and directions as far as feet and mass allow.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, bearing
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.kind import PlaybackFrames
from robot_retarget.graph.kinds.pose import MassKind
from robot_retarget.graph.kinds.separation import FLOOR
from robot_retarget.graph.soles import flattened, heading, lengths
from robot_retarget.graph.track import HARD, Form, Role, Track
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Points, Robot, world_points
from robot_retarget.robot.kinematics import carrying, mass_function
from robot_retarget.robot.support import CORNERS, sole_corners, support
from robot_retarget.solver.balance.turns import TURN
from robot_retarget.solver.clip import measured_by
from robot_retarget.solver.compiled import Mapped
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.problem import build_problem
from robot_retarget.solver.sqp import FrameSolver


@dataclass(frozen=True)
class BalanceOptions:
    """Options of a planted robot; lengths are shares of a leg."""

    margin: float = 0.035
    """Distance between links, except two of legs: arms that lag meet knees in a walk with less, thighs meet the trunk in a squat with more. Half
    changes the limbs of the sample walk on the OP3 by 0.05°; with double its steps are 0.77 as long."""
    legs: float = 0.012
    """Distance between two links of legs. With 0.006, 0.012, 0.0175 and 0.035 soles of the OP3 slip by 4, 4, 11 and 18 mm in `test_freebvh_walk`,
    where hips keep planted soles that point apart off their places; with 0.006 by 11 mm in a walk of an 8, in which they slip by less with the others."""
    arms: float = 0.06
    """Distance of arms from legs that step: with 0.035 forearms of the OP3 pass thighs and knees within a millimetre between two frames and
    catch on them, 9 of 10 simulations of `02_01` and `walk_01` in soft worlds fall; with 0.06 none does."""
    speed: float = 0.8
    """Usable share of the joints' speeds: servos under load are slower. With half the sample walk takes 1.69 instead of 1.03
    times the human's time."""
    bent: float = 0.03
    """Least bend of a knee: a straight leg has two ways to bend [rad]. Knees of the OP3 rest at 0.33–0.55 of their stall torque in
    long steps with a bend of 0.12."""
    swing: float = 1e3
    """π of a swing foot on its path, over the squared leg. In the sample walk, half turns the trunk 0.3° nearer to the human's, and double makes the
    soles slip by 4 instead of 1 mm."""
    height: float = 1000.0
    """π of the pelvis' height, over the squared leg: bent knees carry more. With 400 walks of the OP3 take up to 7 % longer, and its legs are
    as near to the human's within 0.3°."""
    trunk: float = 15.0
    """Factor of π of a trunk's lean: the OP3 leans 5 instead of 8° from the human's in walks, and its legs are as near. With 40
    trunks of three walks are 1.2° nearer, but a turn by 170° on the spot falls."""
    upright: float = 20.0
    """π of the pelvis' orientation in a stand, and of its joints at their standing angles [1/rad²] (half and double change nothing in the sample walk) ..."""
    standing: float = 1.0
    """... from which a lead-in starts and at which a lead-out ends."""


NUDGE = 0.1
"""Angle by which hinges turn to see which of them turn a foot by as much about the vertical, to within a tenth [rad]. Half and double find the
same on the OP3."""


class BalancedIk:
    """Plant the robot of one graph: feet F in the order of `feet`, corners in the order of `robot.support.CORNER_NAMES`."""

    robot: Robot
    match: Match
    options: BalanceOptions
    leg: float
    feet: tuple[str, ...]

    def __init__(self, graph: RobotGraph, options: BalanceOptions | None = None):
        self.robot, self.match, self.options = graph.robot, graph.match, options or BalanceOptions()
        self.leg, self.feet = graph.match.robot_leg, tuple(graph.match.anatomy.soles)
        own = self.options
        bent, (_, legs, others) = with_bent_knees(graph, own.bent), self.limbs
        near = with_margin(bent, self.leg * own.legs, (legs, legs))
        self.graph: RobotGraph = with_margin(near, self.leg * own.margin, (others, others | legs))
        """The graph with the limits of a playback."""
        tracks = [*self.graph.tracks, MassKind().track(np.zeros((len(graph), 2)), self.leg)]
        problem = build_problem(self.robot, self.match, tracks, native=True)
        self.solver: FrameSolver = FrameSolver(problem)
        q = ca.MX.sym("q", self.robot.model.nq)
        self._mass = Mapped(ca.Function("mass", [q], [ca.densify(mass_function(self.robot)(q)[0])]))

    def corners(self, qpos: Floats) -> Floats:
        """Return (T, F, 4, 3) the soles' corners at configurations (T, nq) [m]."""
        found = [world_points(self.robot, sole_corners(self.match.anatomy, foot), qpos) for foot in self.feet]
        return np.stack(found, axis=1)

    def centres(self, qpos: Floats) -> Floats:
        """Return (T, 3) centres of mass [m]."""
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
        return np.logical_or.reduce(soles) & ~moves[self.match.anatomy.sites["pelvis"].body]

    @cached_property
    def limbs(self) -> tuple[set[str], set[str], set[str]]:
        """The links of the arms, those of the legs, and all others than legs with the floor."""
        model, sites, moves = self.robot.model, self.match.anatomy.sites, carrying(self.robot.model)
        hands = [moves[sites[elbow].body] for elbow in ("l_elbow", "r_elbow") if elbow in sites]
        arms = np.any(hands, axis=0) & ~moves[sites["chest" if "chest" in sites else "pelvis"].body] & ~self.leg_dofs
        names = [model.body(body).name for body in range(model.nbody)]
        first, second = (
            {names[k] for k in np.flatnonzero((moves & dofs).any(axis=1))} for dofs in (arms, self.leg_dofs)
        )
        return first, second, {FLOOR, *names} - second

    @cached_property
    def turn(self) -> float:
        """`turns.TURN`, or what hips twist either way from the standing pose if that is less [rad]; infinite if they do not: the feet then take no turns."""
        robot, own = self.robot, self.robot.standing()
        nudged, angles = np.tile(own, (len(robot.qpos_index) + 1, 1)), own[robot.qpos_index]
        nudged[1:, robot.qpos_index] += NUDGE * np.eye(len(angles))
        headings = bearing(lengths(self.corners(nudged)))
        upright = (np.abs(np.sin(headings[1:] - headings[0])) > 0.9 * NUDGE).any(axis=1)
        room = np.minimum(robot.upper - angles, angles - robot.lower)[upright]
        return min(TURN, float(room.min())) if room.size else np.inf

    @property
    def leg_coordinates(self) -> np.ndarray:
        """Indices in qpos of the hinges between pelvis and soles."""
        return self.robot.qpos_index[self.leg_dofs[self.robot.dof_index]]

    def playback(self, share: Floats, places: Floats, planted: np.ndarray) -> PlaybackFrames:
        """Return K frames with a share (K, 1) of the human's motion, soles at (K, F, 4, 3) [m], feet (K, F) planted."""
        return PlaybackFrames(share, *self._soles(places, planted), *self._pulls)

    def stand(self, start: Floats, places: Floats, centre: Floats, frame: int = 0) -> Floats:
        """Return (nq,) the standing pose in balance among the bodies of a frame: soles at places (F, 4, 3), mass over a point (2,)."""
        both = np.ones((1, len(self.feet)), bool)
        stand = PlaybackFrames(np.zeros((1, 1)), *self._soles(places[None], both), *self._pulls)
        measured = measured_by(self.solver.problem, self.graph, start[None])
        tracks = [track.kind.stood(track.at([frame]), measured, stand) for track in self.graph.tracks]
        targets = targets_of([*tracks, MassKind().track(centre[None], self.leg)]).at(0)
        pose = self.solver.solve_frame(start, targets, iterations=60, tolerance=1e-7)
        return self.solver.raise_above_floor(pose, targets).qpos

    def targets(
        self, graph: RobotGraph, at: Floats, stands: Sequence[Floats], playback: PlaybackFrames, centre: Floats
    ) -> list[Track]:
        """Return the tracks of a playback.

        Args:
            graph: the human's targets, frame by frame of the clip.
            at: (K,) the frame of the clip at each frame of the playback.
            stands: the configurations (nq,) before and after.
            centre: (K, 2) places of the centre of mass [m].
        """
        first = np.arange(len(at))[:, None] < len(at) // 2
        before, after = (measured_by(self.solver.problem, self.graph, stand[None]) for stand in stands)
        measured = {name: np.where(first, values, after[name]) for name, values in before.items()}
        tracks = [track.kind.played(track.resampled(at), measured, playback) for track in graph.tracks]
        return [*tracks, MassKind().track(centre, self.leg)]

    def _soles(self, places: Floats, planted: np.ndarray) -> tuple[Floats, Floats]:
        """Return places (K, F · 4 · 3) of the sole corners [m], and π of these."""
        grip = np.repeat(np.where(planted, HARD, self.options.swing), 3 * CORNERS, axis=1)
        return places.reshape(len(places), -1), grip

    @property
    def _pulls(self) -> tuple[float, float, float, float]:
        return self.options.standing, self.options.upright, self.options.height, self.options.trunk


def with_bent_knees(graph: RobotGraph, bent: float) -> RobotGraph:
    """Return the graph with joint ranges that exclude knees that are straight or bent backward."""
    robot, anatomy = graph.robot, graph.match.anatomy
    for knee in ("l_knee", "r_knee"):
        own = robot.model.jnt_bodyid[robot.joint_ids] == anatomy.sites[knee].body
        own &= robot.lower < robot.upper  # a frozen knee keeps its angle
        for hinge in np.flatnonzero(own)[-1:].tolist():
            ends = robot.joint_names[hinge], "zero"
            lower, upper = float(robot.lower[hinge]), float(robot.upper[hinge])
            if abs(upper) > abs(lower):
                graph = graph.with_bounds(ends, lower=max(lower, bent))
            else:
                graph = graph.with_bounds(ends, upper=min(upper, -bent))
    return graph


def with_margin(graph: RobotGraph, margin: float, between: tuple[set[str], set[str]]) -> RobotGraph:
    """Return the graph with a margin between surfaces of links [m], which fades out where the human's parts touch.

    Bodies keep theirs, which feet come near to on purpose. The floor has the margin too: a link on it counts as a fall.

    Args:
        between: these links and those, by their names.
    """
    kinds = [(track.role, track.kind.form, track.kind.bodies(track)) for track in graph.tracks]
    tracks = (
        track.bounded(np.where(_joining(track, between), _faded(graph, track, margin), track.lower), np.inf)
        if kind == (Role.INEQUALITY, Form.NUMERIC, None)
        else track
        for track, kind in zip(graph.tracks, kinds, strict=True)
    )
    return replace(graph, tracks=tuple(tracks))


def _faded(graph: RobotGraph, track: Track, margin: float) -> Floats:
    """Return (T, E) margins of links [m]: at the strength s of a touch m − s (m − own)."""
    faded, model = np.full_like(track.lower, margin), graph.robot.model
    touches = [each for each in graph.tracks if each.name == "touch"]
    for touch, k in ((each, k) for each in touches for k in np.flatnonzero(each.priority.any(axis=0))):
        sites = (graph.match.anatomy.sites[end].body for end in touch.ends[k])
        joined = track.joins(*(model.body(int(model.body_weldid[body])).name for body in sites))
        share = np.minimum(touch.priority[:, k : k + 1] / graph.weights.touch, 1.0)
        faded[:, joined] = np.minimum(faded, margin - share * (margin - track.lower))[:, joined]
    return faded


def _joining(track: Track, between: tuple[set[str], set[str]]) -> np.ndarray:
    """Return (E,) which edges join a link of one set and a link of the other."""
    return np.array([any(a in one and b in other for one, other in (between, between[::-1])) for a, b in track.ends])


# The balanced stand at both ends of every free-standing playback, and a human who stays in place.

SETTLE = 1.0
"""Slower turns of a human are part of walking; faster turns happen over standing feet [s]."""


def stand_places(ik: BalancedIk) -> Floats:
    """Return (F, 4, 3) soles of the robot's standing pose, flat on the floor, around the origin, ahead along x [m]."""
    places = flattened(ik.corners(ik.robot.standing()[None])[0])
    turn = Rotation.from_euler("z", heading(places)).as_matrix()
    return (places - places.mean(axis=(0, 1))) @ turn


def balanced_stand(ik: BalancedIk, places: Floats, frame: int = 0) -> Floats:
    """Return the standing pose with its mass over the middle of its support.

    Args:
        ik: solves the pose.
        places: (F, 4, 3) corners of the soles [m].
        frame: whose bodies are around.

    Returns:
        (nq,) configuration.
    """
    own = flattened(ik.corners(ik.robot.standing()[None])[0])
    turn, address = float(heading(places) - heading(own)), ik.robot.root_address
    posed, spin = np.array(ik.robot.standing()), Rotation.from_euler("z", turn)
    root = posed[address : address + 3] - own.mean(axis=(0, 1))
    posed[address : address + 3] = spin.apply(root) + places.mean(axis=(0, 1))
    posed[address + 2] -= (ik.corners(posed[None])[0] - places)[..., 2].mean()
    turned = spin * Rotation.from_quat(posed[address + 3 : address + 7], scalar_first=True)
    posed[address + 3 : address + 7] = turned.as_quat(scalar_first=True)
    return ik.stand(posed, places, support(places.reshape(-1, 3)).middle, frame)


def in_place(human: HumanFeatures, match: Match, turning: bool = False) -> tuple[HumanFeatures, Floats]:
    """Return the human over standing feet, without travel and slow turns; and these turns (T,) [rad].

    All directions turn back about the vertical by the smoothed heading of the human, unless the feet are `turning` with it. The pelvis stays over the
    origin, and both feet stand throughout.
    """
    slow = gaussian_filter1d(np.unwrap(bearing(human.heading)), SETTLE * human.fps, mode="nearest") * (not turning)
    back = Rotation.from_euler("z", -slow[:, None]).as_matrix()
    pelvis = match.index("pelvis") if "pelvis" in match.keypoints else 0
    centred = human.positions - human.positions[:, pelvis : pelvis + 1] * [1.0, 1.0, 0.0]
    contacts = human.contacts
    standing = replace(
        human,
        positions=np.einsum("tij,tkj->tki", back, centred),
        axes=back[:, None] @ human.axes,
        contacts=replace(contacts, down=np.ones_like(contacts.down), stands=np.ones_like(contacts.stands)),
    )
    return standing, slow


def posed_in_place(ik: BalancedIk, draft: Floats, turns: Floats, stand: Floats) -> Floats:
    """Return a draft's upper body over the legs of a stand.

    Args:
        ik: knows the coordinates of the legs.
        draft: (T, nq) configurations.
        turns: (T,) turns of the root about the vertical that are undone [rad].
        stand: (nq,) configuration: gives the legs, the place of the root and its largest height.

    Returns:
        (T, nq) starts of the frames.
    """
    posed, address, legs = np.array(draft), ik.robot.root_address, ik.leg_coordinates
    posed[:, legs] = stand[legs]
    posed[:, address : address + 2] = stand[address : address + 2]
    posed[:, address + 2] = np.minimum(draft[:, address + 2], stand[address + 2])
    own = Rotation.from_quat(draft[:, address + 3 : address + 7], scalar_first=True)
    turned = Rotation.from_euler("z", -turns[:, None]) * own
    posed[:, address + 3 : address + 7] = turned.as_quat(scalar_first=True)
    return posed
