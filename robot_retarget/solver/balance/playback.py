"""The playback of a clip in balance: planted, and slowed down in rounds until joints, soles and weight can follow."""

from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import BalanceError
from robot_retarget.base.progress import Count
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.track import Track
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import joint_torques, tread
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.timing import sample
from robot_retarget.solver.balance.balanced_ik import BalancedIk
from robot_retarget.solver.balance.playback_plan import PlaybackClip, PlaybackPlan, plan_playback
from robot_retarget.solver.balance.timeline import (
    Pacing,
    Timeline,
    least_durations,
    motion_needs,
    shift_needs,
    stretched,
)
from robot_retarget.solver.balance.zmp import Steadiness, ZmpPlan
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.passes import ClipProblem, clip_of, clip_passes
from robot_retarget.trajectory import Trajectory

QUICK = 0.04
"""Servos do not follow faster changes [s]: the zero moment point is computed from a motion smoothed over this time."""
ASIDE = 0.1
"""A joint of arms or head with a larger correction may be in another basin [rad]."""
WORTH = 2.0
"""Arms and head start from the correction of the frame before only if that is cheaper than their target by this
factor."""
IN_TURN = 3
"""Planting frame by frame takes about as long as this number of passes over all frames; the progress counts it as
such."""
ROUNDS = 1.5
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
    """`follow` or `stand`."""
    mode: str = "static"
    """`static` or `dynamic`."""
    instead: str = ""
    """Reason for both feet in place, if the legs were to follow when possible."""

    @property
    def qpos(self) -> Floats:
        """(K, nq) configurations."""
        return np.array([pose.qpos for pose in self.poses])

    @property
    def notes(self) -> tuple[str, ...]:
        """The changes of the clip, a sentence each."""
        slower = f"slowed down {self.slowdown:.2f} times" if self.slowdown > 1.005 else "played at its own pace"
        shorter = f", steps shortened to {self.stride:.2f} of their length" if self.stride < 0.995 else ""
        feet = ", both feet in place" if self.legs == "stand" else ""
        mode = " dynamically: it cannot halt within a step" if self.mode == "dynamic" else ""
        why = (f"both feet stay in place: {self.instead}",) if self.instead else ()
        return (f"balanced{mode}: {slower}{shorter}{feet}, with a stand before and after", *why)


def expected_steps(graph: RobotGraph) -> int:
    """Estimate the progress steps of `in_balance`: the playback takes about twice as long as the clip."""
    return round(2 * ROUNDS * len(graph) * (IN_TURN + Smoothing().passes))


def paced(ik: BalancedIk, clip: PlaybackClip, how: Steadiness, count: Count, slowest: float) -> Balanced:
    """Return the clip in balance, slowed down where a joint, the zero moment point or a shift of weight needs time.

    Args:
        ik: solves frames with soles at places and the centre of mass over points.
        clip: T frames of the draft and their planted feet.
        how: conditions on the centre of mass.
        count: receives the progress.
        slowest: largest duration over the human's [-].

    Raises:
        BalanceError: it needs more than `slowest` times the human's time.
    """
    chosen = Pacing() if how.static else Pacing(transfer=0.0)  # momentum carries the weight over
    stretch, plan = _with_time_for_weight(ik, clip, how, chosen, slowest, count)
    found = played(ik, clip, plan, count)
    for number in range(chosen.rounds):
        loads = joint_torques(ik.robot, found.qpos, clip.fps, ik.soles, QUICK, clip.ground)
        inside = found.margin / plan.reach
        needs = motion_needs(ik.robot, found.qpos, loads, inside, found.friction, clip.fps, chosen)
        if needs.max() <= chosen.slack or stretch.mean() >= chosen.slowest - 1e-3:
            break
        if number:  # the second playback starts from a smooth motion and often needs no more time
            stretch = stretched(stretch, plan.timeline, needs, chosen)
            _require_pace(stretch, slowest)
        clip = replace(clip, qpos=_on_clip(ik.robot, found, clip))
        plan = plan_playback(ik, clip, stretch, how)
        found = played(ik, clip, plan, count, near=True)
    return found


