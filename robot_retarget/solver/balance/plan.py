"""A clip laid out in time, from a stand at its pace into a stand, with its targets and its supports."""

from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy import sparse

from robot_retarget.base.arrays import JERK_PEAK, Floats, Ints, minimum_jerk
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.support import Planes, Polygon, joined, level_planes, planes_through, support
from robot_retarget.robot.timing import sample
from robot_retarget.scene.geoms import SolidGround
from robot_retarget.solver.balance.balanced_ik import BalancedIk, balanced_stand, stand_places
from robot_retarget.solver.balance.footsteps import LEAST_GAP, foothold_places, gaps, laid_on
from robot_retarget.trajectory import Trajectory

# A path of the centre of mass over a clip, planned with preview: one quadratic program over all frames.
#
#     minimise  Σ ‖c_t − c⁰_t‖² + w Σ ‖p_t − m_t‖² + j Σ ‖c_{t+3} − 3c_{t+2} + 3c_{t+1} − c_t‖² (rate)⁶ + penalty Σ s_t²
#     subject to  A_t c_t ≤ b_t + s_t   (static)      A_t (c_t − (z_t/g) c̈_t + d_t) ≤ b_t + s_t   (zero moment point)
#
# with the zero moment points p_t = c_t − (z_t/g) c̈_t + d_t, the middles m_t of the supports, and the support polygons {x : A_t x ≤ b_t}
# shrunk towards their middles. Every frame uses the supports of all later frames, so weight is shifted before a foot lifts. The target path c⁰ is
# the middle between the feet: the path of least sway.


@dataclass(frozen=True)
class Steadiness:
    """Options of the plan of the centre of mass."""

    keep: float = 0.55
    """Usable share of the support polygon, shrunk towards its middle. In dynamic balance of the sample walk on the OP3 its limbs are 0.3° further from
    the human's with 0.3; with 0.8 only static balance is left."""
    static: bool = True
    """Whether the centre of mass itself stays inside, not only the zero moment point."""
    jerk: float = 1e-4
    """Weight of the squared third derivative [s⁶]. Half and double change the legs of the sample walk by -0.3 and 0.1°, and those of
    dynamic balance by -0.1 and 0.2°."""
    middle: float = 0.0
    """Weight of the zero moment point's distance from the middle of the support."""
    edge: float = 0.3
    """A playback slows down where the zero moment point comes nearer to the edge of the support, as a share of the distance from edge to middle.
    Half changes nothing in the sample walk on the OP3; doubled, it takes 1.39 instead of 1.06 times the human's time."""
    penalty: float = 1e5
    """Weight of the squared excess over the polygon. Half and double change the legs of the sample walk by less than 0.01°."""


def between(first: Steadiness, last: Steadiness, share: float) -> Steadiness:
    """Return options that are a share of the way from the first to the last."""
    return replace(
        first,
        **{name: (1 - share) * vars(first)[name] + share * vars(last)[name] for name in ("keep", "middle", "edge")},
    )


STATIC = Steadiness()
DYNAMIC = tuple(
    Steadiness(keep, False, 1e-5, middle, edge=edge) for keep, middle, edge in ((0.75, 0.5, 0.1), (0.55, 2.0, 0.3))
)
"""Dynamic balance that sways least, and the one that stays up in every walk tried; a playback takes the first whose plan keeps `playback.MARGIN`. In
"xia neutral" on the OP3 the trunk is 6.5 and 8.4° from the human's, and the least margin of the plan 6.9 and 14.4 mm. With a jerk of 1e-4 the zero
moment point of a walk moves out and in over every stance, and the body sways twice as far. With a middle of 0 it stays near the inner edges of the
feet, where soft servos tip the OP3 inwards: below 6 mm for 30 % of the sample walk, 3 % with 4."""


@dataclass(frozen=True)
class ZmpPlan:
    """A planned path."""

    centre: Floats
    """(T, 2) path of the centre of mass [m]."""
    excess: Floats
    """(T,) distance outside the shrunk polygons [m]."""
    pendulum: Floats
    """(T, 2) zero moment point of a pendulum with that path [m]."""


