"""Turn a draft into a motion in balance: from a balanced stand, over planted feet, back into a balanced stand.

    draft ──support──▶ footholds ──timeline──▶ pace ──zmp──▶ path of the centre of mass ──balanced_ik──▶ configurations

The last step is a second retargeting: the human's edges at the playback's pace, plus footholds and centre of mass.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from robot_retarget.base.arrays import Floats, bearing
from robot_retarget.base.errors import BalanceError, UsageError, known
from robot_retarget.base.progress import Count, Progress
from robot_retarget.contact.rule import DRAFT, SOLES
from robot_retarget.contact.soles import sole_contacts
from robot_retarget.graph.describe import RobotGraph, graph_from
from robot_retarget.human.activity import SUPPORTED
from robot_retarget.human.motion import at_frames
from robot_retarget.robot import Robot
from robot_retarget.scene.geoms import SolidGround
from robot_retarget.scores.likeness import Alike, Likeness, likeness_of
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
from robot_retarget.solver.balance.playback import MARGIN, Balanced, begun, expected_steps, foreseen, playbacks
from robot_retarget.solver.balance.turns import turned_soles, turning_steps
from robot_retarget.solver.solution import Solution
from robot_retarget.solver.solve import solution_of

SWAY = 0.5
"""The body follows the shift of its footholds smoothly, over this time [s]. Half and double change nothing in the
sample walk on the OP3."""

SURE = 1.2
"""Legs and trunk of a few moments are foreseen to differ by more than a limit if they do by this factor more: 2.3° of a trunk's 11.5 [-]."""
FAR = 0.5
"""A zero moment point of the steps alone farther outside the soles than this comes in no more, over the leg: 110 mm on the OP3. In thirteen clips it is at
−62 mm or nearer in those that come in, and at −249 mm and farther in a kick that does not [-]."""

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


@dataclass(frozen=True, eq=False)
class Attempt:
    """A way to play a clip, and what came of it."""

    legs: str
    """`follow`, `turn` or `stand`, as in `Balanced`."""
    mode: str
    share: float = 1.0
    """Longest steps over the robot's reach [-]."""
    clip: PlaybackClip | None = None
    """None where the motion leaves the feet."""
    most: Alike | None = None
    """Its limits; None for a last resort."""
    found: Balanced | None = None
    """The playback, if limbs were solved."""
    slowdown: float | None = None
    solved: int = 0
    """Number of playbacks whose limbs were solved."""
    reasons: tuple[str, ...] = ()
    """What speaks against it; empty where it keeps its limits."""

    @property
    def row(self) -> dict[str, Any]:
        """Its line of a report."""
        figures = {"legs": self.legs, "mode": self.mode, "reach": self.share, "solved": self.solved}
        if self.slowdown is not None:
            figures["slowdown"] = round(self.slowdown, 3)
        if self.found is not None:
            margin = round(float(self.found.margin.min()), 4)
            figures |= {"stride": round(self.found.stride, 3), "sweep": self.found.sweep, "margin_m": margin}
        return figures | {"reasons": "; ".join(self.reasons)}


def require_playable(graph: RobotGraph, legs: str) -> None:
    """Check, before anything is solved, that a robot can play a motion standing.

    Raises:
        BalanceError: the robot has fewer than two feet, the motion has one frame, or `legs` is `follow`, and the motion leaves the
            feet.
    """
    if len(graph.match.anatomy.soles) < 2:
        raise BalanceError(f"{graph.robot.name} has no two feet to stand on: do without balance (balance 'off')")
    if len(graph) < 2:
        raise BalanceError("a motion of one frame has no playback: take more frames, or use balance 'off'")
    if legs == "follow" and graph.human.not_standing:
        raise BalanceError(
            f"{graph.human.not_standing}: a robot that stands free cannot play that; keep both feet on the floor (legs "
            "'stand'), or do without balance (balance 'off')"
        )


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
    """
    ik, count, tried = BalancedIk(graph), Count(progress, expected_steps(graph)), list[Attempt]()
    for attempt in _ways(ik, draft, legs, modes):
        tried.append(attempt if attempt.reasons else _tried(ik, attempt, count))
        if not tried[-1].reasons:
            break
    chosen = min(tried, key=lambda attempt: len(attempt.reasons))
    assert chosen.found is not None and chosen.clip is not None
    off = next((reason for attempt in tried if attempt.legs == "follow" for reason in attempt.reasons), "")
    balanced = replace(
        chosen.found,
        legs=chosen.legs if not chosen.found.timeline.planted.all() or chosen.legs == "follow" else "stand",
        mode=chosen.mode,
        instead=off if chosen.legs != "follow" else "",
        attempts=tuple(attempt.row for attempt in tried),
    )
    played = replace(_graph_at(ik, chosen.clip, balanced.timeline.at), tracks=balanced.tracks)
    solution = solution_of(ik.solver, played, list(balanced.poses), draft.timings)
    times = np.interp(balanced.timeline.at, np.arange(len(graph)), draft.trajectory.source_time)
    moved = replace(solution.trajectory, balance=chosen.mode, source_time=times)
    return balanced, played, replace(solution, trajectory=moved)


def _ways(ik: BalancedIk, draft: Solution, legs: str, modes: tuple[str, ...]) -> Iterator[Attempt]:
    """Yield the ways to play a clip, the most human-like first and one without limits last."""
    graph, qpos = ik.graph, draft.trajectory.qpos
    if legs != "stand":
        if not graph.human.not_standing:
            yield from _steps(ik, qpos, modes, auto=legs == "auto")
        else:
            yield Attempt("follow", modes[0], reasons=(graph.human.not_standing,))
        turning = _standing(ik, qpos, turning=True)
        if not turning.planted.all() and graph.human.activity.kind != SUPPORTED:
            yield Attempt("turn", modes[0], clip=turning, most=Alike(unlike_legs=np.pi))
    yield Attempt("stand", modes[-1], clip=_standing(ik, qpos))


def _steps(ik: BalancedIk, qpos: Floats, modes: tuple[str, ...], auto: bool) -> Iterator[Attempt]:
    """Yield the ways to follow the human's steps: in the first mode alone if `auto`, in all of them and the last without limits otherwise."""
    planned = _stepping(ik, qpos)
    if planned.planted.all():  # static balance loses no likeness
        tried = [(mode, 1.0) for mode in reversed(modes)]
    else:
        shares = {"dynamic": (1.0, 0.75, 0.5), "static": (0.5,)}
        tried = [(mode, share) for mode in (modes[:1] if auto else modes) for share in shares[mode]]
    for mode, share in tried:
        clip = planned if share == 1 else _stepping(ik, qpos, share)
        yield Attempt("follow", mode, share, clip, Alike() if auto or (mode, share) != tried[-1] else None)


