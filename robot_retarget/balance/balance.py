"""A draft becomes a motion that stands: from a balanced stand, over planted feet, back into a balanced stand.

    draft ──support──▶ footholds ──retime──▶ timeline ──zmp──▶ path of the centre of mass ──planting──▶ configurations

All but the last is laid out in `outline.py`, round after round. Nothing of it looks at the human again: the draft is what the robot should do, and is changed as little as balance asks.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.balance.beside import parted
from robot_retarget.balance.outline import Clip, Outline, outlined
from robot_retarget.balance.planting import Planter
from robot_retarget.balance.retime import Pacing, Score, motion_needs, shift_needs, stretched, unhurried
from robot_retarget.balance.stand import balanced_stand, over_stand, stand_places
from robot_retarget.balance.steps import carried, within_reach
from robot_retarget.balance.support import kept_down, planted_feet
from robot_retarget.balance.zmp import Plan, Steadiness
from robot_retarget.describe.match import Match
from robot_retarget.errors import BalanceError, UsageError, known
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import joint_torques, tread
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.timing import sample
from robot_retarget.solve.footing import HOLD
from robot_retarget.solve.smooth import smooth_offsets
from robot_retarget.trajectory import Trajectory

SWAY = 0.5
"""A body goes along with its footholds smoothly, over this time [s]."""
SWING = 1e3
"""Weight of a foot in the air, over the squared leg length."""
STOOP = 0.1
"""A robot that steps carries its pelvis this share of a leg lower than in the stand: straight knees have to hurry."""
EASINGS = 4
"""Rounds of smoothing where joints leap, each planted anew."""
EASE = 0.3
"""Time to either side of a leap that is smoothed [s]."""
EASE_STIFFNESS = 200.0
"""As `smooth.smooth_offsets`, at 30 frames a second."""
STIFFNESS = 3.0
"""The same of the whole motion, which is then planted anew: nearly straight knees answer the pelvis with jolts."""
JOLT = 0.5
"""A joint that changes its speed by this share of its greatest from frame to frame leaps."""
QUICK = 0.04
"""Servos do not follow what is quicker [s]: the zero moment point is that of a motion smoothed so far."""

LEGS = ("follow", "stand")
MODES = ("auto", "static", "dynamic", "off")


@dataclass(frozen=True)
class Balanced:
    """A playback that stands, as far as it was planned."""

    qpos: Floats
    """(K, nq)."""
    score: Score
    places: Floats
    """(K, F, 4, 3) of the soles [m]."""
    plan: Plan
    slowdown: float
    """Duration within the clip over the clip's own."""
    stride: float
    """Length of the steps over the clip's own."""
    zmp: Floats
    """(K, 2) [m]."""
    margin: Floats
    """(K,) of the zero moment point inside the full support polygon [m]."""
    friction: Floats
    """(K,) coefficient of the floor that the soles need."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the clip, a sentence each."""
        slower = f"slowed down {self.slowdown:.2f} times" if self.slowdown > 1.005 else "played at its own pace"
        shorter = f", steps shortened to {self.stride:.2f} of their length" if self.stride < 0.995 else ""
        return (f"balanced: {slower}{shorter}, with a stand before and after",)


def clip_of(planter: Planter, draft: Floats, stances: dict[str, np.ndarray], fps: float, legs: str) -> Clip:
    """Decide on which feet the draft stands.

    Raises:
        BalanceError: it leaves the floor.
    """
    if legs == "stand":
        return _standing(planter, draft, fps)
    corners = planter.corners(draft)
    planted = planted_feet(stances, planter.feet, corners, planter.leg, fps)
    own = stand_places(planter)
    corners = parted(corners, own)
    kept = kept_down(planted, corners, planter.leg, fps)
    return Clip(draft, corners, kept, fps) if kept.all() else _stepping(planter, draft, corners, kept, own, fps)


def _standing(planter: Planter, draft: Floats, fps: float) -> Clip:
    """Both feet in the balanced stand all the time."""
    places = stand_places(planter)
    posed, count = over_stand(planter, draft, balanced_stand(planter, places), fps), len(draft)
    return Clip(posed, np.tile(places, (count, 1, 1, 1)), np.ones((count, len(planter.feet)), bool), fps)


def _stepping(planter: Planter, draft: Floats, corners: Floats, kept: np.ndarray, own: Floats, fps: float) -> Clip:
    """The draft's steps within the robot's reach, its body lower and going along."""
    placed = within_reach(kept, corners, own, planter.leg)
    root = slice(planter.robot.root_address, planter.robot.root_address + 2)
    posed = np.array(draft)
    posed[:, root] += gaussian_filter1d((placed - corners).mean(axis=(1, 2))[:, :2], SWAY * fps, axis=0, mode="nearest")
    stand = balanced_stand(planter, own)
    posed[:, root.stop] = np.minimum(posed[:, root.stop], stand[root.stop] - STOOP * planter.leg)
    stride = carried(kept, placed) / max(carried(kept, corners), 1e-9)
    return Clip(posed, placed, kept, fps, stride)


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


def balanced(
    robot: Robot, match: Match, stances: dict[str, np.ndarray], draft: Trajectory, legs: str, mode: str
) -> Balanced:
    """Bring a draft into balance.

    Args:
        stances: the human's (`contacts.stances`), frame by frame of the draft.

    Raises:
        BalanceError: the motion leaves the floor, or the robot has fewer than two feet.
    """
    if len(match.anatomy.soles) < 2:
        raise BalanceError(f"{robot.name} has no two feet to stand on: do without balance (balance 'off')")
    planter = Planter(robot, match)
    clip = clip_of(planter, draft.qpos, stances, draft.fps, legs)
    return paced(planter, clip, Steadiness(static=mode == "static"))


