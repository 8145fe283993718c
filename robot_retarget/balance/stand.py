"""The balanced stand that every free-standing playback begins and ends in, and motions over feet that never move."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats, unit
from robot_retarget.balance.planting import Planter
from robot_retarget.balance.zmp import support
from robot_retarget.solve.footing import HOLD, flattened

CROUCH = 0.04
"""The pelvis stands this share of a leg lower than in the robot's standing pose: straight knees cannot shift weight."""
FIRM = 60
"""Steps of the search for a stand, from a pose that may be far from it."""


@dataclass(frozen=True)
class Poise:
    """How far the trunk may go over feet that stay where they are."""

    ahead: float = 0.9
    back: float = 0.15
    aside: float = 0.25
    """Leaning from the vertical [rad]."""
    turn: float = 0.35
    """About the vertical, against the human's own slow turning [rad]."""
    settle: float = 1.0
    """What is slower than this belongs to the human's walking about [s]."""
    lowest: float = 0.6
    """Height of the pelvis, as a share of its height in the stand."""


def stand_places(planter: Planter) -> Floats:
    """(F, 4, 3) of the soles in the robot's own standing pose, flat on the floor [m]."""
    return flattened(planter.corners(planter.robot.standing()[None])[0])


def balanced_stand(planter: Planter, places: Floats) -> Floats:
    """(nq,) the standing pose with its soles on places (F, 4, 3) and its mass over the middle between them."""
    own, address = stand_places(planter), planter.robot.root_address
    turn = _heading(places) - _heading(own)
    posed = np.array(planter.robot.standing())
    spin = Rotation.from_euler("z", turn)
    root = posed[address : address + 3] - own.mean(axis=(0, 1))  # corners lie on the floor: heights stay
    posed[address : address + 3] = spin.apply(root) + places.mean(axis=(0, 1))
    posed[address + 2] -= planter.corners(posed[None])[0][..., 2].mean() + CROUCH * planter.leg
    turned = spin * Rotation.from_quat(posed[address + 3 : address + 7], scalar_first=True)
    posed[address + 3 : address + 7] = turned.as_quat(scalar_first=True)
    grip, middle = np.full(len(places), HOLD), support(places.reshape(-1, 3)).middle
    return planter.plant(posed, posed, places, middle, grip, FIRM)


def over_stand(planter: Planter, draft: Floats, stand: Floats, fps: float, poise: Poise | None = None) -> Floats:
    """(T, nq) the draft's arms, head and trunk over legs that stand: what `legs = "stand"` is drawn to.

    The human's slow turning is left out, the trunk's tilt and the pelvis' height stay within what feet that never move
    allow; the root stands where it does in the stand.
    """
    chosen, address = poise or Poise(), planter.robot.root_address
    posed = np.array(draft)
    legs = planter.leg_coordinates
    posed[:, legs] = stand[legs]
    posed[:, address : address + 2] = stand[address : address + 2]
    height = stand[address + 2]
    posed[:, address + 2] = np.clip(draft[:, address + 2], chosen.lowest * height, height)
    upright = Rotation.from_quat(stand[address + 3 : address + 7], scalar_first=True)
    own = Rotation.from_quat(draft[:, address + 3 : address + 7], scalar_first=True) * upright.inv()
    kept = _kept_upright(own, planter.forward, fps, chosen) * upright
    posed[:, address + 3 : address + 7] = kept.as_quat(scalar_first=True)
    return posed


def _kept_upright(turns: Rotation, forward: Floats, fps: float, poise: Poise) -> Rotation:
    """Heading and tilt of (T,) rotations, each no further than it may be."""
    up = turns.as_matrix()[:, :, 2]
    away = unit(up[:, :2])
    leaning = away * np.arccos(np.clip(up[:, 2], -1.0, 1.0))[:, None]
    level = (_leaning(leaning).inv() * turns).as_matrix()
    heading = np.unwrap(np.arctan2(level[:, 1, 0], level[:, 0, 0]))
    slow = gaussian_filter1d(heading, poise.settle * fps, mode="nearest")
    ahead = np.stack([np.cos(slow), np.sin(slow)], axis=1) @ _plane(forward)
    left = ahead @ [[0.0, 1.0], [-1.0, 0.0]]
    along = np.clip((leaning * ahead).sum(1), -poise.back, poise.ahead)
    across = np.clip((leaning * left).sum(1), -poise.aside, poise.aside)
    kept = along[:, None] * forward[:2] + across[:, None] * (forward[:2] @ [[0.0, 1.0], [-1.0, 0.0]])
    quick = np.clip(heading - slow, -poise.turn, poise.turn)
    return _leaning(kept) * Rotation.from_euler("z", quick[:, None])


def _leaning(away: Floats) -> Rotation:
    """The rotations that tip the vertical over towards (T, 2) directions, by their lengths [rad]."""
    return Rotation.from_rotvec(np.stack([-away[:, 1], away[:, 0], np.zeros(len(away))], axis=1))


def _plane(forward: Floats) -> Floats:
    """(2, 2) that takes (cos, sin) of a turn to where it takes `forward`."""
    return np.array([[forward[0], forward[1]], [-forward[1], forward[0]]])


def _heading(places: Floats) -> float:
    """Of the feet together [rad]."""
    ahead = (places[:, :2] - places[:, 2:]).mean(axis=(0, 1))
    return float(np.arctan2(ahead[1], ahead[0]))
