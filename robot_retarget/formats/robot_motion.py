"""Options of a user about a file, and the input of a writer: a trajectory on its robot, split into root and joints."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import UsageError, known
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.soles import contacts_of
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import resample
from robot_retarget.trajectory import Trajectory

FEET = {"l": "left_foot", "r": "right_foot"}
"""Names of feet in files, by the side."""
SKIPPED = "_"
"""Stands in a list of joints for a column that no joint of the robot takes."""


@dataclass(frozen=True)
class FormatOptions:
    """Asked of an export or an import; everything has a default."""

    joints: tuple[str, ...] | None = None
    """Names of the joint columns in their order; `_` for a column that is not a joint of the robot."""
    fps: float | None = None
    """Frames per second of the output; by default those of the format, or of the file."""
    source_fps: float | None = None
    """Frames per second of a file that says none."""
    quaternion: str | None = None
    """`wxyz` or `xyzw`: the order in a file whose program wrote another than its format has."""
    servos: str | None = None
    """Servo map of formats that count servo ticks: a shipped robot's name or a TOML file."""
    scene: Path | None = None
    """Scene file with the bodies around the robot, for an import; by default the one next to the file."""


@dataclass(frozen=True)
class RobotMotion:
    """A trajectory at the rate of the file, its quaternions without jumps of sign."""

    trajectory: Trajectory
    robot: Robot
    joints: tuple[str, ...]
    """The hinges in the order of the file."""
    options: FormatOptions = field(default_factory=FormatOptions)

    def __len__(self) -> int:
        return len(self.trajectory)

    @property
    def qpos(self) -> Floats:
        """(T, nq) in MuJoCo's order."""
        return self.trajectory.qpos

    @property
    def fps(self) -> float:
        """[1/s]."""
        return self.trajectory.fps

    @property
    def position(self) -> Floats:
        """(T, 3) of the free root [m]."""
        start = self._root()
        return self.qpos[:, start : start + 3]

    @property
    def quaternion(self) -> Floats:
        """(T, 4) of the free root, w x y z."""
        start = self._root()
        return self.qpos[:, start + 3 : start + 7]

    @cached_property
    def angles(self) -> Floats:
        """(T, n) of the joints in the order of the file [rad]."""
        place = {name: index for name, index in zip(self.robot.joint_names, self.robot.qpos_index, strict=True)}
        return self.qpos[:, [place[joint] for joint in self.joints]]

    @cached_property
    def contacts(self) -> ContactRecord:
        """Which feet are on the ground."""
        return contacts_of(self.trajectory, self.robot)

    @property
    def foot_contacts(self) -> dict[str, Bools]:
        """(T,) by `left_foot` and `right_foot` whether a part of the sole stands: on the ground and slow; empty without feet."""
        return dict(zip(map(FEET.__getitem__, self.contacts.feet), self.contacts.planted.T, strict=True))

    def require_plain(self, format: str) -> None:
        """Raise UsageError unless the robot has a free root and hinges only."""
        self._root(format)
        if self.robot.model.nq != 7 + len(self.robot.joint_names):
            raise UsageError(
                f"format {format!r} holds a free root and hinges; {self.robot.name!r} has more coordinates"
            )

    def _root(self, format: str | None = None) -> int:
        if not self.robot.floating:
            what = f"format {format!r}" if format else "the format"
            raise UsageError(f"{what} needs a robot with a free root; the root of {self.robot.name!r} is not free")
        return self.robot.root_address


def robot_motion(
    trajectory: Trajectory, robot: Robot, options: FormatOptions, fps: float | None, ordered: bool, format: str
) -> RobotMotion:
    """Prepare a trajectory for a writer: at the user's rate or the format's, joints in the user's order.

    Raises:
        UsageError: the rate is not positive, or the requested joints are not the robot's, or the format has a fixed order.
    """
    rate = trajectory.fps if fps is None else fps
    rate = rate if options.fps is None else options.fps
    if rate != trajectory.fps:
        trajectory = resample(trajectory, robot, rate)
    joints = robot.joint_names
    if options.joints is not None:
        if not ordered:
            raise UsageError(f"format {format!r} has a fixed order: it takes no --joints")
        strange = [name for name in options.joints if name not in robot.joint_names]
        if strange:
            raise UsageError(f"--joints names {strange[0]!r}, which {robot.name!r} has not; {known(robot.joint_names)}")
        joints = options.joints
    return RobotMotion(continuous(trajectory, robot), robot, joints, options)


def continuous(trajectory: Trajectory, robot: Robot) -> Trajectory:
    """The trajectory with every root quaternion on the side of the one before: q and −q are one rotation."""
    if not robot.floating:
        return trajectory
    columns = robot.root_address + 3 + np.arange(4)
    quaternion = trajectory.qpos[:, columns]
    turned = np.einsum("ti,ti->t", quaternion[1:], quaternion[:-1]) < 0
    if not turned.any():
        return trajectory
    signs = np.concatenate([[1.0], np.cumprod(np.where(turned, -1.0, 1.0))])
    qpos = trajectory.qpos.copy()
    qpos[:, columns] *= signs[:, None]
    return replace(trajectory, qpos=qpos)