def _tried(ik: BalancedIk, attempt: Attempt, count: Count) -> Attempt:
    """Return an attempt with its playback, or with what speaks against it.

    What cannot work is known from the steps and a few moments, before limbs are solved. Pace and likeness end it after any round.
    """
    clip, most = attempt.clip, attempt.most
    assert clip is not None
    ends = (STATIC,) if attempt.mode == "static" else DYNAMIC
    swift = attempt.mode == "dynamic" and getattr(ik.robot.servo_map, "balance", None)
    start = begun(
        ik, replace(clip, sweep=SWEEPS[0] if swift else SWEEPS[-1]), ends, most.unlike_slowdown if most else np.inf
    )
    found, solved, slowdown = None, 0, float(start.stretch.mean())
    reasons = _unlike(slowdown, most)
    if not reasons:
        start, margin, frames, qpos = foreseen(ik, start, ends)
        moments = likeness_of(_graph_at(ik, clip, start.plan.timeline.at[frames]).human, ik.robot, qpos)
        reasons = _unlike(slowdown, most, moments, SURE) or _tipping(margin, most, -FAR * ik.leg, clip.fps)
    for found in () if reasons else playbacks(ik, start, ends, count):
        solved, slowdown, inside = solved + 1, found.slowdown, found.timeline.inside
        likeness = likeness_of(_graph_at(ik, clip, found.timeline.at).human, ik.robot, found.qpos, inside)
        if reasons := _unlike(slowdown, most, likeness):
            break
    if found is not None and not reasons:
        reasons = _tipping(found.margin, most, MARGIN * ik.leg, clip.fps)
    return replace(attempt, found=found, solved=solved, slowdown=slowdown, reasons=reasons)


def _unlike(
    slowdown: float, most: Alike | None, likeness: Likeness | None = None, sure: float = 1.0
) -> tuple[str, ...]:
    """Return how pace, legs and trunk differ from the human's by more than the limits, those of legs and trunk times `sure`."""
    if most is None:
        return ()
    late = slowdown > most.unlike_slowdown
    reasons = [f"stepping would take over {most.unlike_slowdown:g} times as long as the human"] if late else []
    for part, bound in (("legs", sure * most.unlike_legs), ("trunk", sure * most.unlike_trunk)):
        if likeness and (off := likeness.part(part) or 0.0) > bound and likeness.beyond(part) > bound:
            reasons.append(f"stepping would turn the {part} {np.degrees(off):.0f}° from the human's")
    return tuple(reasons)


def _tipping(margin: Floats, most: Alike | None, least: float, fps: float) -> tuple[str, ...]:
    """Return where the margins (K,) of the zero moment point are below a least one [m]."""
    if most is None or margin.min() >= least:
        return ()
    return (f"stepping would tip the robot over at {margin.argmin() / fps:.1f} s of the playback",)


def _graph_at(ik: BalancedIk, clip: PlaybackClip, at: Floats) -> RobotGraph:
    """Return the graph at frames (K,) of the clip."""
    return replace(clip.graph.at(np.round(at).astype(int)), motion=at_frames(clip.graph.motion, at, ik.graph.fps))


def _standing(ik: BalancedIk, draft: Floats, turning: bool = False) -> PlaybackClip:
    """Return a clip with both feet in the balanced stand at all frames; `turning` with the human in small steps."""
    graph, own = ik.graph, stand_places(ik)
    human, turns = in_place(graph.human, graph.match, turning)
    posed = posed_in_place(ik, draft, turns, balanced_stand(ik, own))
    planted, headings = np.ones((len(draft), len(ik.feet)), bool), _headings(graph) * turning
    planted, places = turning_steps(planted, turned_soles(own, headings), own, headings, graph.fps, ik.turn)
    still = graph_from(graph, human)
    return PlaybackClip(still, posed, places, planted, graph.fps, ground=SolidGround(still.bodies))


def _headings(graph: RobotGraph) -> Floats:
    """Return (T,) the human's heading [rad]."""
    return np.unwrap(bearing(graph.human.heading))


def _stepping(ik: BalancedIk, draft: Floats, share: float = 1.0) -> PlaybackClip:
    """Return the draft with steps within a share of the robot's reach; its body follows them."""
    graph, fps, ground = ik.graph, ik.graph.fps, SolidGround(ik.graph.bodies)
    corners = ik.corners(draft)
    rule = SOLES if graph.match.recognition.segments else DRAFT  # the feet of a robot that performs are flat
    own_feet = sole_contacts(graph.robot, graph.match.anatomy, draft, fps, graph.bodies, rule)
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
    return PlaybackClip(with_margin(graph, ik.options.arms * ik.leg, ik.limbs[:2]), posed, placed, kept, fps, stride)
