"""Find and repair the defects of a capture."""

from dataclasses import dataclass, field, replace

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.contact.rule import JOINTS, ContactRule, lowest_over_time, speed_of
from robot_retarget.human.capture import Capture
from robot_retarget.human.defects import (
    REFUSED,
    Defect,
    JumpRule,
    NoiseRule,
    beyond,
    bridged,
    gaps,
    is_smoother,
    limb_jumps,
    limbs_of,
    noise_of,
    sentences,
    smoothed,
)
from robot_retarget.human.recognition.recognise import Recognition, leg_length

TRUNK = ("pelvis", "chest", "neck", "l_hip", "r_hip", "l_shoulder", "r_shoulder")
TORN = "look at it, or cut the clip there (--frames)"
LEFT = "not repaired (--no-repair)"


@dataclass(frozen=True)
class RepairRule:
    """Thresholds of the defects, and whether they are repaired."""

    mend: bool = True
    """Whether defects are repaired."""
    longest: float = 0.3
    """Gaps up to this are bridged [s]. Half and double change none of 13 clips."""
    pose: float = 0.5
    """Where so large a share of the keypoints jumps at once, another pose begins."""
    still: float = 0.03
    """A body that keeps its points so near stands still [leg lengths]. Half and double change one note in clips of 13
    exporters."""
    steps: JumpRule = field(default_factory=JumpRule)
    noise: NoiseRule = field(default_factory=NoiseRule)


def repaired(
    capture: Capture, recognition: Recognition, metres: float, rule: RepairRule
) -> tuple[Capture, tuple[str, ...]]:
    """Repair a capture by a rule, with a note for every kind of defect, worst first.

    Args:
        metres: in the file's unit.
    """
    if capture.fps < rule.steps.lowest_rate:
        return capture, _sparse(capture)
    if len(capture.positions) < 2:
        return capture, ()
    leg = leg_length(recognition, capture.positions)
    capture, body = _rooted(capture, recognition, leg, rule)
    capture, limbs = _limbs(capture, recognition, leg, rule)
    capture, noise = _quiet(capture, recognition, metres, rule)
    return capture, (*sentences([*body, *limbs, *_torn(capture, leg)], capture.fps), *noise)


def _torn(capture: Capture, leg: float) -> list[Defect]:
    """Bones that are in some frames longer than all of the body together, those of a root apart."""
    parents = capture.skeleton.parents
    inner = np.flatnonzero((parents >= 0) & (parents[parents] >= 0))
    lengths = np.linalg.norm(capture.positions[:, inner] - capture.positions[:, parents[inner]], axis=2) / leg
    torn = lengths > np.median(lengths, axis=0).sum()
    found = []
    for bone in np.flatnonzero(torn.any(axis=0)):
        frames, name = np.flatnonzero(torn[:, bone]), capture.skeleton.names[inner[bone]]
        size = float(lengths[:, bone].max())
        found.append(replace(_found(f"The bone of {name} tears", int(frames[0]), size, TORN), last=int(frames[-1])))
    return found


def _sparse(capture: Capture) -> tuple[str, ...]:
    if len(capture.positions) < 2:
        return ()
    return (
        f"The file has {capture.fps:.3g} frames a second: keyframes, between which the body is led straight on; if "
        "they follow faster, give the frame rate.",
    )


def _rooted(capture: Capture, recognition: Recognition, leg: float, rule: RepairRule) -> tuple[Capture, list[Defect]]:
    """Put the body back after every jump that the whole trunk makes; where its pose changes too, another take begins."""
    points = recognition.place(capture.positions) / leg
    trunk = points[:, _trunk_columns(recognition)]
    middle = trunk.mean(axis=1)
    jumps = beyond(middle, rule.steps.body_threshold(capture.fps), rule.steps)
    changed = limb_jumps(points, middle, capture.fps, rule.steps).any(axis=2).mean(axis=1) > rule.pose
    findings = [
        _found("Another pose begins", t + 1, float(np.linalg.norm(jumps[t]) + 1.0), "cut the clip there (--frames)")
        for t in np.flatnonzero(changed).tolist()
    ]
    jumps[changed] = 0.0
    for t in np.flatnonzero(jumps.any(axis=1)).tolist():
        rigid = is_smoother(trunk[t : t + 2], np.stack([trunk[t], trunk[t + 1] - jumps[t]]))
        done = ("bridged" if rule.mend else LEFT) if rigid else REFUSED
        findings.append(_found("The body jumps", t + 1, float(np.linalg.norm(jumps[t])), done))
        jumps[t] *= rigid
    if not (rule.mend and jumps.any()):
        return capture, findings
    positions = capture.positions.copy()
    positions[1:] -= np.cumsum(jumps, axis=0)[:, None] * leg
    return replace(capture, positions=positions), findings


def _limbs(capture: Capture, recognition: Recognition, leg: float, rule: RepairRule) -> tuple[Capture, list[Defect]]:
    """With limbs led across the gaps in which they were lost."""
    points, at = recognition.place(capture.positions) / leg, recognition.keypoints.index
    middle = points[:, _trunk_columns(recognition)].mean(axis=1)
    jumps = limb_jumps(points, middle, capture.fps, rule.steps)
    jumps[jumps.any(axis=2).mean(axis=1) > rule.pose] = 0.0
    longest, findings = round(rule.longest * capture.fps), []
    for limb, keypoints in limbs_of(recognition).items():
        root, *columns = map(at, keypoints)
        inside = points[:, columns] - points[:, [root]]
        worst = columns[int(np.linalg.norm(jumps[:, columns], axis=2).max(axis=0).argmax())]
        for first, last, size, closed in gaps(jumps[:, worst], inside, longest):
            safe = closed and last - first < longest and first > 0 and last + 1 < len(points)
            done = LEFT if safe else TORN
            if safe and rule.mend:
                hub = recognition.marks[recognition.keypoints[root]].joints[0]
                capture, done = _across(capture, recognition, hub, columns, first, last)
            findings.append(replace(_found(f"{limb} jumps", first, size, done), last=last))
    return capture, findings


