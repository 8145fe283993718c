"""How a frozen controller follows a trajectory: falls in the nominal world and in drawn ones, and the motion as executed."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.judge.figures import fall_figures
from robot_retarget.judge.playback import Playback, plain_goals, roll_out
from robot_retarget.judge.policy import Policy, under_policy
from robot_retarget.judge.rollout import plant_of, rollouts
from robot_retarget.judge.worlds import draws
from robot_retarget.robot import Robot
from robot_retarget.robot.timing import sample_hinges
from robot_retarget.trajectory import Trajectory

WORLDS = 2
"""Drawn worlds beside the nominal one."""


@dataclass(frozen=True, eq=False)
class Followed:
    """A trajectory under a controller."""

    name: str
    falls: tuple[float | None, ...]
    """When the robot falls in each world, the nominal one first; None where it stays up [s]."""
    error: float
    """Joints as executed, minus the reference, in the nominal world until a fall (rms) [rad]."""
    executed: Trajectory
    """The motion in the nominal world, until a fall."""

    @property
    def fallen(self) -> int:
        """Number of worlds in which it falls."""
        return sum(fall is not None for fall in self.falls)

    def contract(self) -> dict[str, object]:
        """Plain values for JSON."""
        return {
            "name": self.name,
            "falls": self.fallen,
            "worlds": len(self.falls),
            "fall_s": self.falls,
            "error_rad": self.error,
        }


def followed(trajectory: Trajectory, robot: Robot, policy: Policy, worlds: int = WORLDS, name: str = "") -> Followed:
    """Play a trajectory under a controller in the nominal world and in drawn ones.

    Args:
        trajectory: the reference.
        robot: its robot, with the model's own actuators.
        policy: the controller.
        worlds: number of drawn worlds (`worlds.draws`).
        name: of the trajectory; by default its source.

    Raises:
        UsageError: as `simulate` with a policy.
    """
    plant = under_policy(plant_of(robot, "free", None, 0.0, trajectory.scene), policy)
    playback = Playback(rate=policy.contract.rate)
    goals = plain_goals(plant, trajectory, playback)
    nominal = roll_out(plant, trajectory, "free", playback, goals)
    others = rollouts(plant, replace(trajectory, goals=goals), draws(worlds), playback=playback, command=goals)
    falls = tuple(
        each.unstable if each.unstable is not None else fall_figures(each, robot, trajectory)["fall_s"]
        for each in (nominal, *others)
    )
    end = trajectory.duration if falls[0] is None else max(falls[0], 0.0)
    played = (nominal.times >= 0) & (nominal.times <= end)
    states, times = nominal.qpos[played], nominal.times[played]
    if not len(states):
        states, times = nominal.qpos[-1:], nominal.times[-1:].clip(0.0)
    wrong = states[:, robot.qpos_index] - sample_hinges(trajectory, robot, times)
    human = np.interp(times, np.arange(len(trajectory)) / trajectory.fps, trajectory.source_time)
    executed = replace(trajectory, qpos=states, fps=goals.rate, goals=None, source_time=human)
    return Followed(name or trajectory.source, falls, round(float(np.sqrt((wrong**2).mean())), 4), executed)


def ranked(found: Iterable[Followed]) -> list[Followed]:
    """Return the trajectories that the controller follows best first: by falls, then by the error of joints."""
    return sorted(found, key=lambda each: (each.fallen, each.error))
