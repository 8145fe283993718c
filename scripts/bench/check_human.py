"""Laws of the human side's recognition × cases: `python scripts/bench/check_human.py FOLDER …` prints a Markdown table.

Every motion file below the folders that is a human's is cut, laid down, turned, mirrored, renamed, rewritten and broken; what must stay
the same has to stay so, or it has to be said. A violation is silent where no note, low confidence or error tells of it.
"""

import argparse
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.keypoints import KEYPOINTS, mirrored
from robot_retarget.human.capture import Capture, Request
from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.table import format_of
from robot_retarget.human.recognition import Recognition, recognise
from robot_retarget.human.recognition.recognise import leg_length
from robot_retarget.human.upright import turn_to_z, upright

KEPT, SAID, SILENT = "kept", "said", "silent"
LENGTHS = (0.0, 0.5, 1.0, 2.0)
"""Of the windows [s]; 0 is a single frame."""
PLACES = 4
"""Windows of each length."""
UNSURE = 0.5
"""A keypoint with less confidence is said to be doubtful."""
NEAR = 0.15
"""A keypoint that is so near to where it was is at another joint of the same hand or foot [leg lengths]."""
SAME = 0.05
"""Heights that agree so far are the same [leg lengths]."""


@dataclass(frozen=True)
class Clip:
    """A motion file with the recognition of its whole clip."""

    name: str
    capture: Capture
    motion: Motion
    found: Recognition

    @property
    def first(self) -> int:
        """Frames that were dropped at the start."""
        return len(self.capture.positions) - len(self.motion)


Law = Callable[[Clip], Iterator[str]]


def windows(clip: Clip) -> Iterator[tuple[int, int]]:
    """Stretches of the clip, by first and last frame, the dropped ones left out."""
    count = len(clip.capture.positions)
    for length in LENGTHS:
        frames = max(1, round(length * clip.capture.fps))
        if clip.first + frames <= count:
            for start in np.unique(np.linspace(clip.first, count - frames, PLACES).astype(int)).tolist():
                yield start, start + frames


def cut(capture: Capture, start: int, stop: int) -> Capture:
    rotations = None if capture.rotations is None else capture.rotations[start:stop]
    return replace(capture, positions=capture.positions[start:stop], rotations=rotations, contacts=None)


def heights(motion: Motion, found: Recognition) -> Floats:
    """(T, K) of the keypoints over their mean, in leg lengths."""
    z = found.place(motion.positions)[:, :, 2] / leg_length(found, motion.positions)
    return z - z.mean()


def same_height(clip: Clip, changed: Capture, start: int, stop: int) -> str:
    """Whether a changed stretch of a clip, nothing of it mended, stands as it does in the whole."""
    try:
        motion = upright(changed, repair=False)
    except RobotRetargetError:
        return SAID
    if len(motion) != stop - start:
        return SILENT if not motion.notes else SAID
    whole = heights(clip.motion.frames(start - clip.first, stop - clip.first), clip.found)
    if np.abs(heights(motion, clip.found) - whole).max() < SAME:
        return KEPT
    return SAID if any("--up" in note for note in motion.notes) else SILENT


def window_has_the_up_axis_of_the_whole(clip: Clip) -> Iterator[str]:
    plain = replace(clip, motion=upright(clip.capture, repair=False))
    for start, stop in windows(plain):
        yield same_height(plain, cut(clip.capture, start, stop), start, stop)


def who_is_laid_on_the_floor_lies(clip: Clip) -> Iterator[str]:
    """Windows in which the whole body is turned onto back, belly or side, down to the floor at 0."""
    undo = np.linalg.inv(_turn_of(clip))
    for way in range(4):
        laid = Rotation.from_euler("zy", [90 * way + 20, 90], degrees=True).as_matrix()
        pelvis = clip.found.place(clip.motion.positions)[:, :1]
        x = (clip.motion.positions - pelvis) @ laid.T + pelvis * [1, 1, 0]
        x = x - (x[:, :, 2].min(axis=1) - 0.06)[:, None, None] * [0, 0, 1]
        lying = replace(clip, motion=replace(clip.motion, positions=x, rotations=None, contacts=None))
        capture = replace(
            clip.capture, positions=x / _metres(clip) @ undo.T, rotations=_some_turns(clip), contacts=None
        )
        for length in LENGTHS[1:]:
            frames = min(max(1, round(length * clip.capture.fps)), len(x))
            start = way * (len(x) - frames) // 4
            stop = start + frames
            shown = replace(lying, motion=replace(lying.motion, positions=x[start:stop]))
            shifted = replace(shown, capture=cut(capture, start, stop))
            yield same_height(shifted, shifted.capture, 0, frames)


