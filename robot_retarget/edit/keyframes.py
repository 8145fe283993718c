"""Keyframes: poses with times, and the trajectory through them.

Let a and b be the mean velocities of a joint before and after a keyframe. If they have one sign and the keyframe has no pause, the joint
passes it with v = sign(a) min(|a|, |b|); else it stands there. Its acceleration at a keyframe is 0. Between two keyframes the joint follows
the path of least jerk (`base.arrays.least_jerk`), which never turns back. A path takes longer if a joint would exceed its speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats, frozen, least_jerk
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.edit.touchup import REST, apply_edit
from robot_retarget.formats.action_pages import LONGEST_UNEVEN
from robot_retarget.graph.describe import describe
from robot_retarget.graph.edits import Edit
from robot_retarget.human.robot_performer import performed
from robot_retarget.robot import Robot
from robot_retarget.robot.planted import planted
from robot_retarget.trajectory import Trajectory

FPS = 50.0
"""Frames per second of a trajectory [1/s], by definition: those of a motion that is recorded by hand."""
INSTANTS = np.linspace(0.0, 1.0, 65)[:, None, None]
"""Samples of the speed on a path, in shares of its time: they find the largest speed to a thousandth."""
FAST = 1e-3
"""A joint may exceed its speed by this share [-], by definition."""
FIRM = 1e4
"""Priority of the edge of a dragged keypoint [-], as in the viewer: within reach the keypoint is off by a millimetre at most."""


@dataclass(frozen=True)
class Keyframe:
    """A pose of a robot, and the time to reach it."""

    angles: Floats
    """(n,) angles of the hinges [rad]."""
    seconds: float = 1.0
    """Time from the keyframe before [s]; the first keyframe ignores it."""
    pause: float = 0.0
    """Duration of the pose [s]."""
    step: int | None = None
    """Index of the pose in its file; None for a new one."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "angles", frozen(self.angles))
        if not np.isfinite(self.angles).all():
            raise TrajectoryError("an angle of a keyframe is not finite")
        for what, value in (("seconds", self.seconds), ("pause", self.pause)):
            if not 0 <= value <= LONGEST_UNEVEN:
                raise TrajectoryError(f"{what} of a keyframe must be 0 to {LONGEST_UNEVEN:g}, got {value:g}")


@dataclass(frozen=True, eq=False)
class KeyframedMotion:
    """The motion through K keyframes."""

    poses: Floats
    """(K, n) [rad]."""
    times: Floats
    """(K,) times at which the keyframes are reached [s]."""
    pauses: Floats
    """(K,) [s]."""
    velocities: Floats
    """(K, n) joint velocities at the keyframes [rad/s]."""
    notes: tuple[str, ...] = ()
    """A sentence for each path that takes longer than its keyframe states."""

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.times[-1] + self.pauses[-1])

    def at(self, times: Floats) -> Floats:
        """Return the angles (T, n) at times (T,) [s]."""
        if len(self.poses) == 1:
            return np.tile(self.poses, (len(times), 1))
        k = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        spans = np.maximum(np.diff(self.times) - self.pauses[:-1], 1e-9)[k]
        u = np.clip((times - self.times[k] - self.pauses[k]) / spans, 0.0, 1.0)
        way, before, after = self.poses[k + 1] - self.poses[k], self.velocities[k], self.velocities[k + 1]
        return self.poses[k] + least_jerk(u[:, None], way, before * spans[:, None], after * spans[:, None])[0]


def motion_through(keyframes: Sequence[Keyframe], robot: Robot) -> KeyframedMotion:
    """Return the motion through keyframes, within the speeds of the joints.

    Raises:
        UsageError: no keyframe is given.
        TrajectoryError: the motion is too long.
    """
    if not keyframes:
        raise UsageError("a motion needs a keyframe")
    poses, pauses = np.array([key.angles for key in keyframes]), np.array([key.pause for key in keyframes])
    ways, wanted = np.diff(poses, axis=0), np.maximum([key.seconds for key in keyframes[1:]], 1 / FPS)
    spans = wanted
    while True:
        passed = _passed(ways / spans[:, None], pauses)
        shares = _shares(ways, spans[:, None], passed) / robot.max_speed
        if shares.max(initial=0.0) <= 1 + FAST:
            break
        spans = spans * np.maximum(shares.max(axis=1), 1.0)
    times = np.concatenate([[0.0], np.cumsum(pauses[:-1] + spans)])
    if times[-1] + pauses[-1] > LONGEST_UNEVEN:
        raise TrajectoryError(f"the keyframes last {times[-1] + pauses[-1]:.0f} s, more than {LONGEST_UNEVEN:g} s")
    notes = [
        f"The way to keyframe {k + 2} takes {spans[k]:.2f} s instead of {wanted[k]:.2f} s: {robot.joint_names[j]} turns at most {robot.max_speed[j]:.3g} rad/s."
        for k, j in enumerate(shares.argmax(axis=1).tolist())
        if spans[k] > wanted[k]
    ]
    return KeyframedMotion(poses, times, pauses, passed, tuple(notes))


def _passed(means: Floats, pauses: Floats) -> Floats:
    """Return (K, n) velocities at keyframes from the mean velocities between them (K − 1, n) [rad/s]."""
    velocities = np.zeros((len(pauses), means.shape[1]))
    before, after = means[:-1], means[1:]
    goes_on = (before * after > 0) & (pauses[1:-1, None] == 0)
    velocities[1:-1] = np.where(goes_on, np.sign(before) * np.minimum(np.abs(before), np.abs(after)), 0.0)
    return velocities


def _shares(ways: Floats, spans: Floats, passed: Floats) -> Floats:
    """Return (K − 1, n) the largest speed on each path [rad/s]."""
    _, velocities = least_jerk(INSTANTS, ways, passed[:-1] * spans, passed[1:] * spans)
    return np.abs(velocities).max(axis=0) / spans


def trajectory_through(
    keyframes: Sequence[Keyframe], robot: Robot, fps: float = FPS, source: str = ""
) -> tuple[Trajectory, KeyframedMotion]:
    """Return the trajectory through keyframes, on its feet (`planted`), and the motion of its joints.

    Args:
        keyframes: the keyframes in order.
        robot: the robot of the keyframes.
        fps: frames per second of the trajectory [1/s].
        source: the name of the keyframes' file.

    Raises:
        UsageError: no keyframe is given.
        TrajectoryError: the motion is too long.
    """
    motion = motion_through(keyframes, robot)
    times = np.arange(np.ceil(motion.duration * fps - 1e-6) + 1) / fps
    qpos = planted(robot, motion.at(np.minimum(times, motion.duration)))
    return Trajectory(qpos, fps, robot.joint_names, robot.name, source, motion.notes), motion


def dragged(qpos: Floats, robot: Robot, keypoint: str, place: Floats) -> tuple[Floats, str]:
    """Move a keypoint to a place by a touch-up of one frame; return the angles (n,), and the result in words.

    Args:
        qpos: (nq,) the pose before.
        robot: the robot of the pose.
        keypoint: a hand, a foot or another of the robot's keypoints.
        place: (3,) in the world [m].

    Raises:
        GraphError: the robot lacks the keypoint.
        MatchError: the robot is no humanoid.
    """
    pose = Trajectory(qpos[None], FPS, robot.joint_names, robot.name)
    edge = {"a": keypoint, "b": [float(x) for x in place], "at": 0, "priority": FIRM, "frames": [0, 0]}
    made = apply_edit(describe(performed(pose, robot), robot, fps=FPS), pose, Edit("edge", edge))
    return made.trajectory.angles[0], made.reached.removesuffix(f"; {REST}")
