"""Simulations that differ from the model: drawn worlds, and servos other than those for which the goals were computed."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np

from robot_retarget.actuators.goals import Goals
from robot_retarget.actuators.motors import PUBLISHED, SUPPLY_RESISTANCE
from robot_retarget.base.arrays import Floats
from robot_retarget.judge.figures import at_frames, fall_figures
from robot_retarget.judge.plant import CRISP, Mode, Plant, Supply, soles_and_floor
from robot_retarget.judge.playback import Playback, Rollout, roll_out
from robot_retarget.judge.servo_model import Drives
from robot_retarget.robot.model import Robot
from robot_retarget.trajectory import Trajectory

# Randomised simulations: mass, friction, servo stiffness, delay, tilt and backlash differ from those of the model.

WORLDS = 10
"""Drawn simulations of a motion that stands free at most, by default: the fewest of which one is the 0.1 of `fallen_share`."""
BACKLASH = np.radians(0.25)
"""Of servos in drawn simulations, either way [rad], times a factor: .1–.4°; the data sheets of the XM430 and XL430 state 0.25°."""


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
    voltage: float | None = None
    """Of the supply without load, over the servos' nominal one [-]; None leaves the nominal one, constant."""
    floor: float | None = None
    """Time constant of the soles' contact with the floor [s]; None leaves the plant's."""
    seed: int = 0
    """Of the inertial sensor's noise and bias."""


class Spread(NamedTuple):
    """Bounds of even distributions."""

    mass: tuple[float, float] = (0.9, 1.1)
    friction: tuple[float, float] = (0.6, 1.2)
    stiffness: tuple[float, float] = (0.85, 1.15)
    delay: tuple[float, float] = (0.0, 0.02)
    tilt: tuple[float, float] = (-np.pi / 180, np.pi / 180)
    backlash: tuple[float, float] = (0.4, 1.6)
    voltage: tuple[float, float] = (11.0 / 12, 12.4 / 12)
    """Three lithium cells, nearly empty to full, over the 12 V of an XM430."""
    floor: tuple[float, float] = (CRISP, 0.012)
    """From a hard floor to a carpet; MuJoCo's default of 0.02 s is a cushion."""


def draws(count: int, seed: int = 0, spread: Spread | None = None) -> tuple[Draw, ...]:
    """`count` worlds; the same seed gives the same worlds, and a longer list begins with the shorter one."""
    spread = spread or Spread()
    bounds = np.array([spread.mass, spread.friction, spread.stiffness, spread.delay, spread.tilt, spread.tilt])
    shares = np.random.default_rng(seed).random((count, len(bounds)))
    rows = (bounds[:, 0] + shares * (bounds[:, 1] - bounds[:, 0])).tolist()
    # Separate generators: the other parameters do not depend on them.
    plays = np.random.default_rng([seed, 1]).uniform(*spread.backlash, count)
    low, high = np.array([spread.voltage, spread.floor]).T
    more = np.random.default_rng([seed, 2]).uniform(low, high, (count, 2)).tolist()
    return tuple(
        Draw(*row, backlash=float(play), voltage=volts, floor=floor, seed=k)
        for k, (row, play, (volts, floor)) in enumerate(zip(rows, plays, more, strict=True))
    )


def is_decided(fallen: Sequence[bool], worlds: int, share: float) -> bool:
    """Return whether the finished simulations settle if more than a share of `worlds` end in a fall.

    They do once more than the share have fallen, and once half of the worlds are simulated without a fall. By the second rule a motion that falls in 0.3 of
    all worlds passes ten draws in 23 instead of 15 % of the cases, and one that falls in 0.5 in 3.6 instead of 1.1 % (double sampling).

    Args:
        fallen: falls of the finished simulations.
        worlds: number of simulations at most.
        share: `Thresholds.fallen_share`.
    """
    return sum(fallen) > share * worlds or (2 * len(fallen) >= worlds and not any(fallen))


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
    if draw.floor is not None:
        model.geom_solref[soles_and_floor(model, plant.robot)] = draw.floor, 1.0
    mujoco.mj_setConst(model, mujoco.MjData(model))
    delay = playback.delay if draw.delay is None else draw.delay
    supply = None
    if plant.drives is not None and draw.voltage is not None:
        supply = Supply(draw.voltage * plant.drives.voltage, SUPPLY_RESISTANCE)
    return replace(plant, model=model, supply=supply), replace(playback, delay=delay, seed=draw.seed)


def _tilted(gravity: np.ndarray, roll: float, pitch: float) -> np.ndarray:
    """Gravity as seen from a floor tilted about x by `roll` and about y by `pitch`: Rᵀ g."""
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    return (about_y @ about_x).T @ gravity


# Judges: servos that differ from those for which the goals were computed.
#
# Goals that make up for lag and load fit the servos of the model exactly. Real ones have other gears: published identifications of one servo
# differ by 4 in friction and by 38 in armature. A trajectory is judged on the servos with the worst outcome.

