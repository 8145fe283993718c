"""Turn a draft into a motion in balance: from a balanced stand, over planted feet, back into a balanced stand.

    draft ──support──▶ footholds ──timeline──▶ pace ──zmp──▶ path of the centre of mass ──balanced_ik──▶ configurations

The last step is a second retargeting: the human's edges at the playback's pace, plus footholds and centre of mass.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from robot_retarget.base.arrays import Floats, bearing
from robot_retarget.base.errors import BalanceError, UsageError, known
from robot_retarget.base.progress import Count, Progress
from robot_retarget.contact.soles import sole_contacts
from robot_retarget.graph.describe import RobotGraph, graph_from
from robot_retarget.human.activity import SUPPORTED
from robot_retarget.human.resample import at_frames
from robot_retarget.robot import Robot
from robot_retarget.scene.geoms import SolidGround
from robot_retarget.scores.likeness import Alike, likeness_of
from robot_retarget.solver.balance.balanced_ik import (
    BalancedIk,
    balanced_stand,
    in_place,
    posed_in_place,
    stand_places,
    with_margin,
)
from robot_retarget.solver.balance.footsteps import (
    REACH,
    planted_feet,
    reachable_footholds,
    spread,
    total_step_length,
    without_small_swings,
)
from robot_retarget.solver.balance.plan import DYNAMIC, STATIC, SWEEPS, PlaybackClip
from robot_retarget.solver.balance.playback import MARGIN, Balanced, expected_steps, paced
from robot_retarget.solver.balance.turns import turned_soles, turning_steps
from robot_retarget.solver.solution import Solution
from robot_retarget.solver.solve import solution_of

SWAY = 0.5
"""The body follows the shift of its footholds smoothly, over this time [s]. Half and double change nothing in the
sample walk on the OP3."""

LEGS = ("auto", "follow", "stand")
MODES = ("auto", "static", "dynamic", "off")


def balance_modes(robot: Robot, legs: str, balance: str) -> tuple[str, ...]:
    """Return the modes of balance to try, in order of preference; empty without balance.

    A robot in static balance may halt at any time. Dynamic balance needs less time for a step.

    Raises:
        UsageError: an unknown choice, or legs that stand without balance.
        BalanceError: balance is required, and the robot has no free root.
    """
    for what, choice, choices in (("legs", legs, LEGS), ("balance", balance, MODES)):
        if choice not in choices:
            raise UsageError(f"unknown {what} {choice!r}; {known(choices, typed=choice)}")
    if legs == "stand" and balance == "off":
        raise UsageError("legs 'stand' needs balance: 'static' or 'dynamic'")
    if balance == "auto":
        free = robot.floating and robot.servo_map is not None
        modes = ("static",) if legs == "stand" else ("dynamic", "static") if free else ()
    else:
        modes = () if balance == "off" else (balance,)
    if modes and not robot.floating:
        raise BalanceError(
            f"balance {modes[0]!r} needs a robot with a free root; the root of {robot.name!r} is not free"
        )
    return modes


Played = tuple[Balanced, RobotGraph, Solution]
"""A playback, the graph at its frames, and its solution."""
Attempt = tuple[str, PlaybackClip, Alike | None]
"""A mode of balance, a clip and the limits of its playback."""


def in_balance(
    graph: RobotGraph, draft: Solution, legs: str, modes: tuple[str, ...], progress: Progress | None = None
) -> Played:
    """Bring a draft into balance; return the playback, the graph at its frames, and its solution.

    Args:
        graph: of the draft.
        draft: a solution without balance.
        legs: `auto`, `follow` or `stand`.
        modes: of balance, in order of preference.
        progress: receives (steps done, steps in all).

    Raises:
        BalanceError: the motion leaves the floor, something holds the human up, the robot has fewer than two feet, or the motion
            has one frame.
    """
    if len(graph.match.anatomy.soles) < 2:
        raise BalanceError(f"{graph.robot.name} has no two feet to stand on: do without balance (balance 'off')")
    if len(graph) < 2:
        raise BalanceError("a motion of one frame has no playback: take more frames, or use balance 'off'")
    ik, count = BalancedIk(graph), Count(progress, expected_steps(graph))
    reason, turns = "", list[Attempt]()
    if legs != "stand":
        try:
            _require_own_feet(graph.human.not_standing)
            return _first_within(ik, draft, _steps(ik, draft, modes, auto=legs == "auto"), count)
        except BalanceError as error:
            if legs == "follow":
                raise
            reason = str(error).split(": a robot that stands free")[0]
        turning = _standing(ik, draft.trajectory.qpos, turning=True)
        if not turning.planted.all() and graph.human.activity.kind != SUPPORTED:
            turns = [(modes[0], clip, Alike(unlike_legs=np.pi)) for clip in _paces(ik, turning)]
    stand: Attempt = modes[-1], _standing(ik, draft.trajectory.qpos), None
    balanced, played, solution = _first_within(ik, draft, [*turns, stand], count)
    held = replace(balanced, legs="stand" if balanced.timeline.planted.all() else "turn", instead=reason)
    return held, played, solution


def _require_own_feet(needed: str) -> None:
    """Raises: BalanceError: a motion needs what a robot on its own feet does not have (`HumanFeatures.not_standing`)."""
    if needed:
        raise BalanceError(
            f"{needed}: a robot that stands free cannot play that; keep both feet on the floor (legs 'stand'), or do "
            "without balance (balance 'off')"
        )


def _steps(ik: BalancedIk, draft: Solution, modes: tuple[str, ...], auto: bool) -> list[Attempt]:
    """Return the attempts to follow the human's steps, the most human-like ones first: in the first mode alone if `auto`, without limits at last otherwise."""
    planned = _stepping(ik, draft.trajectory.qpos)
    if planned.planted.all():  # nothing is lost in static balance
        tried = [(mode, planned) for mode in reversed(modes)]
    else:
        shorter = [_stepping(ik, draft.trajectory.qpos, share) for share in (0.75, 0.5)]
        steps = {"dynamic": [c for clip in (planned, *shorter) for c in _paces(ik, clip)], "static": shorter[1:]}
        tried = [(mode, clip) for mode in (modes[:1] if auto else modes) for clip in steps[mode]]
    return [(*each, Alike()) for each in tried[:-1]] + [(*tried[-1], Alike() if auto else None)]


