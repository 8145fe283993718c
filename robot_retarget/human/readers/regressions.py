"""Joint centres from markers on the skin, by published regressions.

Hips by [Harrington2007] from the spines of the pelvis; knees and ankles midway between their two markers, or by the chord
of [Davis1991] from the outer one and a marker on the segment above; shoulders by [Rab2002], 17 % of the distance of the
acromia under them.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats, unit

SETS = (
    "Plug-in-Gait (LASI, LKNE, …), van Sint Jan's (L_IAS, L_FLE, …), CMU's (LFWT, LKNE, …), OpenSim's (R.ASIS, R.Knee.Lat, …) or OptiTrack's Baseline "
    "(WaistLFront, LKneeOut, …)"
)
LABELS: dict[str, list[str]] = tomllib.loads(Path(__file__).with_name("markers.toml").read_text(encoding="utf-8"))
"""What markers are called in these sets by their role, the side's letter in braces."""
REQUIRED = (
    "front of the pelvis", "back of the pelvis", "outer knee", "outer ankle", "acromion", "outer elbow",
    "thumb's side of the wrist", "little finger's side of the wrist",
)  # fmt: skip
_HALF_KNEE, _HALF_ANKLE = 0.057, 0.042
"""Half an adult's knee of 0.10 m and ankle of 0.07 m with a marker of 14 mm on it, where no inner marker is [m]."""


@dataclass(frozen=True)
class Markers:
    """The paths of labelled markers."""

    paths: Mapping[str, Floats]
    """(T, 3) by label in capitals, without the subject's name [m]."""
    notes: list[str] = field(default_factory=list)

    def label(self, role: str, side: str) -> str | None:
        """The label of the marker of a role in this file."""
        return next((label for name in LABELS[role] if (label := name.format(side)) in self.paths), None)

    def get(self, role: str, side: str = "L") -> Floats | None:
        """The path of a role's marker, or None."""
        label = self.label(role, side)
        return None if label is None else self.paths[label]

    def at(self, role: str, side: str) -> Floats:
        """The path of a required role's marker."""
        path = self.get(role, side)
        assert path is not None, role
        return path

    def missing(self) -> list[str]:
        """The required markers that are not there, with the labels they could have."""
        return [
            f"{'left' if side == 'L' else 'right'} {role} ({' or '.join(name.format(side) for name in LABELS[role])})"
            for role in REQUIRED
            for side in "LR"
            if self.label(role, side) is None
        ]

    def used(self) -> list[str]:
        """The labels from which joint centres are computed."""
        labels = [self.label(role, side) for role in LABELS for side in "LR"]
        return sorted({label for label in labels if label is not None})


def joint_centres(markers: Markers) -> dict[str, tuple[str, Floats]]:
    """Joints by name, each with its parent's name and its path (T, 3) [m]; parents stand first."""
    hips = dict(zip("LR", hip_centres(markers), strict=True))
    body: dict[str, tuple[str, Floats]] = {"pelvis": ("", (hips["L"] + hips["R"]) / 2)}
    body |= _trunk(markers, body["pelvis"][1])
    for side, word in (("L", "left"), ("R", "right")):
        body |= _leg(markers, side, word, hips[side]) | _arm(markers, side, word, body)
    return body


def hip_centres(markers: Markers) -> tuple[Floats, Floats]:
    """Left and right hip of [Harrington2007]: with the pelvis' width w and depth d in mm, −0.24 d − 9.9 ahead of the middle
    of its front spines, −0.30 w − 10.9 above it and ±(0.33 w + 7.3) to either side.
    """
    left, right = markers.at("front of the pelvis", "L"), markers.at("front of the pelvis", "R")
    back = (markers.at("back of the pelvis", "L") + markers.at("back of the pelvis", "R")) / 2
    middle = (left + right) / 2
    aside, raw = unit(left - right), middle - back
    ahead = unit(raw - (raw * aside).sum(1, keepdims=True) * aside)
    up = np.cross(ahead, aside)
    width = float(np.median(np.linalg.norm(left - right, axis=1)))
    depth = float(np.median(np.linalg.norm(raw, axis=1)))
    down = middle + (-0.24 * depth - 0.0099) * ahead + (-0.30 * width - 0.0109) * up
    beside = (0.33 * width + 0.0073) * aside
    return down + beside, down - beside


