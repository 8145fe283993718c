"""A clip laid out in time, from a stand at its pace into a stand, with its targets and its supports."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats
from robot_retarget.balance.balanced_ik import BalancedIk
from robot_retarget.balance.foot_spacing import GAP, gaps
from robot_retarget.balance.stand import balanced_stand, stand_places
from robot_retarget.balance.swing import foothold_places
from robot_retarget.balance.timeline import Timeline
from robot_retarget.balance.zmp import Steadiness, ZmpPlan, plan_centre
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.soles import flattened, heading
from robot_retarget.ramps import JERK_PEAK, minimum_jerk
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.support import Polygon, support
from robot_retarget.robot.timing import sample
from robot_retarget.trajectory import Trajectory

LEAD = 1.5
"""Least time from the stand to the clip's first pose, and from its last pose back [s]."""
LIFT = 0.8
"""Additional time to lift or put down a foot that is in the air in that pose [s], multiplied by the local slowdown
..."""
SLOWEST_LIFT = 2.5
"""... up to this factor ..."""
SETTLED = 0.4
"""... with the weight on the other foot for this time before [s]."""
LEAD_SPEED = 1.2
"""Peak joint speed on the transition [rad/s]."""
ARC = 0.1
"""Least height of a swing foot's arc, over the leg length."""


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
    zmp: ZmpPlan
    slowdown: float
    stride: float

    @property
    def reach(self) -> Floats:
        """(K,) distance from the middle of each support to its nearest edge [m]."""
        return np.array([p.margin(p.middle) for p in self.supports])


def plan_playback(ik: BalancedIk, clip: PlaybackClip, stretch: Floats, how: Steadiness) -> PlaybackPlan:
    """Plan time, footholds and balance of a clip.

    Args:
        ik: gives stands, soles and centres of mass.
        clip: T frames of the draft and their planted feet.
        stretch: (T − 1,) duration of each frame over its own [-].
        how: conditions on the centre of mass.
    """
    ends = [_end_places(ik, clip, t) for t in (0, -1)]
    stands = [balanced_stand(ik, places) for places in ends]
    timeline = timeline_of(ik, clip, stands, stretch)
    targets = _target_poses(ik, clip, stands, timeline)
    places = _places(ik, clip, ends, timeline)
    supports = _supports(timeline, places)
    centre = ik.centres(targets)
    over = np.array([s.middle for s in supports]) if clip.planted.all() else centre[:, :2]
    plan = plan_centre(over, centre[:, 2] / ik.robot.gravity, supports, clip.fps, how)
    return PlaybackPlan(
        timeline, targets, places, (stands[0], stands[1]), supports, plan, float(stretch.mean()), clip.stride
    )


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
    lifts = (0.0 if clip.planted[t].all() else LIFT * min(stretch[t], SLOWEST_LIFT) for t in (0, -1))
    up, down = (round(lift * fps) for lift in lifts)
    lead = _lead_shares(ik, stands[0], clip, 0, up)
    tail = _lead_shares(ik, stands[1], clip, -1, down)
    at = np.concatenate([np.zeros(len(lead)), inside, np.full(len(tail), last)])
    share = np.concatenate([lead, np.ones(len(inside)), tail[::-1]])
    planted = clip.planted[np.round(at).astype(int)]
    planted[: len(lead) - up] = True
    planted[len(at) - len(tail) + down :] = True
    return Timeline(at, share, planted, fps)


def _lead_shares(ik: BalancedIk, stand: Floats, clip: PlaybackClip, frame: int, lift: int) -> Floats:
    """Return shares from 0 to 1 with minimum jerk within the joint speed, then `lift` frames for a foot in the air."""
    index = ik.robot.qpos_index
    way = np.abs(clip.qpos[frame, index] - stand[index]).max()
    count = max(2, round(max(LEAD, JERK_PEAK * way / LEAD_SPEED) * clip.fps))
    shares = minimum_jerk(np.linspace(0.0, 1.0, count))
    lifting = lift + round(SETTLED * clip.fps) if lift else 0
    return np.concatenate([shares, np.ones(lifting)])


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


def _end_places(ik: BalancedIk, clip: PlaybackClip, frame: int) -> Floats:
    """Return (F, 4, 3) the feet before or after the clip; a foot in the air goes to its place next to the other."""
    corners, planted = clip.corners[frame], clip.planted[frame]
    own = stand_places(ik)
    if planted.all() or not planted.any():
        return flattened(corners)
    target, stand = flattened(corners[planted][0]), own[planted][0]
    spin = Rotation.from_euler("z", heading(target[None]) - heading(stand[None])).as_matrix()
    return target.mean(axis=0) + (own - stand.mean(axis=0)) @ spin.T


def _places(ik: BalancedIk, clip: PlaybackClip, ends: list[Floats], timeline: Timeline) -> Floats:
    """Return (K, F, 4, 3) places of the soles."""
    before = np.minimum(timeline.at.astype(int), len(clip.corners) - 2)
    part = (timeline.at - before)[:, None, None, None]
    corners = clip.corners[before] * (1 - part) + clip.corners[before + 1] * part
    first, last = np.flatnonzero(timeline.at > 0)[0], np.flatnonzero(timeline.at < timeline.at[-1])[-1]
    for frames, places, frame in ((slice(0, first), ends[0], 0), (slice(last + 1, None), ends[1], -1)):
        aside = timeline.planted[frames] & ~clip.planted[frame]
        corners[frames] = np.where(aside[:, :, None, None], places, corners[frames])
    gap = GAP * float(gaps(stand_places(ik)[None])[0])
    return foothold_places(timeline.planted, corners, ARC * ik.leg, gap)


def _supports(timeline: Timeline, places: Floats) -> list[Polygon]:
    """Return K hulls of the planted soles."""
    known: dict[bytes, Polygon] = {}
    found = []
    for planted, corners in zip(timeline.planted, places, strict=True):
        standing = corners[planted].reshape(-1, 3)
        key = standing.tobytes()
        if key not in known:
            known[key] = support(standing)
        found.append(known[key])
    return found
