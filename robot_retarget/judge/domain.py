"""Randomised simulations: mass, friction, servo stiffness, delay, tilt and backlash differ from those of the model."""

import copy
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np

from robot_retarget.judge.plant import Plant
from robot_retarget.judge.stepping import Playback

WORLDS = 10
"""Drawn simulations of a motion that stands free, by default."""


@dataclass(frozen=True)
class Draw:
    """Parameters of one drawn simulation."""

    mass: float = 1.0
    """Times the mass and inertia of every body."""
    friction: float | None = None
    """Sliding friction of all contacts; None leaves the model's."""
    stiffness: float = 1.0
    """Times the stiffness of every servo."""
    delay: float | None = None
    """From the host to the windings [s]; None leaves the playback's."""
    roll: float = 0.0
    pitch: float = 0.0
    """The floor's tilt about x and y [rad]."""
    backlash: float = 1.0
    """Times the backlash of every joint, where the plant has it."""
    seed: int = 0
    """Of the inertial sensor's noise and bias."""


class Spread(NamedTuple):
    """Bounds of even distributions."""

    mass: tuple[float, float] = (0.9, 1.1)
    friction: tuple[float, float] = (0.6, 1.2)
    stiffness: tuple[float, float] = (0.85, 1.15)
    delay: tuple[float, float] = (0.0, 0.02)
    tilt: tuple[float, float] = (-np.pi / 180, np.pi / 180)
    backlash: tuple[float, float] = (0.5, 1.5)


def draws(count: int, seed: int = 0, spread: Spread | None = None) -> tuple[Draw, ...]:
    """`count` worlds; the same seed gives the same worlds, and a longer list begins with the shorter one."""
    spread = spread or Spread()
    bounds = np.array([spread.mass, spread.friction, spread.stiffness, spread.delay, spread.tilt, spread.tilt])
    shares = np.random.default_rng(seed).random((count, len(bounds)))
    rows = (bounds[:, 0] + shares * (bounds[:, 1] - bounds[:, 0])).tolist()
    # A separate generator: the other parameters do not depend on it.
    plays = np.random.default_rng([seed, 1]).uniform(*spread.backlash, count)
    return tuple(
        Draw(*row, backlash=float(play), seed=k) for k, (row, play) in enumerate(zip(rows, plays, strict=True))
    )


def drawn(plant: Plant, draw: Draw, playback: Playback) -> tuple[Plant, Playback]:
    """Return the plant and the playback with drawn parameters. The floor is fixed and gravity is tilted."""
    model = copy.copy(plant.model)
    model.body_mass *= draw.mass
    model.body_inertia *= draw.mass
    if draw.friction is not None:
        model.geom_friction[:, 0] = draw.friction
        model.pair_friction[:, :2] = draw.friction
    model.actuator_gainprm[:, 0] *= draw.stiffness
    model.actuator_biasprm[:, :2] *= draw.stiffness
    model.jnt_range[plant.places.play] *= draw.backlash
    model.opt.gravity[:] = _tilted(plant.model.opt.gravity, draw.roll, draw.pitch)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    delay = playback.delay if draw.delay is None else draw.delay
    return replace(plant, model=model), replace(playback, delay=delay, seed=draw.seed)


def _tilted(gravity: np.ndarray, roll: float, pitch: float) -> np.ndarray:
    """Gravity as seen from a floor tilted about x by `roll` and about y by `pitch`: Rᵀ g."""
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    return (about_y @ about_x).T @ gravity
