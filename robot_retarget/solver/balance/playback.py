"""The playback of a clip in balance: planted, and slowed down in rounds until joints, soles and weight can follow."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from robot_retarget.base.arrays import JERK_PEAK, Floats, Ints, intervals
from robot_retarget.base.progress import Count
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.track import Track
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import joint_torques, tread
from robot_retarget.robot.following import legs_following
from robot_retarget.robot.timing import sample
from robot_retarget.solver.balance.balanced_ik import BalancedIk
from robot_retarget.solver.balance.footsteps import REACH
from robot_retarget.solver.balance.plan import (
    SWEEPS,
    Drift,
    PlaybackClip,
    PlaybackPlan,
    Steadiness,
    Timeline,
    ZmpPlan,
    between,
    plan_playback,
)
from robot_retarget.solver.clip import EXPECTED
from robot_retarget.solver.clip_model import clip_of
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.limits import targets_of, within_speeds
from robot_retarget.solver.minimum import ClipMinimum
from robot_retarget.solver.options import Smoothing
from robot_retarget.trajectory import Trajectory

# The time that a motion needs: it slows down if a joint, the zero moment point or a shift of weight needs more.

SPARE = 0.3
"""Least usable share of a joint's torque: a joint that holds still with more than the rest gains nothing from slowing
down. Half and double change nothing in the sample walk."""


@dataclass(frozen=True)
class Pacing:
    """The conditions and the amount of slowing down."""

    slowest: float = 4.0
    """Largest slowdown, averaged over the whole clip. Half and double change nothing in the sample walk on the OP3."""
    speed: float = 0.85
    """Usable share of a joint's largest speed. With half the sample walk takes 2.4 instead of 1.03 times the human's time."""
    torque: float = 0.9
    """Usable share of the torque on the torque–speed line. With half the sample walk takes 1.9 instead of 1.03 times the human's time."""
    friction: float = 0.35
    """Largest friction coefficient used: fast turns over standing feet make them slide. Half and double change nothing in the sample walk."""
    excess: float = 1e-3
    """The planned centre of mass may leave its polygon by this [m]. Half and double change nothing in the sample walk."""
    swing: float = 0.8
    """Least duration of a swing in static balance [s]: a leg that swings forward pushes the body back. With half and double
    the sample walk takes 1.2 and 2.4 instead of 1.5 times the human's time."""
    transfer: float = 0.2
    """Least duration of a shift of weight, with all feet on the floor [s]: on a foot that lands a little tilted, the body sways.
    With half and double the sample walk takes 1.5 and 1.8 times the human's time, and its legs are 12.5 and 9.6° from the human's."""
    near: float = swing
    """Largest time distance, in time of the playback, from a shift of weight that comes too late [s]: the duration of a swing."""
    slack: float = 1.2
    """Needs up to this factor are ignored: a servo can exceed its limits slightly for a moment. Measured with 1, and the
    playback of the rounds that needs least: `02_01_walk` and `bn_walk` take 3 % longer on the OP3, and fall in none of four drawn worlds either way."""
    burst: float = 1.3
    """Loads may need this factor more for a moment: the OP3's knees do at the ends of a swing in walks that stay up in soft worlds.
    Measured with 1 and a sweep of 1.3: the sample walk at 2.1 times its speed takes 2.4 instead of 1.5 times the human's time."""
    shift: float = slack
    """Factor per round on frames with all feet on the floor near that shift [-]: the least need that is not ignored."""
    rounds: int = 6
    """Number of rounds of the whole motion. Half and double change nothing in the sample walk, in static and in dynamic balance."""
    most: float = slowest ** (2 / rounds)
    """Largest factor on any frame per round [-]: half of the rounds reach the largest slowdown."""
    shifts: int = 4 * rounds
    """Number of rounds of shifting weight, which are cheap."""
    blend: float = transfer / 3
    """Time over which the pace changes, in time of the playback [s]: a third of a shift of weight, whose middle keeps its pace."""