def paced(planter: Planter, clip: Clip, how: Steadiness, pacing: Pacing | None = None) -> Balanced:
    """The clip in balance, slowed down where a joint, the zero moment point or a shift of weight needs the time."""
    chosen = pacing or Pacing()
    stretch = unhurried(clip.planted, clip.fps, chosen)
    outline = outlined(planter, clip, stretch, how)
    for _ in range(chosen.shifts):
        late = outline.plan.excess > chosen.excess
        if not late.any() or stretch.mean() >= chosen.slowest - 1e-3:
            break
        stretch = stretched(stretch, outline.score, shift_needs(late, outline.score, chosen), chosen)
        outline = outlined(planter, clip, stretch, how)
    found = eased(planter, outline)
    clip = replace(clip, qpos=_on_clip(planter.robot, found, clip))
    for _ in range(chosen.rounds):
        loads = joint_torques(planter.robot, found.qpos, clip.fps, planter.soles, QUICK)
        inside = found.margin / outline.reach
        needs = motion_needs(planter.robot, found.qpos, loads, inside, found.friction, clip.fps, chosen)
        if needs.max() <= 1.0 or stretch.mean() >= chosen.slowest - 1e-3:
            break
        stretch = stretched(stretch, outline.score, needs, chosen)
        outline = outlined(planter, clip, stretch, how)
        found = played(planter, outline)
    return eased(planter, outline) if _leaps(planter.robot, found.qpos, clip.fps).any() else found


def played(planter: Planter, outline: Outline) -> Balanced:
    """The configurations that follow an outline."""
    robot, fps = planter.robot, outline.score.fps
    rough = _planted(planter, outline, outline.wished)
    return _judged(planter, outline, _planted(planter, outline, _smoothed(robot, rough, fps, np.ones(len(rough)))))


def eased(planter: Planter, outline: Outline) -> Balanced:
    """As `played`, smoothed and planted anew as long as joints leap from one way of standing to another."""
    qpos = _planted(planter, outline, outline.wished)
    for _ in range(EASINGS):
        wished = _eased(planter.robot, qpos, outline.score.fps)
        if wished is None:
            break
        qpos = _planted(planter, outline, wished)
    return played(planter, replace(outline, wished=qpos))


def _judged(planter: Planter, outline: Outline, qpos: Floats) -> Balanced:
    score, places = outline.score, outline.places
    pressed = tread(planter.robot, qpos, score.fps, QUICK)
    margin = np.array([p.margin(x) for p, x in zip(outline.supports, pressed.point, strict=True)])
    friction = pressed.friction([spots[down].reshape(-1, 3) for spots, down in zip(places, score.planted, strict=True)])
    slowed = outline.slowdown, outline.stride
    return Balanced(qpos, score, places, outline.plan, *slowed, pressed.point, margin, friction)


def _on_clip(robot: Robot, found: Balanced, clip: Clip) -> Floats:
    """(T, nq) what a playback does at the clip's own frames."""
    inside = np.flatnonzero(found.score.share >= 1)
    inside = inside[np.unique(found.score.at[inside], return_index=True)[1]]
    times = np.interp(np.arange(len(clip.qpos)), found.score.at[inside], inside / clip.fps)
    return sample(Trajectory(found.qpos, clip.fps, robot.joint_names, robot.name), robot, times)


def _planted(planter: Planter, outline: Outline, wished: Floats) -> Floats:
    """(K, nq) each frame from the correction of the one before."""
    robot, found, before, box = planter.robot, [], None, None
    correction, places, centres = np.zeros(robot.model.nv), outline.places, outline.plan.centre
    for k, wish in enumerate(wished):
        grip = np.where(outline.score.planted[k], HOLD, SWING)
        start = integrate(robot, wish, correction)
        before = planter.plant(start, wish, places[k], centres[k], grip, box=box, before=before)
        box = planter.solver.reachable([before], 1 / outline.score.fps)
        correction = difference(robot, wish, before)
        found.append(before)
    return np.array(found)


def _eased(robot: Robot, qpos: Floats, fps: float) -> Floats | None:
    """The motion smoothed where a joint leaps from one way of standing to another; None where none does."""
    leaps = _leaps(robot, qpos, fps)
    if not leaps.any():
        return None
    near = maximum_filter1d(np.append(leaps, False).astype(float), 2 * round(EASE * fps) + 1)
    return _smoothed(robot, qpos, fps, gaussian_filter1d(near, EASE * fps / 2), EASE_STIFFNESS)


def _smoothed(robot: Robot, qpos: Floats, fps: float, part: Floats, stiffness: float = STIFFNESS) -> Floats:
    """The motion (K, nq), each frame moved by its `part` (K,) of the way to the smooth one."""
    speed = np.array([difference(robot, a, b) for a, b in pairwise(qpos)])
    offsets = part[:, None] * smooth_offsets(speed, stiffness * (fps / 30) ** 4)
    return np.array([integrate(robot, q, d) for q, d in zip(qpos, offsets, strict=True)])


def _leaps(robot: Robot, qpos: Floats, fps: float) -> np.ndarray:
    """(K − 1,) whether a joint changes its speed from one frame to the next by more than a motor can."""
    speed = np.diff(qpos[:, robot.qpos_index], axis=0, append=qpos[-1:, robot.qpos_index]) * fps
    return np.any(np.abs(np.diff(speed, axis=0)) > JOLT * robot.max_speed, axis=1)
