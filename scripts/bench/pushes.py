"""The impulse that a robot survives: a push on the trunk in randomised simulations.

Each simulation is played once up to the push; every impulse begins from its state there.
"""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count, islice

import mujoco
import numpy as np

from robot_retarget.actuators.goals import Goals
from robot_retarget.base.arrays import Floats
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.feedback import ClosedLoop, closed_loop, with_feedback
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.playback import Playback, PlayedPlant
from robot_retarget.judge.worlds import Draw, drawn
from robot_retarget.robot.support import feet_of
from robot_retarget.trajectory import Trajectory

DIRECTIONS = {"fore": (1.0, 0.0, 0.0), "aft": (-1.0, 0.0, 0.0), "left": (0.0, 1.0, 0.0), "right": (0.0, -1.0, 0.0)}
"""Unit vectors of the pushes in the world's axes."""
DURATION = 0.1
"""Duration of a push [s], rounded to whole goals."""
AFTER = 1.8
"""A robot that stays up for this time after the push survives it [s]."""
MOST = 4.0
"""Impulses are searched up to this value [N s] ..."""
STEP = 0.0625
"""... to within this value [N s]."""
CHECKED = 4
"""Contacts with the floor are checked at every fourth goal."""


@dataclass
class PushedWorld:
    """One randomised simulation at a moment."""

    played: PlayedPlant
    goals: Goals
    loop: ClosedLoop | None
    feet: frozenset[int]
    """Bodies that may touch the floor."""
    row: int = 0

    @property
    def data(self) -> mujoco.MjData:
        """The state."""
        return self.played.data

    def copy(self) -> "PushedWorld":
        """Return an independent copy."""
        return replace(self, played=self.played.copy(), loop=copy.deepcopy(self.loop))

    def tick(self, force: Floats) -> None:
        """Play one goal under a force (3,) on the trunk [N]."""
        plant, row = self.played.plant, min(self.row, len(self.goals) - 1)
        self.data.xfrc_applied[plant.robot.root_body, :3] = force
        self.played.tick(self.goals.angles[row] if self.loop is None else self.loop.goal(row, self.data))
        self.row += 1

    def fallen(self) -> bool:
        """Whether a body other than a foot touches the floor."""
        bodies = self.played.plant.model.geom_bodyid[self.data.contact.geom[: self.data.ncon]]
        scene = (bodies == 0).any(axis=1)
        return bool(scene.any()) and not set(bodies[scene].max(axis=1).tolist()) <= self.feet


def worlds_at_push(plant: Plant, trajectory: Trajectory, draws: Sequence[Draw], feedback: bool) -> list[PushedWorld]:
    """Return the randomised simulations at the middle of a motion."""
    goals = compensated(plant, trajectory, "free")
    goals = with_feedback(plant, trajectory, goals) if feedback else goals
    return [next(worlds_at(plant, trajectory, goals, draw, [len(goals) // 2])) for draw in draws]


def worlds_at(
    plant: Plant, trajectory: Trajectory, goals: Goals, draw: Draw, rows: Sequence[int]
) -> Iterator[PushedWorld]:
    """Yield copies of one randomised simulation at ascending rows of the goals."""
    world, how = drawn(plant, draw, Playback())  # its model is its own
    played = PlayedPlant(world, goals.rate, how.delay)
    played.place(trajectory.qpos[0], on_floor=True)
    feet = frozenset(feet_of(plant.robot).all_bodies)
    found = PushedWorld(played, goals, closed_loop(world, goals, how.seed), feet)
    for row in rows:
        while found.row < row:
            found.tick(np.zeros(3))
        yield found.copy()


def pushed(start: PushedWorld, impulse: Floats) -> Iterator[PushedWorld]:
    """Yield a world after each goal from a push on, without an end.

    Args:
        impulse: (3,) in the world's axes [N s].
    """
    world, pushes = start.copy(), round(DURATION * start.goals.rate)
    for k in count():
        world.tick(impulse * start.goals.rate / pushes if k < pushes else np.zeros(3))
        yield world


def survives(start: PushedWorld, impulse: Floats, after: float = AFTER) -> bool:
    """Return whether a world stays up for a time [s] after a push (3,) [N s]."""
    ticks = round(after * start.goals.rate)
    worlds = islice(pushed(start, impulse), CHECKED - 1, ticks, CHECKED)
    return not any(world.fallen() for world in worlds)


def largest_survived(start: PushedWorld, direction: Floats) -> float:
    """Return the largest impulse [N s] along a direction (3,) that one world survives, by bisection."""
    low, high = 0.0, MOST
    while high - low > STEP:
        middle = (low + high) / 2
        low, high = (middle, high) if survives(start, middle * direction) else (low, middle)
    return low


def survived_impulses(starts: Sequence[PushedWorld], direction: Floats) -> Floats:
    """Return the largest survived impulse of each world, ascending (worlds,) [N s]."""
    return np.sort([largest_survived(start, direction) for start in starts])


def standing(trajectory: Trajectory, seconds: float = 1.0) -> Trajectory:
    """Return its first pose, held for a time [s]."""
    frames = round(seconds * trajectory.fps) + 1
    qpos = np.tile(trajectory.qpos[:1], (frames, 1))
    return Trajectory(qpos, trajectory.fps, trajectory.joint_names, trajectory.robot, "stand")
