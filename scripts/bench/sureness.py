"""How sure the recognition of a human is, against how often it is right: `python scripts/bench/sureness.py FOLDER …`.

Every human clip below the folders, whole, in windows and in single frames, is recognised with the names it has, with every
other name taken away and with none. A keypoint is right where it is at the place that the whole clip with its names has for it.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from check_human import Clip, clips, cut, windows

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.recognition import Recognition, recognise
from robot_retarget.human.recognition.recognise import leg_length
from robot_retarget.human.skeleton import Skeleton

BINS = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.001)
SAME = 0.05
"""Joints this near are one place [leg lengths]."""


def namings(skeleton: Skeleton) -> Iterator[tuple[str, Skeleton]]:
    """The skeleton with less and less said by its names."""
    yield "all names", skeleton
    for kept, called in ((2, "every other name"), (len(skeleton) + 1, "no names")):
        names = tuple(name if k % kept == 1 else f"j{k}" for k, name in enumerate(skeleton.names))
        yield called, replace(skeleton, names=names)


def stated(clip: Clip) -> Iterator[tuple[str, float, bool]]:
    """The naming, how sure a keypoint is, and whether it is right."""
    spans = [(clip.first, len(clip.capture.positions)), *windows(clip)]
    for called, skeleton in namings(clip.capture.skeleton):
        for start, stop in spans:
            x = cut(clip.capture, start, stop).positions
            try:
                found = recognise(skeleton, x)
            except RobotRetargetError:
                continue
            for keypoint in KEYPOINTS:
                if keypoint in found.marks:
                    yield called, found.marks[keypoint].confidence, right(clip, x, found, keypoint)


def right(clip: Clip, x: Floats, found: Recognition, keypoint: str) -> bool:
    """Whether a keypoint is where the whole clip has it."""
    if keypoint not in clip.found.marks:
        return False
    here, there = (x[:, list(r.marks[keypoint].joints)].mean(axis=1) for r in (found, clip.found))
    return bool(np.median(np.linalg.norm(here - there, axis=1)) < SAME * leg_length(clip.found, x))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--wrong", action="store_true", help="Count the clips of what is wrong and stated as likely.")
    options = parser.parse_args()
    found: dict[str, list[tuple[float, bool]]] = defaultdict(list)
    for clip in clips(options.folders):
        every = list(stated(clip))
        for called, sure, is_right in every:
            found[called].append((sure, is_right))
        errors = sum(not is_right and sure >= 0.5 for _, sure, is_right in every)
        if options.wrong and errors:
            print(f"    {clip.name}: {errors} of {len(every)}")
    every = [row for rows in found.values() for row in rows]
    print("| stated | " + " | ".join(f"{called}: right of cases" for called in (*found, "all")) + " |")
    print("|---" * (len(found) + 2) + "|")
    for low, high in pairwise(BINS):
        print(
            f"| {low:g} – {min(high, 1):g} | " + " | ".join(cell(r, low, high) for r in (*found.values(), every)) + " |"
        )


def cell(rows: list[tuple[float, bool]], low: float, high: float) -> str:
    """How many of the keypoints that are stated so surely are right."""
    own = [is_right for sure, is_right in rows if low <= sure < high]
    return f"{np.mean(own):.0%} of {len(own)}" if own else "–"


if __name__ == "__main__":
    main()