def plan_centre(
    targets: Floats, lever: Floats, supports: list[Polygon], fps: float, how: Steadiness, drift: Floats | None = None
) -> ZmpPlan:
    """Plan the path of the centre of mass by the quadratic program of this module.

    Args:
        targets: (T, 2) target path c⁰ [m].
        lever: (T,) height z of the centre of mass over the floor, over gravity g [s²].
        supports: T support polygons.
        fps: frames per second [1/s].
        how: weights of the program, and whether the centre of mass itself stays in the polygons.
        drift: (T, 2) distance of the zero moment point from that of the pendulum, d_t [m]; zero by default.

    Returns:
        The path, and the distance by which each frame exceeds its polygon.
    """
    count = len(targets)
    acceleration = -(_first(count).T @ _first(count)) * fps**2
    point = sparse.eye(count) - sparse.diags(lever) @ acceleration
    shrunk = [polygon.shrunk(how.keep) for polygon in supports]
    inside = [_inside(shrunk, sparse.eye(count), None)] if how.static else []
    rows, least = zip(*inside, _inside(shrunk, point, drift), strict=True)
    third = _first(count - 2) @ _first(count - 1) @ _first(count) * fps**3
    smooth = how.jerk * (third.T @ third) + sparse.eye(count) + how.middle * (point.T @ point)
    hessian = 2 * sparse.block_diag([smooth, smooth, how.penalty * sparse.eye(count)], format="csc")
    middles = np.array([polygon.middle for polygon in supports]) - (0.0 if drift is None else drift)
    wanted = targets + how.middle * (point.T @ middles)
    gradient = np.concatenate([-2 * wanted[:, 0], -2 * wanted[:, 1], np.zeros(count)])
    found = _solve(hessian, gradient, sparse.vstack(rows, format="csc"), np.concatenate(least))
    centre = found[: 2 * count].reshape(2, count).T
    return ZmpPlan(centre, np.maximum(found[2 * count :], 0.0), np.asarray(point @ centre))


def _inside(supports: list[Polygon], take: Any, drift: Floats | None) -> tuple[Any, Floats]:
    """Return rows (c_x, c_y, s) ↦ A_t (take c)_t − s_t ≤ b_t − A_t d_t of all frames, and their bounds."""
    frames = np.concatenate([np.full(len(p.bounds), t) for t, p in enumerate(supports)])
    normals, bounds = np.concatenate([p.normals for p in supports]), np.concatenate([p.bounds for p in supports])
    pick = sparse.csr_matrix((np.ones(len(frames)), (np.arange(len(frames)), frames)), (len(frames), len(supports)))
    if drift is not None:
        bounds = bounds - (normals * drift[frames]).sum(axis=1)
    taken = pick @ take
    rows = sparse.hstack([sparse.diags(normals[:, 0]) @ taken, sparse.diags(normals[:, 1]) @ taken, -pick])
    return rows, bounds


