"""Sequences and splices of a robot's trajectories: the robot performs them, and follows its own performance.

The forward kinematics of the trajectories are composed into one motion, which is described as a graph and solved like any
other. Frames outside the seams do not change.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import JERK_PEAK, Floats, minimum_jerk
from robot_retarget.base.choices import Balance, Legs, Preset
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.base.keypoints import ARM, SIDES
from robot_retarget.base.progress import Progress
from robot_retarget.contact.record import joined_records
from robot_retarget.edit.seam import Seam, Stances, found_seam, table_of
from robot_retarget.formats import load_trajectory
from robot_retarget.graph.weights import Weights
from robot_retarget.human.motion import Motion, at_frames
from robot_retarget.human.robot_performer import performed
from robot_retarget.human.skeleton import backward, forward
from robot_retarget.robot import Robot, as_robot
from robot_retarget.robot.timing import resample
from robot_retarget.solver.balance.balance import balance_modes
from robot_retarget.solver.pipeline import Result, carried
from robot_retarget.trajectory import Trajectory

# Motions of one performer made into one: joined at seams, spliced of legs and arms, at another speed.

ARMS = tuple(f"{side}_{part}" for side in SIDES for part in ARM)
"""Keypoints that a splice takes from the second motion."""


def joined(motions: Sequence[Motion], seams: Sequence[Seam]) -> Motion:
    """Return motions one after the other, each placed where the one before has brought the performer.

    During a seam the pose of every joint in its parent passes over with minimum jerk,  (1 − s) a ⊕ s b,  and a foot
    keeps a place that both share. A foot with two places steps.

    Args:
        motions: N of one performer, at one rate.
        seams: N − 1, in the frames of the motions.
    """
    whole, shift = motions[0], 0
    for before, after, seam in zip(motions[:-1], motions[1:], seams, strict=True):
        leave = seam.leave + shift
        placed = _placed(after, whole, before, seam, shift)
        parts = [whole.frames(0, leave - seam.frames)] if leave > seam.frames else []
        parts.append(_faded(whole, placed, replace(seam, leave=leave)))
        if seam.enter + seam.frames + 1 < len(placed):
            parts.append(placed.frames(seam.enter + seam.frames + 1))
        whole, shift = _chained(parts), leave - seam.frames - seam.enter
    return replace(whole, source=" + ".join(dict.fromkeys(filter(None, (m.source for m in motions)))), start_time=0.0)


def _placed(after: Motion, whole: Motion, before: Motion, seam: Seam, shift: int) -> Motion:
    """Return a motion turned about the vertical and moved so that its anchor meets that of the motion before."""
    anchor = int(table_of(before, after, seam).anchors[0, 0])
    there, here, (k, e) = Stances(whole), Stances(after), seam.middle
    k += shift
    turn = there.headings[k, anchor] / here.headings[e, anchor]
    move = there.places[k, anchor] - turn * here.places[e, anchor]
    spin = Rotation.from_euler("z", float(np.angle(turn)))
    assert after.rotations is not None
    turned = spin * Rotation.from_quat(after.rotations.reshape(-1, 4), scalar_first=True)
    places = after.positions @ spin.as_matrix().T + [move.real, move.imag, 0.0]
    return replace(
        after, positions=places, rotations=turned.as_quat(scalar_first=True).reshape(after.rotations.shape), whole=None
    )


def _faded(before: Motion, after: Motion, seam: Seam) -> Motion:
    """Return the n + 1 frames of a seam: paired frames of both motions, in order."""
    count = seam.frames + 1
    here = before.frames(seam.leave - seam.frames, seam.leave + 1)
    there = after.frames(seam.enter, seam.enter + count)
    paired = np.arange(2 * count).reshape(2, count).T.reshape(-1)
    pairs = at_frames(_chained([here, there]), paired.astype(float), before.fps)
    share = minimum_jerk(np.linspace(0.0, 1.0, count))
    faded = at_frames(pairs, 2 * np.arange(count) + share, before.fps)
    if here.contacts is None or there.contacts is None:
        return faded
    keeps = ~_stepping(before, after, seam)
    down, stands = here.contacts.down & there.contacts.down, here.contacts.stands & there.contacts.stands
    return replace(faded, contacts=replace(here.contacts, down=down & keeps, stands=stands & keeps[:, None]))


def _stepping(before: Motion, after: Motion, seam: Seam) -> np.ndarray:
    """(2,) whether the left and the right foot step during a seam."""
    table = table_of(before, after, seam)
    steps = table.gaps[0, 0] > table.slip
    return np.array([steps and foot != table.anchors[0, 0] for foot in range(2)])


def _chained(motions: Sequence[Motion]) -> Motion:
    """Return the frames of motions of one performer, one after the other."""
    contacts = [m.contacts for m in motions if m.contacts is not None]
    rotations = [m.rotations for m in motions if m.rotations is not None]
    return replace(
        motions[0],
        positions=np.concatenate([m.positions for m in motions]),
        rotations=np.concatenate(rotations),
        contacts=joined_records(contacts) if contacts else None,
        whole=None,
    )


def spliced(legs: Motion, arms: Motion) -> Motion:
    """Return a motion with the arms of another, in the same pose relative to the chest; it has the duration of the legs.

    Arms that end before hold their last pose.

    Args:
        legs: the motion of legs, trunk and head.
        arms: another of the same performer and rate.
    """
    parents, names = legs.skeleton.parents, legs.skeleton.names
    columns = [k for k, name in enumerate(names) if name in ARMS]
    assert legs.rotations is not None
    own = backward(parents, legs.positions, legs.rotations)
    other = at_frames(arms, np.arange(len(legs), dtype=float), legs.fps)
    assert other.rotations is not None
    for mine, theirs in zip(own, backward(parents, other.positions, other.rotations), strict=True):
        mine[:, columns] = theirs[:, columns]
    positions, rotations = forward(parents, *own)
    source = f"{legs.source} + arms of {arms.source}"
    return replace(legs, positions=positions, rotations=rotations, source=source, whole=None)


def retimed(motion: Motion, speed: float) -> Motion:
    """Return the motion at a factor of its speed, at the same rate, on cubic splines: accelerations scale with its square.

    Args:
        motion: with rotations.
        speed: factor [-].
    """
    frames: Floats = np.arange(0.0, len(motion) - 1 + 1e-9, speed)
    straight, parents = at_frames(motion, frames, motion.fps), motion.skeleton.parents
    if len(motion) < 2:
        return straight
    assert motion.rotations is not None
    translations, turns = backward(parents, motion.positions, motion.rotations)
    flips = np.where((turns[1:] * turns[:-1]).sum(axis=2) < 0, -1.0, 1.0)  # q and −q are one turn
    turns[1:] *= np.cumprod(flips, axis=0)[..., None]
    places, spun = (CubicSpline(np.arange(len(motion)), values)(frames) for values in (translations, turns))
    positions, rotations = forward(parents, places, spun / np.linalg.norm(spun, axis=2, keepdims=True))
    return replace(straight, positions=positions, rotations=rotations)


SEAM_TIME = 0.4
"""Least duration of a seam by default [s]: that of a swing in a walk, 0.35 to 0.5 s."""
SHARE = 0.5
"""Share of a joint's speed that a seam of the default duration uses [-]: the other half is left to the clips, which move in
addition."""


def sequence(
    clips: Sequence[Trajectory | str | Path],
    robot: Robot | str | Path,
    *,
    at: Sequence[tuple[float, float] | None] = (),
    best: bool = False,
    fade: float | None = None,
    speed: float = 1.0,
    fps: float | None = None,
    weights: Weights | None = None,
    preset: Preset = "balanced",
    legs: Legs = "auto",
    balance: Balance = "auto",
    progress: Progress | None = None,
) -> Result:
    """Return trajectories one after the other, with seams that are solved as any motion.

    Each clip continues at the place and heading of the foot on which the one before ends. During a seam the targets of both
    clips fade into each other; balance steps where a foot must go elsewhere.

    Args:
        clips: trajectories of the robot, or files that `load_trajectory` reads.
        robot: a robot, or a name or model file that `load_robot` loads.
        at: per seam the time at which the clip before is left and that at which the clip after is entered [s]; None, and seams
            beyond the last entry, take the end and the beginning.
        best: move every seam to the best frames within `seam.SOUGHT`.
        fade: duration of a seam [s]; by default as long as the joints need, `SEAM_TIME` at least.
        speed: factor of the speed [-].
        fps, weights, preset, legs, balance, progress: as in `retarget`.

    Raises:
        UsageError: no clip, a seam outside its clips, or a duration or speed that is not positive.
        TrajectoryError: a clip belongs to another robot, or two do not fit together at their seam; the message has the reasons
            and the best frames near it.
    """
    model = as_robot(robot)
    if not clips:
        raise UsageError("a sequence needs a clip")
    for what, value in (("duration of a seam", fade), ("speed", speed)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise UsageError(f"the {what} must be positive, got {value:g}")
    if len(at) >= len(clips):
        raise UsageError(f"{len(at)} seams were given, {len(clips)} clips have {len(clips) - 1}")
    planned = bool(balance_modes(model, legs, balance))
    parts = _parts(clips, model)
    wanted = [*at, *[None] * (len(parts) - 1 - len(at))]
    seams = [
        _seam(model, before, after, times, fade, planned, best)
        for before, after, times in zip(parts[:-1], parts[1:], wanted, strict=True)
    ]
    motion = joined([part.motion for part in parts], seams)
    if planned:
        motion = motion.frames(parts[0].lead_in, len(motion) - parts[-1].lead_out)
    timed = retimed(motion, speed) if speed != 1 else motion
    return carried(timed, model, balance, legs, fps, weights, preset, progress)


def splice(
    legs: Trajectory | str | Path,
    arms: Trajectory | str | Path,
    robot: Robot | str | Path,
    *,
    fps: float | None = None,
    weights: Weights | None = None,
    preset: Preset = "balanced",
    balance: Balance = "auto",
    progress: Progress | None = None,
) -> Result:
    """Return a trajectory with the legs, trunk and head of one and the arms of another, solved as any motion.

    Arms keep their pose relative to the chest. The result lasts as long as the legs; arms that end before hold their last pose.

    Args:
        legs: a trajectory of the robot, or a file that `load_trajectory` reads.
        arms: another.
        robot: a robot, or a name or model file that `load_robot` loads.
        fps, weights, preset, balance, progress: as in `retarget`.

    Raises:
        TrajectoryError: a trajectory belongs to another robot.
    """
    model = as_robot(robot)
    lower, upper = _parts([legs, arms], model)
    motion = spliced(lower.motion, upper.motion)
    if balance_modes(model, "auto", balance):
        motion = motion.frames(lower.lead_in, len(motion) - lower.lead_out)
    return carried(motion, model, balance, "auto", fps, weights, preset, progress)


@dataclass(frozen=True)
class Part:
    """A trajectory of a sequence, and the robot's performance of it."""

    trajectory: Trajectory
    motion: Motion

    @property
    def lead_in(self) -> int:
        """Frames from the stand of a balanced playback to the clip: balance adds new ones."""
        return _still(self.trajectory.source_time) if self.trajectory.balance else 0

    @property
    def lead_out(self) -> int:
        """Frames from the clip to the stand."""
        return _still(self.trajectory.source_time[::-1]) if self.trajectory.balance else 0