def least_durations(planted: np.ndarray, fps: float, pacing: Pacing, shares: Floats | None = None) -> Floats:
    """Return the durations of frames that give every swing of a foot, and every shift of weight between two, its least duration.

    Args:
        planted: (T, F) feet on the floor.
        fps: frames per second of the clip [1/s].
        pacing: the least durations, and the largest slowdown.
        shares: (T, F) of the least duration for the swing of a foot at a frame; 1 by default [-].

    Returns:
        (T − 1,) durations over 1/fps [-].
    """
    factor = np.ones(len(planted) - 1)
    part = np.ones(planted.shape) if shares is None else shares
    swings = [
        (span, pacing.swing * part[span[0], foot], 1)
        for foot in range(planted.shape[1])
        for span in intervals(~planted[:, foot])
    ]
    shifts = [(span, pacing.transfer, 0) for span in intervals(np.asarray(planted.all(axis=1)))]
    for (start, stop), least, more in swings + shifts:
        frames = slice(max(start - 1, 0), stop)
        factor[frames] = np.maximum(factor[frames], least * fps / (stop - start + more))
    return _capped(factor, pacing)


def stretched(stretch: Floats, timeline: Timeline, needs: Floats, pacing: Pacing) -> Floats:
    """Return durations of frames multiplied by needed factors, blended over time and capped.

    Args:
        stretch: (T − 1,) durations of the clip's frames over their own [-].
        timeline: K frames of the playback.
        needs: (K,) factors by which the frames must last longer [-].
        pacing: the blend and the largest slowdown.
    """
    inside, width = timeline.share >= 1, pacing.blend * timeline.fps
    wide = maximum_filter1d(np.where(inside, needs, 1.0), 2 * round(2 * width) + 1, mode="nearest")
    slower = np.exp(gaussian_filter1d(np.log(wide), width, mode="nearest"))[inside]
    at, last = timeline.at[inside], len(stretch) - 1
    factor = np.interp(np.arange(len(stretch)) + 0.5, at, slower)
    # The first and the last pose of the clip may last longer than a frame.
    np.maximum.at(factor, np.minimum(at.astype(int), last), slower)
    return _capped(stretch * factor, pacing)


def _capped(stretch: Floats, pacing: Pacing) -> Floats:
    """Return frame durations scaled so that their mean does not exceed the slowest pace."""
    return 1 + (stretch - 1) * min(1.0, (pacing.slowest - 1) / max(stretch.mean() - 1, 1e-9))


def shift_needs(late: np.ndarray, timeline: Timeline, pacing: Pacing) -> Floats:
    """Return the factors of frames with all feet on the floor near a late shift of weight.

    Args:
        late: (K,) whether the centre of mass is outside its polygon.
        timeline: K frames of the playback.
        pacing: the factor, and the time around a late frame.

    Returns:
        (K,) factors, 1 elsewhere [-].
    """
    around = maximum_filter1d(late.astype(np.int8), 2 * round(pacing.near * timeline.fps) + 1) > 0
    everywhere = timeline.planted.all(axis=1)
    return np.where(around & everywhere, pacing.shift, 1.0)


def motion_needs(
    robot: Robot,
    qpos: Floats,
    loads: tuple[Floats, Floats],
    inside: Floats,
    friction: Floats,
    fps: float,
    pacing: Pacing,
    edge: float = Steadiness.edge,
) -> Floats:
    """Return (K,) factors for joints beyond speed or load, and for soles near tipping over an edge or sliding.

    Args:
        loads: (K, n) torques in motion and at rest (`dynamics.joint_torques`) [N m].
        inside: (K,) position of the zero moment point in the support: 1 in its middle, 0 on the edge.
        friction: (K,) coefficient that the soles need; forces scale with the square of the pace.
        edge: `Steadiness.edge`.
    """
    share = np.diff(qpos[:, robot.qpos_index], axis=0, append=qpos[-1:, robot.qpos_index]) * fps / robot.max_speed
    moving, resting = (load / robot.max_torque for load in loads)
    # A motor gives τ while turning at ω as one at rest gives τ + τ_max ω/ω_max: the torque–speed line.
    asked, held = np.abs(moving + share), np.abs(resting)
    overload = np.maximum(asked - held, 0.0) / np.maximum(pacing.torque - held, SPARE)
    worst = np.maximum(np.abs(share) / pacing.speed, overload ** (2 / 3) / pacing.burst).max(axis=1)
    soles = np.maximum(1 + edge - inside, np.sqrt(friction / pacing.friction))
    return np.clip(np.maximum(worst, soles), 1.0, pacing.most)