def window_has_the_map_of_the_whole(clip: Clip) -> Iterator[str]:
    for start, stop in windows(clip):
        yield same_map(clip, cut(clip.capture, start, stop), clip.found)


def renaming_changes_nothing(clip: Clip) -> Iterator[str]:
    count = len(clip.capture.skeleton)
    order = np.random.default_rng(0).permutation(count)
    for names in ([f"j{k}" for k in range(count)], [f"bone {order[k]}" for k in range(count)]):
        skeleton = replace(clip.capture.skeleton, names=tuple(names))
        yield same_map(clip, replace(clip.capture, skeleton=skeleton), clip.found)


def mirroring_swaps_sides(clip: Clip) -> Iterator[str]:
    wanted = replace(clip.found, marks={mirrored(k): mark for k, mark in clip.found.marks.items()})
    for axis in np.eye(3):
        changed = replace(clip.capture, positions=clip.capture.positions * (1 - 2 * axis), rotations=None)
        yield same_map(clip, changed, wanted)


def unit_and_axis_change_nothing(clip: Clip) -> Iterator[str]:
    for unit, axis in ((1.0, "+y"), (100.0, "+z"), (1 / 0.0254, "-y")):
        undo = np.linalg.inv(turn_to_z(axis))
        x = clip.motion.positions @ undo.T * unit
        skeleton = replace(clip.capture.skeleton, offsets=clip.motion.skeleton.offsets @ undo.T * unit)
        changed = replace(
            clip.capture, skeleton=skeleton, positions=x, rotations=_some_turns(clip), contacts=None, up=None
        )
        yield same_height(replace(clip, capture=changed), changed, 0, len(x))


def same_map(clip: Clip, changed: Capture, wanted: Recognition) -> str:
    """Whether the keypoints are at the joints they should be at."""
    try:
        found = recognise(changed.skeleton, changed.positions)
    except RobotRetargetError:
        return SAID
    marks = [(found.marks.get(k), wanted.marks.get(k)) for k in KEYPOINTS]
    wrong = [(a, b) for a, b in marks if (a and set(a.joints)) != (b and set(b.joints))]
    if not wrong:
        return KEPT
    doubtful = all(a is None or a.confidence < UNSURE for a, _ in wrong)
    return SAID if doubtful or found.notes else SILENT


def what_is_clean_is_left_as_it_is(clip: Clip) -> Iterator[str]:
    plain = upright(clip.capture, repair=False)
    same = len(plain) == len(clip.motion) and np.abs(plain.positions - clip.motion.positions).max() < 1e-9
    told = any("smoothed" in note or "bridged" in note or "dropped" in note for note in clip.motion.notes)
    yield KEPT if same else SAID if told else SILENT


def a_jump_of_the_root_is_bridged_or_said(clip: Clip) -> Iterator[str]:
    leg = leg_length(clip.found, clip.capture.positions)
    for frames in (1, max(2, round(0.2 * clip.capture.fps)), len(clip.capture.positions)):
        for start in _middle(clip):
            x = clip.capture.positions.copy()
            x[start : start + frames] += leg * np.array([1.0, 0.2, 0.6])
            yield mended(clip, replace(clip.capture, positions=x), start)


def a_limb_that_flies_is_bridged_or_said(clip: Clip) -> Iterator[str]:
    rng = np.random.default_rng(1)
    for limb in ("l_hand", "r_knee"):
        joint = clip.found.marks[limb].joints[0]
        below = [k for k in range(len(clip.capture.skeleton)) if joint in clip.capture.skeleton.above(k)]
        leg = leg_length(clip.found, clip.capture.positions)
        for start in _middle(clip):
            x = clip.capture.positions.copy()
            x[start : start + max(1, round(0.1 * clip.capture.fps)), below] += leg * 0.7 * _direction(rng)
            broken = replace(clip.capture, positions=x, rotations=None)
            yield KEPT if _stays(clip, broken) else mended(clip, broken, start)


def _stays(clip: Clip, broken: Capture) -> bool:
    """Whether the keypoints of a broken capture are found at joints that did not fly, or are led back near to them."""
    motion = upright(broken)
    now = recognise(motion.skeleton, motion.positions)
    if now.keypoints != clip.found.keypoints or len(motion) != len(clip.motion):
        return False
    away = now.place(motion.positions) - clip.found.place(clip.motion.positions)
    return bool(np.linalg.norm(away, axis=2).max() < NEAR * leg_length(clip.found, clip.motion.positions))