def _across(
    capture: Capture, recognition: Recognition, hub: int, columns: list[int], first: int, last: int
) -> tuple[Capture, str]:
    """Interpolate a limb across a gap if this is smoother than the capture; return the outcome in words.

    Args:
        hub: the joint from which the limb hangs.
        columns: the limb's keypoints.
    """
    led, around = bridged(capture, hub, first, last), slice(first - 1, last + 2)
    before, after = (recognition.place(one.positions[around])[:, columns] for one in (capture, led))
    return (led, "bridged") if is_smoother(before, after) else (capture, REFUSED)


def _quiet(
    capture: Capture, recognition: Recognition, metres: float, rule: RepairRule
) -> tuple[Capture, tuple[str, ...]]:
    """Apply a low pass to a noisy capture."""
    points: Floats = recognition.place(capture.positions) * metres
    noise = noise_of(points, capture.fps, rule.noise)
    if noise <= rule.noise.most:
        return capture, ()
    done = f"smoothed by a low pass of {rule.noise.cutoff:g} Hz" if rule.mend else LEFT
    note = f"The joints waver by {1000 * noise:.0f} mm where the body is quiet, which is noise: {done}."
    return (smoothed(capture, rule.noise) if rule.mend else capture), (note,)


def _trunk_columns(recognition: Recognition) -> list[int]:
    """The columns of the keypoints from hips to shoulders, which no limb moves."""
    return [k for k, keypoint in enumerate(recognition.keypoints) if keypoint in TRUNK]


def _found(what: str, frame: int, size: float, done: str) -> Defect:
    return Defect(what, frame, frame, size, f"{size:.2f} leg lengths", done)


# Feet that skate and bodies that float throughout a clip: no foothold can be read off them.

FEET = ("l_ankle", "r_ankle", "l_toe", "r_toe")


@dataclass(frozen=True)
class FootingRule:
    """Thresholds; lengths in leg lengths, speeds in leg lengths per second."""

    stance: ContactRule = JOINTS
    """A low part of a foot skates while it is faster than what starts a stance."""
    high: float = 0.15
    """A body whose lowest point is higher than this above the floor floats [leg lengths]. Half adds notes to 2 clips of 13
    exporters, double none."""
    most: float = 0.75
    """Share of the frames from which on a clip skates or floats throughout [-]. Half adds notes to 2 clips of 13 exporters."""
    shortest: float = 1.0
    """Shorter clips are not judged [s]."""


def footing(recognition: Recognition, positions: Floats, fps: float, rule: FootingRule) -> tuple[str, ...]:
    """Return sentences about feet that skate, and about a body that floats, throughout.

    Args:
        positions: (T, J, 3) of the joints, z up [m].
    """
    if len(positions) < rule.shortest * fps:
        return ()
    leg = leg_length(recognition, positions)
    x = recognition.place(positions) / leg
    return (*_skating(recognition, x, fps, leg, rule), *(_floating(x, leg, rule) or _climbing(x, fps, leg, rule)))


def _skating(recognition: Recognition, x: Floats, fps: float, leg: float, rule: FootingRule) -> tuple[str, ...]:
    at, stance = recognition.keypoints.index, rule.stance
    feet = x[:, [at(k) for k in FEET if k in recognition.marks]]
    low = feet[:, :, 2] - stance.floor_height(feet[:, :, 2], axis=0) < stance.enter_height
    slowest = np.where(low, speed_of(feet[:, :, :2], fps, stance), np.inf).min(axis=1)
    seen = np.isfinite(slowest)
    skates = slowest[seen] > stance.enter_speed
    if seen.mean() < 0.5 or skates.mean() < rule.most:
        return ()
    speed, when = float(np.median(slowest[seen])) * leg, np.flatnonzero(seen)[skates][[0, -1]] / fps
    return (
        f"The feet skate in {skates.mean():.0%} of the time ({when[0]:.2f}–{when[1]:.2f} s), at {speed:.1f} m/s where they are "
        "lowest and no foothold is found: a motion in place, or one whose path does not fit its legs.",
    )


def _climbing(x: Floats, fps: float, leg: float, rule: FootingRule) -> tuple[str, ...]:
    """Return a sentence about ground that does not stay at one height: steps, a climb, or drift of the capture."""
    ground = lowest_over_time(x[:, :, 2], fps)
    change = float(np.ptp(ground))
    if change < rule.high:
        return ()
    when = sorted((int(ground.argmin()), int(ground.argmax())))
    return (
        f"The lowest points of the body change their height by {leg * change:.2f} m from {when[0] / fps:.1f} to {when[1] / fps:.1f} s "
        "(steps, a climb, or drift of the capture): without a scene or --terrain auto the robot's floor is level and follows them.",
    )


def _floating(x: Floats, leg: float, rule: FootingRule) -> tuple[str, ...]:
    lowest = x[:, :, 2].min(axis=1)
    high = lowest - rule.stance.floor_height(lowest) > rule.high
    if high.mean() < rule.most:
        return ()
    return (
        f"The body floats in {high.mean():.0%} of the time, up to {leg * np.ptp(lowest):.2f} m over its lowest point: "
        "the floor follows its lowest points over time (where it goes down steps, --terrain auto builds them).",
    )
