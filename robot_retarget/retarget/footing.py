"""Footholds: where on the floor each foot of the robot stands, and for how long."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.retarget.contacts import intervals
from robot_retarget.robot import Anatomy, Points

CORNERS = 4
"""A sole is held by its corners: front left, front right, rear left, rear right."""
_TOE, _HEEL = [0, 1], [2, 3]


@dataclass(frozen=True)
class Footholds:
    """What is held, frame by frame. F feet."""

    held: np.ndarray
    """(T, F, 4) whether a corner is held."""
    places: Floats
    """(T, F, 4, 3) where, flat on the floor [m]; meaningless where nothing is held."""


def sole_corners(anatomy: Anatomy, foot: str) -> Points:
    """The corners of the flat part of a sole, in `CORNERS` order."""
    sole = anatomy.soles[foot]
    body, axes = anatomy.frames[f"{foot}_foot"]
    along = sole.offsets @ axes
    flat = along[along[:, 2] < along[:, 2].min() + 0.01]
    (back, right, low), (front, left, _) = flat.min(0), flat.max(0)
    corners = np.array([[front, left, low], [front, right, low], [back, left, low], [back, right, low]])
    return Points(np.full(CORNERS, body), corners @ axes.T)


def held_corners(stances: dict[str, np.ndarray], feet: tuple[str, ...], frames: int) -> np.ndarray:
    """(T, F, 4): the front corners while the toe stands, the rear ones while the heel does."""
    held = np.zeros((frames, len(feet), CORNERS), dtype=bool)
    for k, foot in enumerate(feet):
        if foot in stances:
            held[:, k, _TOE] = stances[foot][:, :1]
            held[:, k, _HEEL] = stances[foot][:, 1:]
    return held


def flattened(corners: Floats) -> Floats:
    """Corners (…, 4, 3) laid flat on the floor: same middle, same heading, same shape."""
    middle = corners.mean(axis=-2, keepdims=True)
    ahead = (corners[..., _TOE, :2].mean(-2) - corners[..., _HEEL, :2].mean(-2))[..., None, :]
    ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
    left = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
    length = np.linalg.norm(corners[..., 0, :] - corners[..., 2, :], axis=-1)[..., None, None] / 2
    width = np.linalg.norm(corners[..., 0, :] - corners[..., 1, :], axis=-1)[..., None, None] / 2
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    flat = middle[..., :2] + signs[:, :1] * length * ahead + signs[:, 1:] * width * left
    return np.concatenate([flat, np.zeros((*flat.shape[:-1], 1))], axis=-1)


class Stepping:
    """Footholds as they come: a foot that begins to stand stays where it just was. Causal."""

    def __init__(self, held: np.ndarray):
        self.held = held
        self.places = np.zeros((*held.shape[1:], 3))
        self.standing = np.zeros(held.shape[1], dtype=bool)

    def at(self, frame: int, corners: Floats) -> tuple[np.ndarray, Floats]:
        """What is held at a frame, given the corners (F, 4, 3) of the frame before."""
        stands = self.held[frame].any(axis=1)
        fresh = stands & ~self.standing
        self.places[fresh] = flattened(corners[fresh])
        self.standing = stands
        return self.held[frame], self.places


def footholds(held: np.ndarray, corners: Floats) -> Footholds:
    """Footholds of a whole clip: each stance at the middle of where a first pass put the foot.

    Args:
        held: (T, F, 4) what is held.
        corners: (T, F, 4, 3) of the first pass.
    """
    places = np.zeros_like(corners)
    for foot in range(held.shape[1]):
        for start, stop in intervals(np.asarray(held[:, foot].any(axis=1))):
            whole = held[start:stop, foot].all(axis=1)
            seen = corners[start:stop, foot][whole] if whole.any() else corners[start:stop, foot]
            places[start:stop, foot] = flattened(np.median(seen, axis=0))
    return Footholds(held, places)