MARGIN = 0.032
"""Least distance of the zero moment point from the edge of the support in a plan, over the leg: 7 mm on the OP3. It orders falls: of nine walks in
five soft worlds each 0 of 45 with 8.2 mm and more, 0 of 5 with 6.9 mm, 1 with 4.7, 2 with 1.7 and 5 with −.3 mm [-]."""
QUICK = 0.04
"""Servos do not follow faster changes [s]: the zero moment point is computed from a motion smoothed over this time.
Half and double change the legs of the sample walk by 0.1° and its margin by 1.2 mm at most."""
SHORT = 0.6
"""Least duration of a swing over that of the longest step: lifting a foot takes time too [-]. Measured at a sweep of 1.3: the
sample walk at 2.1 times its speed falls with 0.8 and 0.9 as well."""
HURRIED = 1.1
"""Slowdown by swings alone beyond which a clip keeps the last conditions: the sample walk at 2.1 times its speed (1.47) falls with the first conditions
at margins of 7.8 and 9.2 mm, and stays up with the last at 8.2 mm; "walk01 ot" (1.02) stays up in ten soft worlds with the first at 7.5 mm [-]."""
FORESEEN = 2
"""Rounds of the steps alone before limbs are solved: in `soma30_walk_then_sneak` the least margin is −15.3 mm after the first and 3.5 mm after the second."""
MOMENTS = 16
"""Number of frames that predict the likeness of a playback: in seven clips their trunk is within 3.7° of that of the playback, and their legs within 2.1°."""
EXPECTED_ROUNDS = 1.5
"""Expected number of rounds of planting, including the first."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """A planned playback in balance."""

    poses: tuple[FrameSolution, ...]
    """K frames."""
    tracks: tuple[Track, ...]
    """The targets of the frames."""
    timeline: Timeline
    places: Floats
    """(K, F, 4, 3) places of the soles [m]."""
    plan: ZmpPlan
    slowdown: float
    """Duration within the clip over the clip's own."""
    stride: float
    """Length of the steps over the clip's own."""
    zmp: Floats
    """(K, 2) zero moment point [m]."""
    margin: Floats
    """(K,) margin of the zero moment point inside the full support polygon [m]."""
    friction: Floats
    """(K,) friction coefficient that the soles need."""
    legs: str = "follow"
    """`follow`, `turn` (in place, with the human) or `stand`."""
    mode: str = "static"
    """`static` or `dynamic`."""
    sweep: float = SWEEPS[-1]
    """Which of `SWEEPS` its swings have in dynamic balance."""
    instead: str = ""
    """Reason for both feet in place, if the legs were to follow when possible."""
    attempts: tuple[Mapping[str, Any], ...] = ()
    """The ways to play that were tried, the most human-like first, as rows of the report."""

    @property
    def qpos(self) -> Floats:
        """(K, nq) configurations."""
        return np.array([pose.qpos for pose in self.poses])

    @property
    def notes(self) -> tuple[str, ...]:
        """The changes of the clip, a sentence each."""
        slower = f"slowed down {self.slowdown:.2f} times" if self.slowdown > 1.005 else "played at its own pace"
        shorter = f", steps shortened to {self.stride:.2f} of their length" if self.stride < 0.995 else ""
        feet = {"stand": ", both feet in place", "turn": ", turning in place in small steps"}.get(self.legs, "")
        mode = " dynamically: it cannot halt within a step" if self.mode == "dynamic" else ""
        what = "the robot turns in place" if self.legs == "turn" else "both feet stay in place"
        why = (f"{what}: {self.instead}",) if self.instead else ()
        return (f"balanced{mode}: {slower}{shorter}{feet}, with a stand before and after", *why)