def _still(times: Floats) -> int:
    """Return the number of frames before the time of the source first changes; 0 if it never does."""
    moving = np.flatnonzero(times != times[0])
    return int(moving[0]) - 1 if moving.size else 0


def _parts(clips: Sequence[Trajectory | str | Path], robot: Robot) -> list[Part]:
    """Return trajectories and performances at the rate of the first."""
    read = [clip if isinstance(clip, Trajectory) else load_trajectory(clip, robot) for clip in clips]
    even = [clip if clip.fps == read[0].fps else resample(clip, robot, read[0].fps) for clip in read]
    return [Part(clip, performed(clip, robot)) for clip in even]


def _seam(
    robot: Robot,
    before: Part,
    after: Part,
    times: tuple[float, float] | None,
    fade: float | None,
    balanced: bool,
    best: bool,
) -> Seam:
    """Return the seam of two parts at times [s]; by default where the clips end and begin, else in their stands."""
    fps, last = before.motion.fps, len(before.motion) - 1
    frames = [(last - before.lead_out, after.lead_in), (last, 0)] if times is None else [_at(times, fps)]

    def found(leave: int, enter: int) -> Seam:
        length = fade or max(SEAM_TIME, _time_of_joints(robot, before, after, leave, enter))
        return found_seam(before.motion, after.motion, leave, enter, max(1, round(length * fps)), balanced, best)

    for pair in frames[:-1]:
        with suppress(TrajectoryError, UsageError):
            return found(*pair)
    return found(*frames[-1])


def _at(times: tuple[float, float], fps: float) -> tuple[int, int]:
    return round(times[0] * fps), round(times[1] * fps)


def _time_of_joints(robot: Robot, before: Part, after: Part, leave: int, enter: int) -> float:
    """Return the time that the joints need from one pose to the other at `SHARE` of their speed [s]."""
    poses = [
        part.trajectory.qpos[np.clip(k, 0, len(part.motion) - 1), robot.qpos_index]
        for part, k in ((before, leave), (after, enter))
    ]
    return JERK_PEAK * float((np.abs(poses[0] - poses[1]) / (SHARE * robot.max_speed)).max(initial=0.0))