NOMINAL = "as modelled"
DRAWN = "drawn"
DRAWN_SPREAD = 2.0
"""Drawn dampings, frictions and armatures differ from the nominal ones by this factor at most, either way [-]: the published frictions
of the XM430 differ by 4.5, which is 2.1 either way."""
SEED = 0
"""Of the drawn servos."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One simulation of a trajectory."""

    judge: str
    """The name of its servos."""
    plant: Plant
    rollout: Rollout
    worst_rms: float
    """Tracking error of the worst joint [rad]; infinite if the simulation broke down at once."""
    rms: float
    """Tracking error of all joints [rad]."""
    stopped: float
    """When the robot fell or the simulation broke down [s]; infinite if neither happened."""

    @property
    def fell(self) -> bool:
        """Whether the robot fell or the simulation broke down."""
        return bool(np.isfinite(self.stopped))


def judges(plant: Plant) -> dict[str, Plant]:
    """Return plants by the name of their servos, the nominal one first."""
    if plant.drives is None:
        return {NOMINAL: plant, DRAWN: _drawn_actuators(plant)}
    others = {name: plant.with_drives(drives) for name, drives in other_drives(plant.drives).items()}
    return {NOMINAL: plant, **others}


def other_drives(drives: Drives) -> dict[str, Drives]:
    """Return drives with every other published identification of their servos, and with drawn ones."""
    others = {robot for model in drives.models for robot in list(PUBLISHED.get(model, {}))[1:]}
    found = {f"gears as {robot} measured them": _identified_on(robot, drives) for robot in sorted(others)}
    return {**found, DRAWN: drives.scaled(_factors((3, len(drives.stiffness))))}


def run_trials(
    plants: dict[str, Plant], trajectory: Trajectory, mode: Mode, playback: Playback | None, goals: Goals
) -> list[Trial]:
    """Simulate a trajectory on every plant."""
    rollouts = {name: roll_out(plant, trajectory, mode, playback, goals) for name, plant in plants.items()}
    return [_trial(name, plants[name], trajectory, rollout, mode) for name, rollout in rollouts.items()]


def worst_trial(trials: list[Trial]) -> Trial:
    """Return the trial that stops first or, if none stops, the one with the largest tracking error of a joint."""
    return min(trials, key=lambda trial: (trial.stopped, -trial.worst_rms))


def trial_figures(trials: list[Trial], chosen: Trial) -> dict[str, object]:
    """Return the name of the judge, and the tracking errors on all servos."""
    rounded = {trial.judge: round(trial.rms, 5) if np.isfinite(trial.rms) else None for trial in trials}
    return {"servos": chosen.judge, "nominal_tracking_rms_rad": rounded[NOMINAL], "tracking_rms_rad_by_servos": rounded}


def _trial(name: str, plant: Plant, trajectory: Trajectory, rollout: Rollout, mode: Mode) -> Trial:
    robot = plant.robot
    error = at_frames(trajectory, robot, rollout).error[:, plant.driven]
    worst = float(np.sqrt((error**2).mean(0)).max()) if error.size else np.inf
    stops = stop_of(rollout, robot, trajectory) if mode == "free" else rollout.unstable
    rms = float(np.sqrt((error**2).mean())) if error.size else np.inf
    return Trial(name, plant, rollout, worst, rms, np.inf if stops is None else stops)


def stop_of(rollout: Rollout, robot: Robot, trajectory: Trajectory) -> float | None:
    """Return when a free robot fell or, if that is earlier, the simulation broke down [s]; None if neither happened."""
    times = (rollout.unstable, fall_figures(rollout, robot, trajectory)["fall_s"])
    return min((time for time in times if time is not None), default=None)


def _identified_on(robot: str, drives: Drives) -> Drives:
    """The drives with the identification made on a robot, for those servos that have one."""
    sets = [PUBLISHED.get(model, {}) for model in drives.models]
    known = np.array([robot in found for found in sets])
    chosen = [found.get(robot) or next(iter(PUBLISHED["XM430-W350"].values())) for found in sets]
    other = drives.with_mechanics(chosen)
    columns = ("damping", "friction", "armature")
    return replace(drives, **{name: np.where(known, getattr(other, name), getattr(drives, name)) for name in columns})


def _drawn_actuators(plant: Plant) -> Plant:
    """Return the plant with drawn damping, friction and armature of its joints."""
    model, dofs = copy.copy(plant.model), plant.dofs
    damping, friction, armature = _factors((3, len(dofs)))
    model.dof_damping[dofs] *= damping
    model.dof_frictionloss[dofs] *= friction
    model.dof_armature[dofs] *= armature
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return replace(plant, model=model)


def _factors(shape: tuple[int, int]) -> Floats:
    """Factors between 1 / SPREAD and SPREAD, even on a logarithmic scale."""
    bound = np.log(DRAWN_SPREAD)
    return np.exp(np.random.default_rng(SEED).uniform(-bound, bound, shape))