def expected_steps(graph: RobotGraph) -> int:
    """Estimate the progress steps of `in_balance`: the playback takes about twice as long as the clip."""
    return round(2 * EXPECTED_ROUNDS * len(graph) * EXPECTED)


@dataclass(frozen=True, eq=False)
class Start:
    """A playback before its limbs are solved."""

    clip: PlaybackClip
    pacing: Pacing
    stretch: Floats
    """(T − 1,) duration of each frame over its own [-]."""
    plan: PlaybackPlan
    tight: float
    """Conditions on the centre of mass: 0 the most human-like ones, 1 the last ones."""


def begun(ik: BalancedIk, clip: PlaybackClip, ends: Sequence[Steadiness], slowest: float = np.inf) -> Start:
    """Return the start of a playback: the time of its swings and shifts of weight, up to a mean of `slowest` times the clip's own.

    Args:
        ik: gives stands, soles and centres of mass.
        clip: T frames of the draft and their planted feet.
        ends: conditions on the centre of mass, the most human-like first; swings that are `HURRIED` take the last.
        slowest: where the search for time ends [-].
    """
    pacing = Pacing() if ends[0].static else Pacing(swing=swing_time(ik, clip.sweep), transfer=0.0)
    clip, tight = replace(clip, swing=pacing.swing), 0.0
    stretch, plan = _with_time_for_weight(ik, clip, ends[0], pacing, slowest)
    if len(ends) > 1 and HURRIED < stretch.mean() <= slowest:
        tight, (stretch, plan) = 1.0, _with_time_for_weight(ik, clip, ends[-1], pacing, slowest)
    return Start(clip, pacing, stretch, plan, tight)


class Foreseen(NamedTuple):
    """Prediction of a playback before its limbs are solved."""

    start: Start
    """The start, with a plan that compensates the limbs of the steps alone."""
    margin: Floats
    """(K,) margin of the zero moment point of the steps alone [m]."""
    frames: Ints
    """(M,) `MOMENTS` of the frames ..."""
    qpos: Floats
    """... and (M, nq) their configurations, each solved as a single frame."""


def foreseen(ik: BalancedIk, start: Start, ends: Sequence[Steadiness]) -> Foreseen:
    """Predict a playback from root, legs and a few frames."""
    clip, plan, how = start.clip, start.plan, between(ends[0], ends[-1], start.tight)
    margin = np.full(len(plan.targets), np.inf)
    for _ in range(0 if how.static else FORESEEN):
        alone = steps_alone(ik, plan)
        point = tread(ik.robot, alone, clip.fps, QUICK, plan.planes).point
        margin = _margins(plan, point)
        clip, plan = _made_up(ik, clip, plan, alone, point, start.stretch, how)
    inside = plan.timeline.inside
    frames = inside[np.linspace(0, len(inside) - 1, MOMENTS).astype(int)]
    targets = targets_of(_tracks(ik, clip, plan))
    moments = [
        ik.solver.solve_frame(plan.targets[k], targets.at(k), iterations=12, tolerance=1e-4) for k in frames.tolist()
    ]
    return Foreseen(replace(start, clip=clip, plan=plan), margin, frames, np.array([pose.qpos for pose in moments]))