def _with_time_for_weight(
    ik: BalancedIk, clip: PlaybackClip, how: Steadiness, pacing: Pacing, slowest: float, count: Count
) -> tuple[Floats, PlaybackPlan]:
    """Return frame durations (T − 1,) that give every shift of weight its time, and the plan with them."""
    stretch = least_durations(clip.planted, clip.fps, pacing)
    _require_pace(stretch, slowest)
    plan = plan_playback(ik, clip, stretch, how)
    for _ in range(pacing.shifts):
        late = plan.zmp.excess > pacing.excess
        if not late.any() or stretch.mean() >= pacing.slowest - 1e-3:
            break
        stretch = stretched(stretch, plan.timeline, shift_needs(late, plan.timeline, pacing), pacing)
        _require_pace(stretch, slowest)
        plan = plan_playback(ik, clip, stretch, how)
        count.advance(len(plan.targets))
    return stretch, plan


def _require_pace(stretch: Floats, slowest: float) -> None:
    if stretch.mean() > slowest:
        raise BalanceError(f"stepping would take over {slowest:g} times as long as the human")


def played(ik: BalancedIk, clip: PlaybackClip, plan: PlaybackPlan, count: Count, near: bool = False) -> Balanced:
    """Return the configurations that follow a plan.

    Args:
        ik: solves frames with soles at places and the centre of mass over points.
        clip: T frames of the draft and their planted feet.
        plan: targets of K frames of the playback.
        count: receives the progress.
        near: whether an earlier round solved the targets, so that they are good starts.
    """
    timeline, robot = plan.timeline, ik.robot
    playback = ik.playback(timeline.share[:, None], plan.places, timeline.planted)
    tracks = ik.targets(clip.graph, timeline.at, plan.stands, playback, plan.zmp.centre)
    solver_clip = clip_of(ik.solver, tracks, Smoothing(), clip.fps)
    count.expect(round(ROUNDS * len(plan.targets) * ((0 if near else IN_TURN) + Smoothing().passes)))
    start = list(plan.targets) if near else _sequential_starts(ik, plan, solver_clip, count)
    poses = clip_passes(solver_clip, np.array(start), count)
    qpos = np.array([pose.qpos for pose in poses])
    pressed = tread(robot, qpos, timeline.fps, QUICK, plan.planes)
    margin = np.array([p.margin(x) for p, x in zip(plan.supports, pressed.point, strict=True)])
    standing = [spots[down].reshape(-1, 3) for spots, down in zip(plan.places, timeline.planted, strict=True)]
    return Balanced(
        tuple(poses),
        tuple(tracks),
        timeline,
        plan.places,
        plan.zmp,
        plan.slowdown,
        plan.stride,
        pressed.point,
        margin,
        pressed.friction(standing),
    )


def _sequential_starts(ik: BalancedIk, plan: PlaybackPlan, clip: ClipProblem, count: Count) -> list[Floats]:
    """Return (K, nq) starts of the passes: each frame starts from the correction of the frame before.

    Arms and head also start from their target, and the cheaper result wins. Arms in another basin would not leave it
    again. Arms that avoid a leaning trunk would meet it again at every frame.
    """
    robot, found, correction = ik.robot, [], np.zeros(ik.robot.model.nv)
    carried = ~np.isin(np.arange(robot.model.nv), robot.dof_index) | ik.leg_dofs
    for k, targets in enumerate(plan.targets):
        starts = [np.where(carried, correction, 0.0)]
        if np.abs(correction - starts[0]).max() > ASIDE:
            starts.append(correction)
        poses = [
            ik.solver.solve_frame(
                integrate(robot, targets, start), clip.all_targets.at(k), iterations=8, tolerance=1e-4
            )
            for start in starts
        ]
        pose = min(poses, key=lambda pose: pose.cost * (1 if pose is poses[0] else WORTH))
        correction = difference(robot, targets, pose.qpos)
        found.append(pose.qpos)
        count.advance(IN_TURN)
    return found


def _on_clip(robot: Robot, found: Balanced, clip: PlaybackClip) -> Floats:
    """Return (T, nq) configurations of a playback at the clip's own frames."""
    inside = np.flatnonzero(found.timeline.share >= 1)
    inside = inside[np.unique(found.timeline.at[inside], return_index=True)[1]]
    times = np.interp(np.arange(len(clip.qpos)), found.timeline.at[inside], inside / clip.fps)
    return sample(Trajectory(found.qpos, clip.fps, robot.joint_names, robot.name), robot, times)