def _trunk(markers: Markers, pelvis: Floats) -> dict[str, tuple[str, Floats]]:
    body: dict[str, tuple[str, Floats]] = {}
    chest = _mean(markers.get("breastbone's end"), markers.get("back"))
    neck = _mean(markers.get("breastbone's top"), markers.get("neck's lowest vertebra"))
    acromia = (markers.at("acromion", "L") + markers.at("acromion", "R")) / 2
    if chest is not None:
        body["chest"] = "pelvis", chest
    body["neck"] = next(reversed(body), "pelvis"), acromia if neck is None else neck
    head = [markers.get(role, side) for role in ("front of the head", "back of the head") for side in "LR"]
    if (middle := _mean(*head)) is not None:
        body["head"] = "neck", middle
    return body


def _leg(markers: Markers, side: str, word: str, hip: Floats) -> dict[str, tuple[str, Floats]]:
    knee = _hinge(markers, side, "knee", hip, "thigh", _HALF_KNEE)
    ankle = _hinge(markers, side, "ankle", knee, "shin", _HALF_ANKLE)
    leg = {
        f"{word}_hip": ("pelvis", hip),
        f"{word}_knee": (f"{word}_hip", knee),
        f"{word}_ankle": (f"{word}_knee", ankle),
    }
    toes = markers.get("toes", side)
    toe = toes if toes is not None else _mean(markers.get("first toe", side), markers.get("fifth toe", side))
    return leg if toe is None else leg | {f"{word}_toe": (f"{word}_ankle", toe)}


def _arm(
    markers: Markers, side: str, word: str, body: Mapping[str, tuple[str, Floats]]
) -> dict[str, tuple[str, Floats]]:
    left, right = markers.at("acromion", "L"), markers.at("acromion", "R")
    down = unit(body["pelvis"][1] - (left + right) / 2)
    apart = float(np.median(np.linalg.norm(left - right, axis=1)))
    outer, inner = markers.at("outer elbow", side), markers.get("inner elbow", side)
    if inner is None:
        markers.notes.append(f"No inner marker of the {word} elbow: its centre is at the outer one.")
    wrist = _mean(*(markers.at(f"{which} side of the wrist", side) for which in ("thumb's", "little finger's")))
    assert wrist is not None
    return {
        f"{word}_shoulder": (
            "chest" if "chest" in body else "neck",
            markers.at("acromion", side) + 0.17 * apart * down,
        ),
        f"{word}_elbow": (f"{word}_shoulder", outer if inner is None else (outer + inner) / 2),
        f"{word}_wrist": (f"{word}_elbow", wrist),
    }


def _hinge(markers: Markers, side: str, joint: str, above: Floats, plane: str, half: float) -> Floats:
    """A knee or an ankle: midway between its markers, or by the chord, or its outer marker."""
    outer, inner = markers.at(f"outer {joint}", side), markers.get(f"inner {joint}", side)
    if inner is not None:
        return (outer + inner) / 2
    beside = markers.get(plane, side)
    word = "left" if side == "L" else "right"
    if beside is None:
        markers.notes.append(f"No inner marker of the {word} {joint}: its centre is at the outer one.")
        return outer
    markers.notes.append(f"The {word} {joint} is {1000 * half:.0f} mm from its outer marker, an adult's half width.")
    return chord(above, outer, beside, half)


def chord(above: Floats, outer: Floats, beside: Floats, half: float) -> Floats:
    """The centre of [Davis1991]: `half` from the outer marker, in its plane with the centre above and a marker next to the
    segment, away from that, and with a right angle between the two lines that meet in it.
    """
    line = above - outer
    along = unit(line)
    off = beside - outer
    away = -unit(off - (off * along).sum(1, keepdims=True) * along)
    cosine = np.minimum(half / np.linalg.norm(line, axis=1, keepdims=True), 1.0)
    return outer + half * (cosine * along + np.sqrt(1 - cosine**2) * away)


def _mean(*paths: Floats | None) -> Floats | None:
    there = [path for path in paths if path is not None]
    return np.mean(there, axis=0) if there else None
