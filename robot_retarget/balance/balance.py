"""A draft becomes a motion that stands: from a balanced stand, over planted feet, back into a balanced stand.

    draft ──support──▶ footholds ──timeline──▶ pace ──zmp──▶ path of the centre of mass ──planter──▶ configurations

The last step is retargeting again: the human's edges at the playback's pace, with footholds and centre of mass on top.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.balance.beside import parted
from robot_retarget.balance.outline import Clip, Outline, outlined
from robot_retarget.balance.planter import Planter
from robot_retarget.balance.stand import balanced_stand, in_place, posed_in_place, stand_places
from robot_retarget.balance.steps import carried, within_reach
from robot_retarget.balance.support import kept_down, planted_feet
from robot_retarget.balance.timeline import Pacing, Timeline, motion_needs, shift_needs, stretched, unhurried
from robot_retarget.balance.zmp import Plan, Steadiness
from robot_retarget.describe.activity import activity_of, require_own_feet
from robot_retarget.describe.graph import Graph, graph_from
from robot_retarget.describe.likeness import likeness_of
from robot_retarget.describe.track import Track
from robot_retarget.errors import BalanceError, UsageError, known
from robot_retarget.motion.resample import at_frames
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import joint_torques, tread
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.timing import sample
from robot_retarget.solve.clip import Clip as SolverClip
from robot_retarget.solve.clip import clip_passes, smoothness
from robot_retarget.solve.options import Smoothing
from robot_retarget.solve.problem import wishes_of
from robot_retarget.solve.progress import Count
from robot_retarget.solve.solution import Solution
from robot_retarget.solve.solve import solution_of
from robot_retarget.solve.sqp import Pose
from robot_retarget.trajectory import Trajectory

SWAY = 0.5
"""A body goes along with its footholds smoothly, over this time [s]."""
QUICK = 0.04
"""Servos do not follow what is quicker [s]: the zero moment point is that of a motion smoothed so far."""

LEGS = ("auto", "follow", "stand")
MODES = ("auto", "static", "dynamic", "off")


@dataclass(frozen=True, eq=False)
class Balanced:
    """A playback that stands, as far as it was planned."""

    poses: tuple[Pose, ...]
    """K frames."""
    tracks: tuple[Track, ...]
    """What was asked of them."""
    timeline: Timeline
    places: Floats
    """(K, F, 4, 3) of the soles [m]."""
    plan: Plan
    slowdown: float
    """Duration within the clip over the clip's own."""
    stride: float
    """Length of the steps over the clip's own."""
    legs: str
    """`follow` or `stand`."""
    zmp: Floats
    """(K, 2) [m]."""
    margin: Floats
    """(K,) of the zero moment point inside the full support polygon [m]."""
    friction: Floats
    """(K,) coefficient of the floor that the soles need."""
    instead: str = ""
    """Why both feet stay in place though they were to follow if they can."""

    @property
    def qpos(self) -> Floats:
        """(K, nq)."""
        return np.array([pose.qpos for pose in self.poses])

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the clip, a sentence each."""
        slower = f"slowed down {self.slowdown:.2f} times" if self.slowdown > 1.005 else "played at its own pace"
        shorter = f", steps shortened to {self.stride:.2f} of their length" if self.stride < 0.995 else ""
        feet = ", both feet in place" if self.legs == "stand" else ""
        why = (f"both feet stay in place: {self.instead}",) if self.instead else ()
        return (f"balanced: {slower}{shorter}{feet}, with a stand before and after", *why)


def balance_of(robot: Robot, legs: str, balance: str) -> str:
    """The mode of balance for a robot: what was asked for, or what `auto` means for it.

    Raises:
        UsageError: an unknown choice, or legs that stand without balance.
        BalanceError: balance is asked for, and the robot cannot stand free.
    """
    for what, choice, choices in (("legs", legs, LEGS), ("balance", balance, MODES)):
        if choice not in choices:
            raise UsageError(f"unknown {what} {choice!r}; {known(choices)}")
    if legs == "stand" and balance == "off":
        raise UsageError("legs 'stand' needs balance: 'static' or 'dynamic'")
    servos = robot.floating and robot.path.with_name("servos.toml").is_file()
    mode = ("static" if servos or legs == "stand" else "off") if balance == "auto" else balance
    if mode != "off" and not robot.floating:
        raise BalanceError(f"balance {mode!r} needs a robot with a free root; the root of {robot.name!r} is not free")
    return mode


@dataclass(frozen=True)
class Acceptable:
    """How far following the human's legs may go from the human before both feet stay in place instead."""

    slowdown: float = 2.5
    """Time, over the human's [-]."""
    legs: float = 0.45
    """Mean angle of thighs and shins to the human's [rad]."""
    trunk: float = 0.25
    """Mean angle of the trunk [rad]."""