def playbacks(ik: BalancedIk, start: Start, ends: Sequence[Steadiness], count: Count) -> Iterator[Balanced]:
    """Yield playbacks; each corrects the one before, until one keeps all limits or the rounds end.

    If the least margin is below `MARGIN`, the conditions move from the first towards the last, in proportion to the deficit; at the last, the pace slows down.
    If joints or soles need more time, swings first take the slowest of `SWEEPS`; then the pace slows down.

    Args:
        ik: solves frames with soles at places and the centre of mass over points.
        start: the plan and its pace.
        ends: as in `begun`.
        count: receives the progress.
    """
    clip, pacing, stretch, plan, tight = start.clip, start.pacing, start.stretch, start.plan, start.tight
    how = between(ends[0], ends[-1], tight)
    for number in range(pacing.rounds):
        found = played(ik, clip, plan, count)
        yield found
        loads = joint_torques(ik.robot, found.qpos, clip.fps, ik.soles, QUICK, clip.ground)
        room, lack = np.array([p.margin(p.middle) for p in plan.supports]), MARGIN * ik.leg - float(found.margin.min())
        last = how.static or tight >= 1
        inside = found.margin / room if last else np.ones(len(room))
        needs = motion_needs(ik.robot, found.qpos, loads, inside, found.friction, clip.fps, pacing, how.edge)
        rushed = needs.max() > pacing.slack
        if (lack <= 0 and not rushed) or stretch.mean() >= pacing.slowest - 1e-3:
            return
        if not number:  # the second playback often needs no more time, and its plan makes up for the limbs of the first
            lack, rushed, last = lack / 2, False, False
        if rushed and not how.static and clip.sweep < SWEEPS[-1]:
            slower = begun(ik, replace(clip, sweep=SWEEPS[-1]), ends)
            clip, pacing, stretch = slower.clip, slower.pacing, np.maximum(stretch, slower.stretch)
        elif rushed or last:
            stretch = stretched(stretch, plan.timeline, needs, pacing)
        if lack > 0:
            gain = (ends[0].keep - ends[-1].keep) * float(room.min())
            tight = min(1.0, tight + (lack + pacing.excess) / max(gain, pacing.excess))
            how = between(ends[0], ends[-1], tight)
        clip, plan = _made_up(ik, clip, plan, found.qpos, found.zmp, stretch, how)


def steps_alone(ik: BalancedIk, plan: PlaybackPlan) -> Floats:
    """Return (K, nq) root and legs that follow a plan under the limbs of its targets, with joints within their speeds."""
    places = plan.places.reshape(len(plan.targets), -1, 3)
    found = legs_following(ik.robot, plan.targets, ik.leg_dofs, ik.soles, places, plan.zmp.centre)
    reach, index = ik.options.speed * ik.robot.max_speed / plan.timeline.fps, ik.robot.qpos_index
    found[:, index] = within_speeds(found[:, index], reach)
    return found


def _made_up(
    ik: BalancedIk, clip: PlaybackClip, plan: PlaybackPlan, qpos: Floats, zmp: Floats, stretch: Floats, how: Steadiness
) -> tuple[PlaybackClip, PlaybackPlan]:
    """Return the clip with the configurations (K, nq) of a playback, and the plan that makes up for how they shift the zero moment point (K, 2).

    Kajita et al., Biped walking pattern generation by using preview control of zero-moment point, 2003.
    """
    clip = replace(clip, qpos=_on_clip(ik.robot, qpos, plan.timeline, clip))
    return clip, plan_playback(ik, clip, stretch, how, Drift(plan.timeline, zmp - plan.zmp.pendulum))


def swing_time(ik: BalancedIk, sweep: float = SWEEPS[-1]) -> float:
    """Return the least duration of a swing in dynamic balance [s]: a leg sweeps a step of the largest length,

        T = sweep · 1.875 · 2 asin(REACH / 2) / (usable speed)

    with minimum jerk, within the usable speed of its slowest joint.
    """
    speed = ik.options.speed * ik.robot.max_speed[ik.leg_dofs[ik.robot.dof_index]].min()
    return float(sweep * JERK_PEAK * 2 * np.arcsin(REACH / 2) / speed)


