"""Goals as a player sends them: rate, delay, settling, and the limits of the servo map."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.actuators.goals import RATE, Goals
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.judge.plant import Plant
from robot_retarget.robot.timing import sample_hinges
from robot_retarget.solver.smooth import within_speeds
from robot_retarget.trajectory import Trajectory


@dataclass(frozen=True)
class Playback:
    """How goals come to the servos."""

    rate: float = RATE
    """Goals a second, each held till the next; rounded to whole steps of the physics."""
    delay: float = 0.002
    """From the host to the windings [s]; rounded to whole steps of the physics."""
    settle_before: float = 1.0
    """The first pose is held this long before the trajectory begins [s]."""
    settle_after: float = 1.0
    """The last pose is held this long after it ends [s]."""
    seed: int = 0
    """Of the inertial sensor's noise and bias."""

    def __post_init__(self) -> None:
        for name, low in (("rate", 1.0), ("delay", 0.0), ("settle_before", 0.0), ("settle_after", 0.0)):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= low):
                raise UsageError(f"{name} must be a number of at least {low:g}, got {value}")

    def steps(self, step: float) -> int:
        """Steps of the physics [s] that a goal is held for."""
        return max(1, round(1 / (self.rate * step)))

    def on(self, plant: Plant) -> float:
        """The rate at which goals come to a plant, whose steps are whole [1/s]."""
        step = plant.model.opt.timestep
        return 1 / (self.steps(step) * step)


def plain_goals(plant: Plant, trajectory: Trajectory, playback: Playback | None = None) -> Goals:
    """The trajectory itself, as far as the servo map lets it be."""
    playback = playback or Playback()
    rate = playback.on(plant)
    times = np.arange(round(trajectory.duration * rate) + 1) / rate
    return settled(plant, sample_hinges(trajectory, plant.robot, times), playback)


def settled(plant: Plant, angles: Floats, playback: Playback) -> Goals:
    """Angles (N, n) at the playback's rate with the settling before and after.

    With a servo map, the goals are moved to the nearest path within its ranges and its speed: a player with that map sends exactly
    the goals that are judged.
    """
    rate = playback.on(plant)
    before, after = (round(settle * rate) for settle in (playback.settle_before, playback.settle_after))
    padded = np.pad(angles, ((before, after), (0, 0)), mode="edge")
    servo_map = plant.servo_map
    if servo_map is not None:
        servos = [servo_map[joint] for joint in plant.robot.joint_names]
        low, high = np.array([servo.reach for servo in servos]).T
        reach = np.full(len(servos), servo_map.limits.speed / rate)
        padded = within_speeds(np.clip(padded, low, high), reach)
    judged_on = "" if servo_map is None else servo_map.fingerprint
    return Goals(padded, rate, before / rate, after / rate, judged_on)
