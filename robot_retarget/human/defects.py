"""Stretches in which a limb was lost, and the way across them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation, Slerp
from scipy.special import gammaincinv

from robot_retarget.base.arrays import Floats, intervals, unit
from robot_retarget.base.errors import LISTED
from robot_retarget.base.keypoints import ARM, LEG, SIDES
from robot_retarget.human.capture import Capture
from robot_retarget.human.recognition.recognise import Recognition
from robot_retarget.human.skeleton import backward, forward

STILL_LIMB = 1e-4
"""A limb that moves less than this from frame to frame does not move at all [leg lengths]: 0.08 mm of an adult's, below any
capture."""


def limbs_of(recognition: Recognition) -> dict[str, list[str]]:
    """The keypoints of every limb and of the head, the first of them the one that it hangs from."""
    kinds = {"arm": ARM, "leg": LEG}
    limbs = {f"{side}_{kind}": [f"{side}_{part}" for part in parts] for kind, parts in kinds.items() for side in SIDES}
    limbs["head"] = ["neck", "head"]
    there = {limb: [k for k in keypoints if k in recognition.marks] for limb, keypoints in limbs.items()}
    return {limb: keypoints for limb, keypoints in there.items() if keypoints[:1] == limbs[limb][:1] and keypoints[1:]}


def gaps(jumps: Floats, points: Floats, longest: int) -> Iterator[tuple[int, int, float, bool]]:
    """First and last frame of a limb's gaps, the largest jump [leg lengths], and whether both ends were found.

    Two jumps at most `longest` frames apart enclose a gap if the second goes back. A single jump ends a gap in which the limb
    stood still.

    Args:
        jumps: (T − 1, 3) how the limb's end jumps between frames.
        points: (T, P, 3) of the limb, seen from where it hangs [leg lengths].
    """
    size = np.linalg.norm(jumps, axis=1)
    steps = np.flatnonzero(size).tolist()
    while steps:
        first = steps.pop(0)
        # A jump undoes another to half of the larger one.
        undone = np.linalg.norm(jumps + jumps[first], axis=1) < 0.5 * np.maximum(size, size[first])
        back = [s for s in steps if s - first <= longest and undone[s]]
        if back:
            steps = [step for step in steps if step > back[-1]]
            yield first + 1, back[-1], float(size[first : back[-1] + 1].max()), True
            continue
        moves = np.linalg.norm(np.diff(points[: first + 1], axis=0), axis=2).max(axis=1, initial=0.0) > STILL_LIMB
        start = int(np.flatnonzero(moves)[-1]) + 2 if moves.any() else 0
        lost = start > 0 and first - start >= 2
        yield (start, first, float(size[first]), True) if lost else (first + 1, first + 1, float(size[first]), False)


def bridged(capture: Capture, joint: int, first: int, last: int) -> Capture:
    """Interpolate the joints from `joint` on between the frame before `first` and the one after `last`.

    Each turns in its parent along the shortest way; without rotations its place as seen from its parent is led.

    Args:
        joint: the first joint that is interpolated.
        first: first frame of the gap.
        last: last frame of the gap.
    """
    skeleton = capture.skeleton
    joints = [k for k in range(len(skeleton)) if joint in skeleton.above(k)]
    ends, inside = [first - 1, last + 1], np.arange(first, last + 1)
    share = ((inside - ends[0]) / (ends[1] - ends[0]))[:, None]
    local = (
        capture.rotations
        if capture.rotations is not None
        else np.tile([1.0, 0, 0, 0], (*capture.positions.shape[:2], 1))
    )
    translations, turns = backward(skeleton.parents, capture.positions, local)
    for k in joints:
        a, b = translations[ends, k]
        translations[inside, k] = a + share * (b - a)
        way = Slerp(ends, Rotation.from_quat(turns[ends, k], scalar_first=True))
        turns[inside, k] = way(inside).as_quat(scalar_first=True)
    positions, rotations = forward(skeleton.parents, translations, turns)
    return replace(capture, positions=positions, rotations=None if capture.rotations is None else rotations)


# Steps between frames that no body makes: of the whole body, of its pose, of one limb.


@dataclass(frozen=True)
class JumpRule:
    """Largest excess of a step over those around it; lengths in leg lengths."""

    around: int = 4
    """Steps to either side with which one is compared. Half and double find the same defects in clips of 13 exporters."""
    body: float = 0.1
    """Of the body as a whole, at any frame rate ..."""
    body_acceleration: float = 60.0
    """... and this on top over the squared frame rate [1/s²]: 5 g."""
    limb: float = 0.2
    """Of a keypoint relative to the body, at any frame rate ..."""
    limb_acceleration: float = 200.0
    """... and [1/s²]: 17 g, more than the fist of a boxer."""
    lowest_rate: float = 10.0
    """Least frame rate at which jumps are searched [1/s]: at 10 a second the body may move by 0.7 of a leg from frame to
    frame."""

    def body_threshold(self, fps: float) -> float:
        """Return the largest step of the body as a whole [leg lengths]."""
        return self.body + self.body_acceleration / fps**2


def excess(steps: Floats, rule: JumpRule) -> Floats:
    """(T − 1, …, 3) of steps (T − 1, …, 3), what each has beyond the median of those around it."""
    size = (2 * rule.around + 1, *(1 for _ in steps.shape[1:]))
    return steps - median_filter(steps, size, mode="mirror")


def limb_jumps(points: Floats, middle: Floats, fps: float, rule: JumpRule) -> Floats:
    """(T − 1, K, 3) how points (T, K, 3) jump, seen from the middle of the trunk; 0 where they move by themselves.

    Args:
        points: (T, K, 3) keypoints [leg lengths].
        middle: (T, 3) middle of the trunk [leg lengths].
        fps: frames per second [1/s].
    """
    return beyond(points - middle[:, None], rule.limb + rule.limb_acceleration / fps**2, rule)


def beyond(places: Floats, most: float, rule: JumpRule) -> Floats:
    """(T − 1, …, 3) jumps of places (T, …, 3); 0 for steps with an excess of at most `most` [leg lengths]."""
    found = excess(np.diff(places, axis=0), rule)
    return np.where(np.linalg.norm(found, axis=-1, keepdims=True) > most, found, 0.0)


# White noise of a measurement, and a low pass that takes it away.
#
# Differences of fifth order suppress the motion of a body and leave the noise: of white noise with deviation σ they have
# the deviation σ √252. It is measured where the body is quietest, for there noise remains and motion does not; that the
# quietest stretches of white noise have less of it than most is allowed for (χ² of the differences that are independent).

ORDER = 5
"""Order of the differences: of white noise with deviation σ they have the deviation σ √252."""
_GAIN = float(np.sqrt(comb(2 * ORDER, ORDER)))
_ALIKE = sum(comb(2 * ORDER, ORDER + k) ** 2 for k in range(-ORDER, ORDER + 1)) / comb(2 * ORDER, ORDER) ** 2
"""Number of neighbouring differences of white noise that equals one independent difference."""


@dataclass(frozen=True)
class NoiseRule:
    """Thresholds of the noise measure, and the low pass."""

    most: float = 0.0025
    """Largest deviation of a coordinate that is treated as motion [m]; clean captures have up to 0.002."""
    window: float = 0.25
    """Stretches in which it is measured [s]."""
    quiet: float = 0.1
    """The quietest share of them counts [-]. Half and double find the same noise in clips of 13 exporters."""
    lowest_rate: float = 20.0
    """At lower frame rates motion is as quick as noise [1/s]: of seven clean clips a median σ of 0.6 mm is found at 20
    frames a second, 1.6 at 15 and 5.0 at 10."""
    cutoff: float = 6.0
    """Of the low pass [Hz], as is usual for measured human motion [Winter2009]."""


def noise_of(points: Floats, fps: float, rule: NoiseRule) -> float:
    """Deviation σ of the noise in points (T, K, 3), of the median point; 0 where it cannot be measured.

    Args:
        points: (T, K, 3) [m].
        fps: frames per second [1/s].
    """
    window = round(rule.window * fps)
    if len(points) < window + ORDER or fps < rule.lowest_rate:
        return 0.0
    power = (np.diff(points, ORDER, axis=0) ** 2).mean(axis=2)
    stretches = power[: len(power) // window * window].reshape(-1, window, points.shape[1]).mean(axis=1)
    freedom, count = 3 * window / _ALIKE, len(stretches)
    quietest = 2 / freedom * gammaincinv(freedom / 2, (rule.quiet * (count - 1) + 1) / (count + 1))
    return float(np.median(np.sqrt(np.quantile(stretches, rule.quiet, axis=0) / quietest)) / _GAIN)


def smoothed(capture: Capture, rule: NoiseRule) -> Capture:
    """The capture through a Butterworth low pass, both ways; with rotations every joint in its parent, bones kept.

    Args:
        rule: the low pass.
    """
    from scipy.signal import butter, sosfiltfilt  # takes longer to load than most clips to read

    sos = butter(2, rule.cutoff, fs=capture.fps, output="sos")

    def low(values: Floats) -> Floats:
        return np.asarray(sosfiltfilt(sos, values, axis=0), dtype=np.float64)

    if capture.rotations is None:
        return replace(capture, positions=low(capture.positions))
    parents = capture.skeleton.parents
    translations, turns = backward(parents, capture.positions, capture.rotations)
    flips = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=2) < 0, -1.0, 1.0), axis=0)
    turns = np.concatenate([turns[:1], turns[1:] * flips[..., None]])
    positions, rotations = forward(parents, low(translations), unit(low(turns)))
    return replace(capture, positions=positions, rotations=rotations)


# Frames that are no poses: their values are shifted by columns, or random.


@dataclass(frozen=True)
class ScrambleRule:
    """Measured: in captured clips of 13 exporters at most one step in a row has this number of turns, in a scrambled one 22."""

    turn: float = np.pi / 4
    """From frame to frame a joint turns by more [rad]: half finds two steps in a row in one of those clips ..."""
    joints: int = 3
    """... in this number of joints at once ..."""
    steps: int = 4
    """... in this number of consecutive steps."""


def clean_part(capture: Capture, rule: ScrambleRule) -> tuple[slice, str]:
    """Return the longest part without scrambled frames, and a sentence about these frames; it is empty for a clean motion.

    Args:
        capture: with any number of frames.
        rule: how many turns make a frame no pose.
    """
    whole = slice(0, len(capture.positions))
    if capture.rotations is None or whole.stop <= rule.steps or capture.fps < JumpRule().lowest_rate:
        return whole, ""
    _, turns = backward(capture.skeleton.parents, capture.positions, capture.rotations)
    angles = 2 * np.arccos(np.abs((turns[1:] * turns[:-1]).sum(axis=2)).clip(0, 1))
    wild = (angles > rule.turn).sum(axis=1) >= rule.joints
    runs = [(start + 1, stop) for start, stop in intervals(wild) if stop - start >= rule.steps]
    if not runs:
        return whole, ""
    bounds = [0, *(end for first, last in runs for end in (first, last + 1)), whole.stop]
    kept = max(
        (slice(a, b) for a, b in zip(bounds[::2], bounds[1::2], strict=True)), key=lambda part: part.stop - part.start
    )
    places = ", ".join(span(first, last, capture.fps) for first, last in runs[:LISTED])
    return kept, (
        f"{places[:1].upper()}{places[1:]}: no poses, {rule.joints} joints and more turn by over {np.degrees(rule.turn):.0f}° in every "
        f"step, as where values are shifted by columns; --frames 0:{kept.stop - kept.start} takes the {kept.stop - kept.start} "
        f"frames {'before' if kept.start == 0 else 'after'} them"
    )


# Whether a repair leaves a motion at least as smooth as it was: no point moves farther between two frames.

REFUSED = "not repaired, since bridging would make the motion less smooth"
EQUAL_STEPS = 1e-9
"""Share by which equal steps may differ."""


def is_smoother(before: Floats, after: Floats) -> bool:
    """Compare the longest step of every point.

    Args:
        before: (T, P, 3) points over the frames that a repair changes, with one frame on either side.
        after: (T, P, 3) the same points repaired.
    """
    longest = [np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=0, initial=0.0) for points in (before, after)]
    return bool((longest[1] <= longest[0] * (1 + EQUAL_STEPS)).all())


# Sentences about findings: kind, time and outcome, the worst first.


@dataclass(frozen=True)
class Defect:
    """Something wrong with a stretch of a capture."""

    what: str
    """Its kind, the same words for the same kind: findings of a kind share a sentence."""
    first: int
    last: int
    """Frames of the file, both included."""
    size: float
    """How bad it is, in the unit of its kind."""
    measure: str
    """The size in words."""
    done: str
    """The repair, or the action that the user should take."""


def sentences(findings: Iterable[Defect], fps: float) -> tuple[str, ...]:
    """A sentence for every kind of finding and outcome, the kind with the worst one first.

    Args:
        findings: of any kinds.
        fps: frames per second [1/s].
    """
    kinds: dict[tuple[str, str], list[Defect]] = {}
    for finding in sorted(findings, key=lambda f: -f.size):
        kinds.setdefault((finding.what, finding.done), []).append(finding)
    said = []
    for (what, done), found in kinds.items():
        places = (f"{span(f.first, f.last, fps)}{f', {f.measure}' if f.measure else ''}" for f in found[:LISTED])
        more = f" and {len(found) - LISTED} more" if len(found) > LISTED else ""
        said.append(f"{what} at {', '.join(places)}{more}: {done}.")
    return tuple(said)


def span(first: int, last: int, fps: float) -> str:
    """`frame 12 (0.40 s)` or `frames 12–15 (0.40–0.50 s)`.

    Args:
        last: last frame.
        fps: frames per second [1/s].
    """
    if first == last:
        return f"frame {first} ({first / fps:.2f} s)"
    return f"frames {first}–{last} ({first / fps:.2f}–{last / fps:.2f} s)"