def in_balance(graph: Graph, draft: Solution, legs: str, mode: str) -> tuple[Balanced, Graph, Solution]:
    """Bring a draft into balance; the graph at the frames of the playback, and its solution.

    Raises:
        BalanceError: the motion leaves the floor, something holds the human up, or the robot has fewer than two feet.
    """
    if len(graph.match.anatomy.soles) < 2:
        raise BalanceError(f"{graph.robot.name} has no two feet to stand on: do without balance (balance 'off')")
    planter = Planter(graph)
    if legs == "stand":
        return _played_as(planter, draft, "stand", mode)
    try:
        require_own_feet(activity_of(graph.motion, graph.match))
        found = _played_as(planter, draft, "follow", mode)
    except BalanceError as error:
        if legs == "follow":
            raise
        return _instead(_played_as(planter, draft, "stand", mode), str(error).split(": a robot that stands free")[0])
    reason = "" if legs == "follow" else _unlike(found)
    return _instead(_played_as(planter, draft, "stand", mode), reason) if reason else found


def _unlike(found: tuple[Balanced, Graph, Solution], acceptable: Acceptable | None = None) -> str:
    """Why a playback that follows the legs is too unlike the human; empty where it is not."""
    most, (balanced, graph, solution) = acceptable or Acceptable(), found
    inside = balanced.timeline.share >= 1
    likeness = likeness_of(graph.at(inside), solution.trajectory.qpos[inside])
    if balanced.slowdown > most.slowdown:
        return f"stepping would take {balanced.slowdown:.1f} times as long as the human"
    for part, bound in (("legs", most.legs), ("trunk", most.trunk)):
        off = likeness.part(part) or 0.0
        if off > bound:
            return f"stepping would turn the {part} {np.degrees(off):.0f}° from the human's"
    return ""


def _instead(found: tuple[Balanced, Graph, Solution], reason: str) -> tuple[Balanced, Graph, Solution]:
    balanced, graph, solution = found
    return replace(balanced, instead=reason), graph, solution


def _played_as(planter: Planter, draft: Solution, legs: str, mode: str) -> tuple[Balanced, Graph, Solution]:
    """A playback whose legs follow the human's or stand."""
    qpos, graph = draft.trajectory.qpos, planter.graph
    clip = _standing(planter, qpos) if legs == "stand" else _stepping(planter, qpos)
    found = replace(paced(planter, clip, Steadiness(static=mode == "static")), legs=legs)
    frames = np.round(found.timeline.at).astype(int)
    motion = at_frames(clip.graph.motion, found.timeline.at, graph.fps)
    played = replace(clip.graph.at(frames), motion=motion, tracks=found.tracks)
    solution = solution_of(planter.solver, played, list(found.poses), draft.timings)
    times = np.interp(found.timeline.at, np.arange(len(graph)), draft.trajectory.source_time)
    return found, played, replace(solution, trajectory=replace(solution.trajectory, source_time=times))


def _standing(planter: Planter, draft: Floats) -> Clip:
    """Both feet in the balanced stand all the time."""
    graph, places = planter.graph, stand_places(planter)
    human, turns = in_place(graph.human, graph.match)
    posed, count = posed_in_place(planter, draft, turns, balanced_stand(planter, places)), len(draft)
    still = graph_from(graph, human)
    return Clip(still, posed, np.tile(places, (count, 1, 1, 1)), np.ones((count, len(planter.feet)), bool), graph.fps)


def _stepping(planter: Planter, draft: Floats) -> Clip:
    """The draft's steps within the robot's reach, its body going along.

    Raises:
        BalanceError: it leaves the floor.
    """
    graph, fps = planter.graph, planter.graph.fps
    corners = planter.corners(draft)
    planted = planted_feet(graph.human.contacts, planter.feet, corners, planter.leg, fps)
    own = stand_places(planter)
    corners = parted(corners, own)
    kept = kept_down(planted, corners, planter.leg, fps)
    if kept.all():
        return Clip(graph, draft, corners, kept, fps)
    placed = within_reach(kept, corners, own, planter.leg)
    root = slice(planter.robot.root_address, planter.robot.root_address + 2)
    posed = np.array(draft)
    posed[:, root] += gaussian_filter1d((placed - corners).mean(axis=(1, 2))[:, :2], SWAY * fps, axis=0, mode="nearest")
    stride = carried(kept, placed) / max(carried(kept, corners), 1e-9)
    return Clip(graph, posed, placed, kept, fps, stride)