def _solve(h: Any, g: Floats, a: Any, upper: Floats) -> Floats:
    """minimise ½ xᵀHx + gᵀx subject to A x ≤ upper, by OSQP's operator splitting."""
    h, a = ca.DM(sparse.csc_matrix(h)), ca.DM(sparse.csc_matrix(a))
    shape = {"h": h.sparsity(), "a": a.sparsity()}
    precise = {"eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 20000, "verbose": False}
    solver = ca.conic("plan", "osqp", shape, {"error_on_fail": False, "osqp": precise})
    sides = {"lba": -np.inf, "uba": upper, "lbx": -np.inf, "ubx": np.inf}
    return solver(h=h, g=g, a=a, **sides)["x"].full().ravel()


def _first(count: int) -> Any:
    """Return first differences; the negative square of them is the second differences at rest before the first frame and after the last."""
    return sparse.eye(count - 1, count, 1) - sparse.eye(count - 1, count)


LEAD = 1.5
"""Least time from the stand to the clip's first pose, and from its last pose back [s]. Half and double change the legs of the sample walk by
0.03°."""
LEAD_SPEED = 1.2
"""Peak joint speed on the transition [rad/s]. Half and double change the limbs of the sample walk by less than 0.01°."""
ARC = 0.1
"""Least height of a swing foot's arc, over the leg length. Measured at a sweep of 1.3 in the sample walk at 2.1 times its
speed: with 0.13 the OP3 falls as with 0.1, with 0.16 it stays up with steps of 0.77 of the human's."""


SWEEPS = (1.3, 1.6)
"""Least durations of a swing over that of a leg at its usable speed [-]: the first one is kept only if the playback then needs no more time. With
1.3 alone the OP3 takes 0.37 instead of 0.55 of the human's steps in `soma30_walk_then_sneak`, and its hips and knees ask for 1.5 of the torque–speed
line in `test_freebvh_walk`; the walk of the ToddlerBot-class robot, slowed down further at 1.3, falls in 8 of 10 drawn worlds."""


@dataclass(frozen=True)
class Timeline:
    """K frames of a playback, on the clip's time and on the stands' before and after."""

    at: Floats
    """(K,) frame of the clip."""
    share: Floats
    """(K,) share of the clip's pose: 0 in the stands, 1 within the clip."""
    planted: np.ndarray
    """(K, F) feet on the floor."""
    fps: float

    @property
    def inside(self) -> Ints:
        """Indices of the frames of the clip itself: without the rest of a swing that it cuts, over which the human is not known."""
        whole = np.flatnonzero(self.share >= 1)
        begin, end = (np.flatnonzero(self.at[whole] == self.at[whole[k]]) for k in (0, -1))
        return whole[begin[-1] : end[0] + 1]

    @property
    def phase(self) -> Floats:
        """(K,) strictly increasing: time on the clip, and on the stands before and after it [s]."""
        inside, frames = self.inside, np.arange(len(self.at))
        return (self.at + np.minimum(frames - inside[0], 0) + np.maximum(frames - inside[-1], 0)) / self.fps


@dataclass(frozen=True)
class Drift:
    """Distance of the zero moment point of a playback from that of its pendulum: what angular momentum and height add."""

    timeline: Timeline
    values: Floats
    """(K, 2) [m]."""

    def on(self, timeline: Timeline) -> Floats:
        """Return (L, 2) the distances at the same phases of another timeline."""
        return np.stack([np.interp(timeline.phase, self.timeline.phase, d) for d in self.values.T], axis=1)


@dataclass(frozen=True)
class PlaybackClip:
    """A clip to be played: T frames."""

    graph: RobotGraph
    """The graph of the human's targets."""
    qpos: Floats
    """(T, nq) approximate solutions."""
    corners: Floats
    """(T, F, 4, 3) corners of the soles [m]."""
    planted: np.ndarray
    """(T, F) feet on the floor."""
    fps: float
    stride: float = 1.0
    """Scale of the path along the floor."""
    swing: float = 0.8
    """Least duration of a swing [s], by default that of static balance, as in `Pacing`."""
    sweep: float = SWEEPS[-1]
    """Which of `SWEEPS` it has in dynamic balance [-]."""
    ground: SolidGround = field(default_factory=SolidGround)
    """Under the feet."""


@dataclass(frozen=True)
class PlaybackPlan:
    """The targets of every frame of a playback, and the plan of the centre of mass."""

    timeline: Timeline
    targets: Floats
    """(K, nq)."""
    places: Floats
    """(K, F, 4, 3) of the soles [m]."""
    stands: tuple[Floats, Floats]
    """The configurations (nq,) of the first and the last stand."""
    supports: list[Polygon]
    planes: Planes
    """Through the planted soles of every frame."""
    zmp: ZmpPlan
    slowdown: float
    stride: float


def plan_playback(
    ik: BalancedIk, clip: PlaybackClip, stretch: Floats, how: Steadiness, drift: Drift | None = None
) -> PlaybackPlan:
    """Plan time, footholds and balance of a clip.

    Args:
        ik: gives stands, soles and centres of mass.
        clip: T frames of the draft and their planted feet.
        stretch: (T − 1,) duration of each frame over its own [-].
        how: conditions on the centre of mass.
        drift: of an earlier playback, whose limbs swing as those of this one.
    """
    feet = [np.stack([laid_on(clip.ground, sole, ARC * ik.leg) for sole in clip.corners[t]]) for t in (0, -1)]
    stands = [balanced_stand(ik, places, t) for places, t in zip(feet, (0, -1), strict=True)]
    timeline = timeline_of(ik, clip, stands, stretch)
    targets = _target_poses(ik, clip, stands, timeline)
    places = _places(ik, clip, timeline)
    (supports, planes), centre = _supports(timeline, places, clip.ground), ik.centres(targets)
    over = np.array([s.middle for s in supports]) if clip.planted.all() else places.mean(axis=(1, 2))[:, :2]
    lever = (centre[:, 2] - planes.places[:, 2]) / ik.robot.gravity
    plan = plan_centre(over, lever, supports, clip.fps, how, drift and drift.on(timeline))
    ends, slowdown = (stands[0], stands[1]), float(stretch.mean())
    return PlaybackPlan(timeline, targets, places, ends, supports, planes, plan, slowdown, clip.stride)


def timeline_of(ik: BalancedIk, clip: PlaybackClip, stands: list[Floats], stretch: Floats) -> Timeline:
    """Place the clip in time between its two stands.

    Args:
        ik: knows the robot's hinges.
        clip: T frames.
        stands: configurations (nq,) before and after.
        stretch: (T − 1,) duration of each frame over its own [-].
    """
    fps, last = clip.fps, len(clip.qpos) - 1
    times = np.concatenate([[0.0], np.cumsum(stretch)]) / fps
    inside = np.interp(np.arange(1, int(times[-1] * fps)) / fps, times, np.arange(last + 1))
    up, down = (round(_rest_of_swing(clip, times, end) * fps) for end in (0, -1))
    lead, tail = (_lead_shares(ik, stands[end], clip, end, more) for end, more in ((0, up), (-1, down)))
    at = np.concatenate([np.zeros(len(lead)), inside, np.full(len(tail), last)])
    share = np.concatenate([lead, np.ones(len(inside)), tail[::-1]])
    planted = clip.planted[np.round(at).astype(int)]
    planted[: len(lead) - up] = True
    planted[len(at) - len(tail) + down :] = True
    return Timeline(at, share, planted, fps)


def _rest_of_swing(clip: PlaybackClip, times: Floats, end: int) -> float:
    """Return the time before the first frame, or after the last, of a swing of least duration that the clip cuts [s]."""
    standing = np.flatnonzero(clip.planted.all(axis=1))
    if clip.planted[end].all() or not len(standing):
        return 0.0 if clip.planted[end].all() else clip.swing
    within = abs(times[standing[end]] - times[end])
    return max(clip.swing - within, clip.swing / 2)


def _lead_shares(ik: BalancedIk, stand: Floats, clip: PlaybackClip, frame: int, lift: int) -> Floats:
    """Return shares from 0 to 1 with minimum jerk within the joint speed, then `lift` frames for a foot in the air."""
    index = ik.robot.qpos_index
    way = np.abs(clip.qpos[frame, index] - stand[index]).max()
    count = max(2, round(max(LEAD, JERK_PEAK * way / LEAD_SPEED) * clip.fps))
    return np.concatenate([minimum_jerk(np.linspace(0.0, 1.0, count)), np.ones(lift)])


def _target_poses(ik: BalancedIk, clip: PlaybackClip, stands: list[Floats], timeline: Timeline) -> Floats:
    """Return (K, nq) the draft at the timeline's times, blended with the stands joint by joint."""
    robot = ik.robot
    trajectory = Trajectory(clip.qpos, clip.fps, robot.joint_names, robot.name)
    targets = sample(trajectory, robot, timeline.at / clip.fps)
    middle = len(timeline.at) // 2
    for k in np.flatnonzero(timeline.share < 1):
        stand = stands[0] if k < middle else stands[1]
        targets[k] = integrate(robot, stand, timeline.share[k] * difference(robot, stand, targets[k]))
    return targets


def _places(ik: BalancedIk, clip: PlaybackClip, timeline: Timeline) -> Floats:
    """Return (K, F, 4, 3) places of the soles; a foot whose swing the clip cuts stands where it is at the cut."""
    before = np.minimum(timeline.at.astype(int), len(clip.corners) - 2)
    part = (timeline.at - before)[:, None, None, None]
    corners = clip.corners[before] * (1 - part) + clip.corners[before + 1] * part
    gap = LEAST_GAP * float(gaps(stand_places(ik)[None])[0])
    return foothold_places(timeline.planted, corners, ARC * ik.leg, gap, clip.ground)


def _supports(timeline: Timeline, places: Floats, ground: SolidGround) -> tuple[list[Polygon], Planes]:
    """Return K hulls of the planted soles, and the planes through them."""
    known: dict[bytes, tuple[Polygon, Planes]] = {}
    found = []
    for planted, corners in zip(timeline.planted, places, strict=True):
        key = corners[planted].tobytes()
        if key not in known:
            footing = zip(*(ground.footing(sole) for sole in corners[planted]), strict=True)
            points, _, normals = (np.concatenate(part) for part in footing)
            known[key] = support(points), level_planes(1) if ground.level else planes_through([points], [normals])
        found.append(known[key])
    supports, planes = zip(*found, strict=True)
    return list(supports), joined(planes)