def _first_within(ik: BalancedIk, draft: Solution, attempts: list[Attempt], count: Count) -> Played:
    """Return the first playback that keeps to its limits. Raises: BalanceError: the last attempt does not."""
    *others, last = attempts
    for attempt in others:
        with suppress(BalanceError):
            return _played_as(ik, draft, count, *attempt)
    return _played_as(ik, draft, count, *last)


def _require_alike(graph: RobotGraph, qpos: Floats, frames: np.ndarray, most: Alike) -> None:
    """Raises: BalanceError: legs or trunk are too far from the human's."""
    likeness = likeness_of(graph.human, graph.robot, qpos, frames)
    for part, bound in (("legs", most.unlike_legs), ("trunk", most.unlike_trunk)):
        if (off := likeness.part(part) or 0.0) > bound and likeness.beyond(part) > bound:
            raise BalanceError(f"stepping would turn the {part} {np.degrees(off):.0f}° from the human's")


def _played_as(
    ik: BalancedIk, draft: Solution, count: Count, mode: str, clip: PlaybackClip, most: Alike | None = None
) -> Played:
    """Return the playback of a clip in a mode of balance.

    Raises:
        BalanceError: the result exceeds limits, or comes nearer than `MARGIN` to the edge of the support.
    """
    slowest = most.unlike_slowdown if most else np.inf
    found = replace(paced(ik, clip, (STATIC,) if mode == "static" else DYNAMIC, count, slowest), mode=mode)
    frames = np.round(found.timeline.at).astype(int)
    motion = at_frames(clip.graph.motion, found.timeline.at, ik.graph.fps)
    played = replace(clip.graph.at(frames), motion=motion, tracks=found.tracks)
    if most:
        if found.margin.min() < MARGIN * ik.leg:
            tips = found.margin.argmin() / found.timeline.fps
            raise BalanceError(f"stepping would tip the robot over at {tips:.1f} s of the playback")
        _require_alike(played, found.qpos, found.timeline.share >= 1, most)
    solution = solution_of(ik.solver, played, list(found.poses), draft.timings)
    times = np.interp(found.timeline.at, np.arange(len(ik.graph)), draft.trajectory.source_time)
    return found, played, replace(solution, trajectory=replace(solution.trajectory, balance=mode, source_time=times))


def _standing(ik: BalancedIk, draft: Floats, turning: bool = False) -> PlaybackClip:
    """Return a clip with both feet in the balanced stand at all frames; `turning` with the human in small steps."""
    graph, own = ik.graph, stand_places(ik)
    human, turns = in_place(graph.human, graph.match, turning)
    posed = posed_in_place(ik, draft, turns, balanced_stand(ik, own))
    planted, headings = np.ones((len(draft), len(ik.feet)), bool), _headings(graph) * turning
    planted, places = turning_steps(planted, turned_soles(own, headings), own, headings, graph.fps, ik.turn)
    still = graph_from(graph, human)
    return PlaybackClip(still, posed, places, planted, graph.fps, ground=SolidGround(still.bodies))


def _paces(ik: BalancedIk, clip: PlaybackClip) -> list[PlaybackClip]:
    """Return the clip at each of the paces to try: without feedback, a robot falls more often with quick steps."""
    sweeps = SWEEPS if getattr(ik.robot.servo_map, "balance", None) else SWEEPS[-1:]
    return [replace(clip, sweep=sweep) for sweep in sweeps]


def _headings(graph: RobotGraph) -> Floats:
    """Return (T,) the human's heading [rad]."""
    return np.unwrap(bearing(graph.human.heading))


def _stepping(ik: BalancedIk, draft: Floats, share: float = 1.0) -> PlaybackClip:
    """Return the draft with steps within a share of the robot's reach; its body follows them."""
    graph, fps, ground = ik.graph, ik.graph.fps, SolidGround(ik.graph.bodies)
    corners = ik.corners(draft)
    own_feet = sole_contacts(graph.robot, graph.match.anatomy, draft, fps, graph.bodies)
    planted = planted_feet(graph.human.contacts, own_feet, corners, fps)
    own = stand_places(ik)
    corners = spread(corners, own)
    kept = without_small_swings(planted, corners, ik.leg, fps, ground)
    kept, corners = turning_steps(kept, corners, own, _headings(graph), fps, ik.turn)
    if kept.all() or graph.bodies is not None:  # a shorter step would miss its place next to a body
        return PlaybackClip(graph, draft, corners, kept, fps, ground=ground)
    placed = reachable_footholds(kept, corners, own, ik.leg, share * REACH)
    root = slice(ik.robot.root_address, ik.robot.root_address + 2)
    posed = np.array(draft)
    posed[:, root] += gaussian_filter1d((placed - corners).mean(axis=(1, 2))[:, :2], SWAY * fps, axis=0, mode="nearest")
    stride = total_step_length(kept, placed) / max(total_step_length(kept, corners), 1e-9)
    return PlaybackClip(with_margin(graph, ik.options.arms * ik.leg, ik.limbs), posed, placed, kept, fps, stride)