def paced(planter: Planter, clip: Clip, how: Steadiness, pacing: Pacing | None = None) -> Balanced:
    """The clip in balance, slowed down where a joint, the zero moment point or a shift of weight needs the time."""
    chosen = pacing or Pacing()
    stretch = unhurried(clip.planted, clip.fps, chosen)
    outline = outlined(planter, clip, stretch, how)
    for _ in range(chosen.shifts):
        late = outline.plan.excess > chosen.excess
        if not late.any() or stretch.mean() >= chosen.slowest - 1e-3:
            break
        stretch = stretched(stretch, outline.timeline, shift_needs(late, outline.timeline, chosen), chosen)
        outline = outlined(planter, clip, stretch, how)
    found = played(planter, clip, outline)
    for _ in range(chosen.rounds):
        loads = joint_torques(planter.robot, found.qpos, clip.fps, planter.soles, QUICK)
        inside = found.margin / outline.reach
        needs = motion_needs(planter.robot, found.qpos, loads, inside, found.friction, clip.fps, chosen)
        if needs.max() <= chosen.slack or stretch.mean() >= chosen.slowest - 1e-3:
            break
        stretch = stretched(stretch, outline.timeline, needs, chosen)
        clip = replace(clip, qpos=_on_clip(planter.robot, found, clip))
        outline = outlined(planter, clip, stretch, how)
        found = played(planter, clip, outline, near=True)
    return found


def played(planter: Planter, clip: Clip, outline: Outline, near: bool = False) -> Balanced:
    """The configurations that follow an outline; `near` where the clip's configurations have been planted before."""
    tracks = asked(planter, clip, outline)
    wishes, graph, robot = wishes_of(tracks), clip.graph, planter.robot
    smooth = smoothness(robot, graph.weights.smooth, graph.weights.smooth_root, clip.fps)
    solver_clip = SolverClip(planter.solver, wishes, Smoothing(), smooth, clip.fps)
    start = list(outline.wished) if near else _in_turn(planter, outline, solver_clip)
    poses = clip_passes(solver_clip, start, Count(None, 1))
    qpos, timeline = np.array([pose.qpos for pose in poses]), outline.timeline
    pressed = tread(robot, qpos, timeline.fps, QUICK)
    margin = np.array([p.margin(x) for p, x in zip(outline.supports, pressed.point, strict=True)])
    standing = [spots[down].reshape(-1, 3) for spots, down in zip(outline.places, timeline.planted, strict=True)]
    return Balanced(
        tuple(poses),
        tuple(tracks),
        timeline,
        outline.places,
        outline.plan,
        outline.slowdown,
        outline.stride,
        "follow",
        pressed.point,
        margin,
        pressed.friction(standing),
    )


def asked(planter: Planter, clip: Clip, outline: Outline) -> list[Track]:
    """What is asked of a playback: the human's edges at its pace, fading into the stands, feet and mass as outlined."""
    timeline, tracks = outline.timeline, []
    share, first = timeline.share[:, None], np.arange(len(timeline.share)) < len(timeline.share) // 2
    for track in clip.graph.tracks:
        own = track.resampled(timeline.at)
        stand = np.where(first[:, None], *(planter.measured(track.name, stand)[None] for stand in outline.stands))
        if track.name == "rest":
            own = replace(
                own,
                lower=np.where(share < 1, stand, own.lower),
                upper=np.where(share < 1, stand, own.upper),
                priority=own.priority + (1 - share) * planter.options.standing,
            )
        elif track.name == "path":
            height = share * np.minimum(own.lower, stand) + (1 - share) * stand
            weight = np.where([axis == "z" for axis in own.axes], planter.options.height, 0.0)
            own = replace(own, lower=height, upper=height, priority=np.broadcast_to(weight, height.shape))
        else:
            own = replace(own, priority=own.priority * share)
        tracks.append(own)
    return planter.planted(tracks, outline.places, timeline.planted, outline.plan.centre)


def _in_turn(planter: Planter, outline: Outline, clip: SolverClip) -> list[Floats]:
    """(K, nq) each frame from the correction of root and legs in the one before: where the passes over all frames begin.

    Arms and head begin as they are wished: one that came to another basin would not leave it again.
    """
    robot, solver, found = planter.robot, planter.solver, []
    carried = ~np.isin(np.arange(robot.model.nv), robot.dof_index) | planter.leg_dofs
    correction = np.zeros(robot.model.nv)
    for k, wish in enumerate(outline.wished):
        start = integrate(robot, wish, correction)
        pose = solver.descend(start, clip.wishes.at(k), iterations=8, tolerance=1e-4)
        correction = np.where(carried, difference(robot, wish, pose.qpos), 0.0)
        found.append(pose.qpos)
    return found


def _on_clip(robot: Robot, found: Balanced, clip: Clip) -> Floats:
    """(T, nq) what a playback does at the clip's own frames."""
    inside = np.flatnonzero(found.timeline.share >= 1)
    inside = inside[np.unique(found.timeline.at[inside], return_index=True)[1]]
    times = np.interp(np.arange(len(clip.qpos)), found.timeline.at[inside], inside / clip.fps)
    return sample(Trajectory(found.qpos, clip.fps, robot.joint_names, robot.name), robot, times)