def _direction(rng: np.random.Generator) -> Floats:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def noise_is_taken_away_or_said(clip: Clip) -> Iterator[str]:
    rng = np.random.default_rng(2)
    if clip.capture.fps < 20 or len(clip.motion) < 30:
        return
    for size in (0.01, 0.02):
        noise = rng.normal(0, size / _metres(clip), clip.capture.positions.shape)
        yield mended(clip, replace(clip.capture, positions=clip.capture.positions + noise, rotations=None), None)


def a_calibration_pose_is_dropped_or_said(clip: Clip) -> Iterator[str]:
    if len(clip.motion) < 30:
        return
    for seconds in (0.0, 0.5, 1.5):
        count = max(1, round(seconds * clip.capture.fps))
        away = clip.capture.positions[clip.first :]
        pose = away[:1] + leg_length(clip.found, away) * np.array([2.0, 0.0, 1.5])
        x = np.concatenate([np.repeat(pose, count, axis=0), away])
        yield mended(clip, replace(clip.capture, positions=x, rotations=None, contacts=None), None, dropped=count)


def mended(clip: Clip, broken: Capture, start: int | None, dropped: int = 0) -> str:
    """Whether a broken capture comes out without a jump, or with a sentence about it."""
    try:
        motion = upright(broken)
    except RobotRetargetError:
        return SAID
    told = any(not note.startswith(("The unit", "No known unit")) for note in {*motion.notes} - {*clip.motion.notes})
    if dropped and len(motion) == len(broken.positions) - dropped:
        return KEPT
    return (KEPT if told and not _rough(clip, motion) else SAID) if told else SILENT


def _rough(clip: Clip, motion: Motion) -> bool:
    """Whether the keypoints accelerate much more than those of the clip as it was."""
    now, was = (np.diff(clip.found.place(m.positions), 2, axis=0) for m in (motion, clip.motion))
    return bool(np.abs(now).max() > 2 * np.abs(was).max() + 0.05)


def _middle(clip: Clip) -> list[int]:
    count = len(clip.motion)
    return [clip.first + round(count * share) for share in (0.3, 0.6)] if count >= 30 else []


def _metres(clip: Clip) -> float:
    return leg_length(clip.found, clip.motion.positions) / leg_length(clip.found, clip.capture.positions[clip.first :])


def _some_turns(clip: Clip) -> Floats | None:
    """Rotations where the clip has any: which ones is not looked at."""
    return None if clip.capture.rotations is None else clip.capture.rotations[clip.first :]


def _turn_of(clip: Clip) -> Floats:
    """The rotation from the file's axes to the motion's."""
    frame = clip.capture.positions[clip.first] * _metres(clip), clip.motion.positions[0]
    a, b = (x - x.mean(axis=0) for x in frame)
    return Rotation.align_vectors(b, a)[0].as_matrix()


LAWS: tuple[Law, ...] = (
    window_has_the_up_axis_of_the_whole,
    who_is_laid_on_the_floor_lies,
    window_has_the_map_of_the_whole,
    renaming_changes_nothing,
    mirroring_swaps_sides,
    unit_and_axis_change_nothing,
    what_is_clean_is_left_as_it_is,
    a_jump_of_the_root_is_bridged_or_said,
    a_limb_that_flies_is_bridged_or_said,
    noise_is_taken_away_or_said,
    a_calibration_pose_is_dropped_or_said,
)


def clips(folders: list[Path]) -> Iterator[Clip]:
    for path in sorted(p for folder in folders for p in folder.rglob("*") if p.is_file()):
        try:
            yield clip_of(path)
        except RobotRetargetError:
            continue


def clip_of(path: Path) -> Clip:
    """A file of a human motion.

    Raises:
        RobotRetargetError: it is none.
    """
    capture = format_of(path).read(path, Request())
    motion = upright(capture)
    return Clip(path.stem, capture, motion, recognise(motion.skeleton, motion.positions))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--only", help="Laws whose name holds this word.", default="")
    parser.add_argument("--cases", action="store_true", help="Name the clips of silent violations.")
    options = parser.parse_args()
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    culprits: dict[str, Counter[str]] = defaultdict(Counter)
    for clip in clips(options.folders):
        for law in LAWS:
            if options.only in law.__name__:
                outcomes = Counter(law(clip))
                counts[law.__name__] += outcomes
                culprits[law.__name__][clip.name] += outcomes[SILENT]
    print("| law | cases | kept | said | silent |\n|---|---|---|---|---|")
    for name, found in counts.items():
        print(f"| {name.replace('_', ' ')} | {found.total()} | {found[KEPT]} | {found[SAID]} | {found[SILENT]} |")
        if options.cases:
            print(*(f"    {clip}: {count}" for clip, count in culprits[name].items() if count), sep="\n")


if __name__ == "__main__":
    main()