def _sweeps(clip: PlaybackClip, leg: float) -> Floats:
    """Return (T, F) the angle that a leg sweeps in the swing at each frame over that of the longest step, `SHORT` at least [-].

    A swing that rises or falls by h bends a knee by 2 acos(1 − h/leg), and stretches it again.
    """
    shares, middle = np.ones_like(clip.planted, dtype=float), clip.corners.mean(axis=2)
    middle[..., 2] = clip.ground.under(middle)[0]
    for foot in range(shares.shape[1]):
        for start, stop in intervals(~clip.planted[:, foot]):
            ends = middle[[max(start - 1, 0), min(stop, len(middle) - 1)], foot]
            across, up = float(np.linalg.norm((ends[1] - ends[0])[:2])), abs(float(ends[1, 2] - ends[0, 2]))
            sweep = max(np.arcsin(min(across / (2 * leg), REACH) / 2), 2 * np.arccos(max(1 - up / leg, 0.0)))
            shares[start:stop, foot] = max(SHORT, sweep / np.arcsin(REACH / 2))
    return shares


def _with_time_for_weight(
    ik: BalancedIk, clip: PlaybackClip, how: Steadiness, pacing: Pacing, slowest: float
) -> tuple[Floats, PlaybackPlan]:
    """Return frame durations (T − 1,) that give every shift of weight its time, and the plan with them."""
    stretch = least_durations(clip.planted, clip.fps, pacing, None if how.static else _sweeps(clip, ik.leg))
    shifts = pacing.shifts
    while True:
        plan = plan_playback(ik, clip, stretch, how)
        late = plan.zmp.excess > pacing.excess
        if not (shifts and late.any()) or stretch.mean() >= min(pacing.slowest - 1e-3, slowest):
            return stretch, plan
        stretch = stretched(stretch, plan.timeline, shift_needs(late, plan.timeline, pacing), pacing)
        shifts -= 1


def played(ik: BalancedIk, clip: PlaybackClip, plan: PlaybackPlan, count: Count) -> Balanced:
    """Return the configurations that follow a plan.

    Args:
        ik: solves frames with soles at places and the centre of mass over points.
        clip: T frames of the draft and their planted feet.
        plan: targets of K frames of the playback.
        count: receives the progress.
    """
    timeline, tracks = plan.timeline, _tracks(ik, clip, plan)
    solver_clip = clip_of(ik.solver, targets_of(tracks), Smoothing(), clip.fps)
    count.expect(round(EXPECTED_ROUNDS * len(plan.targets) * EXPECTED))
    poses = ClipMinimum(solver_clip, np.array(plan.targets)).finish(count)
    pressed = tread(ik.robot, np.array([pose.qpos for pose in poses]), timeline.fps, QUICK, plan.planes)
    standing = [spots[down].reshape(-1, 3) for spots, down in zip(plan.places, timeline.planted, strict=True)]
    how, pushed = (plan.places, plan.zmp, plan.slowdown, plan.stride), pressed.friction(standing)
    return Balanced(
        tuple(poses),
        tuple(tracks),
        timeline,
        *how,
        pressed.point,
        _margins(plan, pressed.point),
        pushed,
        sweep=clip.sweep,
    )


def _tracks(ik: BalancedIk, clip: PlaybackClip, plan: PlaybackPlan) -> list[Track]:
    """Return the targets of a playback."""
    playback = ik.playback(plan.timeline.share[:, None], plan.places, plan.timeline.planted)
    return ik.targets(clip.graph, plan.timeline.at, plan.stands, playback, plan.zmp.centre)


def _margins(plan: PlaybackPlan, points: Floats) -> Floats:
    """Return (K,) distances of points (K, 2) inside the supports of a plan [m]."""
    return np.array([support.margin(point) for support, point in zip(plan.supports, points, strict=True)])


def _on_clip(robot: Robot, qpos: Floats, timeline: Timeline, clip: PlaybackClip) -> Floats:
    """Return (T, nq) configurations of a playback (K, nq) at the clip's own frames."""
    inside = timeline.inside
    times = np.interp(np.arange(len(clip.qpos)), timeline.at[inside], inside / clip.fps)
    return sample(Trajectory(qpos, clip.fps, robot.joint_names, robot.name), robot, times)
