"""A stream kept from colliding with itself: what is wanted goes in, what is safe comes out.

Every frame the joints go to where they are wanted. Two links may not come nearer than a margin, though; and where a
contact is imminent, what lies between them and the margin may shrink no faster than

    d − margin ≥ (1 − gain)^(30/fps) (d_before − margin),

the closer, the slower: the velocity damper of [FaverjonTournassoud1987]. Where a step breaks this, the joints between
the two links, which alone move one against the other, have their part of it halved until it holds; with no part left
they stand as they did a frame before, so a safe step is always found. From then on they gather speed slowly, until they
have caught up with what is wanted.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.collision.approach import REST
from robot_retarget.collision.warn import Surfaces, Warner, Warnings, WarnOptions, surfaces
from robot_retarget.errors import UsageError
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import carrying

LEAST = 2.0**-6
"""A part of a step this small is none."""
PLACES = 32
"""Configurations tried on the way from the standing pose to a first one that collides."""


@dataclass(frozen=True)
class GuardOptions:
    """How near links may come, and how fast held joints are let go.

    Raises:
        UsageError: an option out of range.
    """

    margin: float = 0.003
    """The nearest two links may come [m]."""
    near: float = 0.05
    """Links whose capsules stay farther apart than this are left alone [m]."""
    gain: float = 0.5
    """The part of the distance left that 1/30 s may take where a contact is imminent, above 0, at most 1."""
    release: float = 0.3
    """Time in which a held joint gathers its full speed again [s]."""

    def __post_init__(self) -> None:
        if not 0 < self.gain <= 1:
            raise UsageError(f"gain must be above 0 and at most 1, got {self.gain}")
        if not (0 <= self.margin < self.near < np.inf and 0 < self.release < np.inf):
            raise UsageError("a guard takes 0 ≤ margin < near [m] and release > 0 s")


@dataclass(frozen=True, eq=False)
class Guarded:
    """One frame of a guarded stream."""

    qpos: Floats
    """(nq,) safe to play."""
    held: tuple[str, ...]
    """Joints that are slowed or held."""
    warnings: Warnings
    """What the wanted stream runs into."""


class Guard:
    """Guards one stream: give every wanted configuration as it comes."""

    def __init__(
        self,
        robot: Robot,
        fps: float,
        options: GuardOptions | None = None,
        warn: WarnOptions | None = None,
        known: Surfaces | None = None,
    ):
        """Fit the robot's surfaces, unless they are `known`.

        Raises:
            UsageError: fps is not positive.
        """
        self.robot, self.options, self.known = robot, options or GuardOptions(), known or surfaces(robot)
        self.warner = Warner(robot, fps, warn, self.known)
        self.clearance = self.warner.eye.clearance
        carried = carrying(robot.model)[:, robot.dof_index]
        self.between = carried[self.known.pairs.links[:, 0]] ^ carried[self.known.pairs.links[:, 1]]
        self.keep = (1 - self.options.gain) ** (30 / fps)
        self.fastest = robot.max_speed / fps
        self.gather = self.fastest / (self.options.release * fps)
        self.pace = np.full(len(robot.joint_names), np.inf)
        self.safe: Floats | None = None

    def update(self, wanted: Floats) -> Guarded:
        """The configuration to play in place of the wanted one (nq,).

        Raises:
            TrajectoryError: it has another length, or a value that is not finite.
        """
        warnings = self.warner.update(wanted)
        wanted = np.array(wanted, dtype=float)
        if self.safe is None:
            self.safe = self._begin(wanted)
            off = (self.safe != wanted)[self.robot.qpos_index]
            self.pace = np.where(off, 0.0, np.inf)
        else:
            self.safe = self._step(self.safe, wanted, warnings.flagged[0])
        slowed = np.flatnonzero(np.isfinite(self.pace))
        return Guarded(self.safe.copy(), tuple(self.robot.joint_names[k] for k in slowed), warnings)

    def _step(self, safe: Floats, wanted: Floats, imminent: np.ndarray) -> Floats:
        """The farthest found on the way from the last safe configuration to the wanted one."""
        columns = self.robot.qpos_index
        way = wanted[columns] - safe[columns]
        pace = np.minimum(self.pace + self.gather, self.fastest)
        self.pace = np.where(np.isinf(self.pace) | (np.abs(way) <= pace), np.inf, pace)
        move, share = np.clip(way, -self.pace, self.pace), np.ones(len(way))
        reached = wanted.copy()
        reached[columns] = safe[columns] + move
        pairs = self._near(safe, reached)
        before, margin = self._distances(safe, pairs), self.options.margin
        room = np.where(imminent[pairs], self.keep * (before - margin), 0.0)
        asked = np.where(before > margin, margin + room, before)
        while True:
            broken = pairs[self._distances(reached, pairs) < asked]
            slower = self.between[broken].any(axis=0) & (share > 0)
            if not slower.any():
                break
            share = np.where(slower, np.where(share > 2 * LEAST, share / 2, 0.0), share)
            reached[columns] = safe[columns] + share * move
        self.pace = np.where(share < 1, np.abs(share * move), self.pace)
        return reached

    def _near(self, safe: Floats, wanted: Floats) -> Ints:
        """The pairs whose capsules are near each other before, halfway, or after."""
        ends = self.warner.eye.ends.along(self.warner.eye.joints.pinned(np.array([safe, (safe + wanted) / 2, wanted])))
        distance = self.known.capsule_pairs.approach(ends, np.zeros_like(ends), REST).distance
        return np.flatnonzero(distance.min(axis=0) < self.options.near)

    def _distances(self, qpos: Floats, pairs: Ints) -> Floats:
        return self.clearance.along(qpos[None], pairs, self.options.near)[0]

    def _begin(self, wanted: Floats) -> Floats:
        """The wanted configuration, or the last before a contact on the way to it from the standing pose."""
        margin, near = self.options.margin, self.options.near
        if (self.clearance.all(wanted[None], near) >= margin).all():
            return wanted
        columns, reached = self.robot.qpos_index, wanted.copy()
        start, way = self.robot.standing()[columns], wanted.copy()
        for share in np.linspace(0, 1, PLACES):
            way[columns] = start + share * (wanted[columns] - start)
            if share > 0 and (self.clearance.all(way[None], near) < margin).any():
                break
            reached = way.copy()
        return reached
