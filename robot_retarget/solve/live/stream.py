"""A live stream: takes a frame of the human, returns a configuration within a millisecond."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.errors import UsageError
from robot_retarget.graph.describe import describe
from robot_retarget.graph.kind import Kind
from robot_retarget.graph.kinds import stream_kinds
from robot_retarget.graph.status import Status
from robot_retarget.graph.weights import Weights
from robot_retarget.motion import Motion, Skeleton, as_motion
from robot_retarget.robot import Robot, as_robot
from robot_retarget.solve.honoured import require_kinds
from robot_retarget.solve.live.follower import Follower, StreamPose
from robot_retarget.solve.options import RealTime

CALIBRATED = 1.0
"""Time for which an unknown performer is observed before the robot follows [s]."""
LEAST = 12
"""Smallest number of frames for which a performer is observed."""
FARTHEST = 1000.0
"""A joint farther away is an invalid position [m]."""


class Stream:
    """A robot that follows a performer, causal and in bounded memory.

    The first second determines the performer's bones, floor and axes; the robot stands until then, and eases into the
    motion.
    """

    robot: Robot
    skeleton: Skeleton
    options: RealTime
    weights: Weights | None
    native: bool

    def __init__(
        self,
        robot: Robot | str | Path,
        skeleton: Skeleton,
        *,
        calibration: Motion | None = None,
        lag: int = 0,
        options: RealTime | None = None,
        weights: Weights | None = None,
        kinds: Iterable[Kind] | None = None,
        native: bool = True,
    ):
        """Set up the stream for a robot and the performer's joints.

        Args:
            calibration: a motion of the same skeleton that replaces the observation of the first second; the robot then
                follows at once.
            lag: number of frames by which a pose is delayed; a larger lag is smoother.
            kinds: the kinds of edges; None takes `stream_kinds` (`graph.kinds`).
            native: use machine code as soon as it is ready.

        Raises:
            MatchError: the calibration shows no human, or the robot is no humanoid.
            GraphError: a kind has a role, form and stencil that a stream cannot honour.
            UsageError: the calibration has another skeleton, or the lag is negative.
        """
        if lag < 0:
            raise UsageError(f"a stream lags by 0 frames or more, got {lag}")
        self.lag = lag
        self.robot, self.skeleton, self.options = as_robot(robot), skeleton, options or RealTime()
        self.weights, self.native = weights, native
        self.kinds = stream_kinds(lag) if kinds is None else tuple(kinds)
        require_kinds(self.kinds, lag)
        self.faults: dict[str, int] = {}
        """Number of frames that were not followed, by kind of fault."""
        self.performer: Follower | None = None
        self._watched: list[tuple[Floats, Floats | None, float]] = []
        self._last: StreamPose | None = None
        if calibration is not None:
            if calibration.skeleton.names != skeleton.names:
                raise UsageError("the calibration is of another skeleton: its joints have other names")
            self.performer = self._calibrated(calibration)

    @property
    def calibration(self) -> Motion | None:
        """The frames that calibrated the performer; pass them to the next stream to follow at once."""
        return self.performer.graph.motion if self.performer else None

    def wait(self) -> None:
        """Wait until the machine code is ready or cannot be compiled.

        Without this call the stream switches to it as soon as it is ready.
        """
        if self.performer is not None:
            self.performer.problem.wait()

    def push(self, positions: Floats, rotations: Floats | None = None, *, time: float) -> StreamPose:
        """Return the configuration for a frame.

        Args:
            positions: (J, 3) positions of the joints, z up [m].
            rotations: (J, 4) world rotations of the joints, w x y z; None if they are unknown.
            time: time of the frame on the source's clock [s].

        Raises:
            UsageError: the shapes do not match the skeleton.
            MatchError: the observed frames show no human.
        """
        fault = self._fault(positions, rotations, time)
        if fault:
            self.faults[fault] = self.faults.get(fault, 0) + 1
            return self._standing(time) if self._last is None else self._last
        if self.performer is None:
            self._watched.append((np.array(positions), None if rotations is None else np.array(rotations), time))
            first = self._watched[0][2]
            if time - first < CALIBRATED or len(self._watched) < LEAST:
                return self._standing(time)
            watched, self._watched = self._watched, []  # where they show no human, another second is watched
            self.performer = self._calibrated(_motion_of(self.skeleton, watched))
        if self.performer.targets is None or self._last is None:
            self._last = self.performer.begin(positions, rotations, time, standing=self._last is not None)
        else:
            self._last = self.performer.follow(positions, rotations, time, time - self._last.time)
        return self._last

    def hold(self, time: float) -> StreamPose:
        """Return the configuration without a new frame: the last targets stay, and the robot comes to rest."""
        if self._last is None:
            return self._standing(time)
        if self.performer is None or self.performer.targets is None or time <= self._last.time:
            return self._last
        self._last = self.performer.rest(time, time - self._last.time)
        return self._last

    def _calibrated(self, motion: Motion) -> "Follower":
        graph = describe(motion, self.robot, fps=motion.fps, weights=self.weights, kinds=self.kinds)
        return Follower(graph, self.options, self.lag, self.native)

    def _standing(self, time: float) -> StreamPose:
        self._last = StreamPose(self.robot.standing(), time, Status.CALIBRATING)
        return self._last

    def _fault(self, positions: Floats, rotations: Floats | None, time: float) -> str | None:
        joints = len(self.skeleton)
        if np.shape(positions) != (joints, 3) or (rotations is not None and np.shape(rotations) != (joints, 4)):
            raise UsageError(
                f"a frame of {joints} joints has positions ({joints}, 3) and rotations ({joints}, 4) or None"
            )
        if not (np.isfinite(positions).all() and np.isfinite(time) and np.abs(positions).max() < FARTHEST):
            return "not finite"
        if rotations is not None and not (np.isfinite(rotations).all() and np.abs(rotations).max(axis=1).min() > 1e-6):
            return "not finite"
        if self._last is not None and time <= self._last.time:
            return "not after the one before"
        return None


def _motion_of(skeleton: Skeleton, watched: Sequence[tuple[Floats, Floats | None, float]]) -> Motion:
    """Return frames as a motion at their mean rate."""
    positions = np.array([frame[0] for frame in watched])
    turned = all(frame[1] is not None for frame in watched)
    rotations = np.array([frame[1] for frame in watched]) if turned else None
    return Motion(skeleton, positions, rotations, fps=(len(watched) - 1) / (watched[-1][2] - watched[0][2]))


def stream(
    robot: Robot | str | Path,
    frames: Motion | str | Path | Iterable[tuple[Floats, Floats | None, float]],
    skeleton: Skeleton | None = None,
    **options: Any,
) -> Iterator[Floats]:
    """Yield configurations (nq,) one at a time, each from the frames until then.

    Args:
        robot: a robot, or a name or model file that `load_robot` loads.
        frames: a motion or its file, which is also its calibration and is followed at its own rate; or positions (J, 3) [m],
            rotations (J, 4) or None, and time [s] of a skeleton's joints.
        options: those of `Stream`.

    Raises:
        UsageError: frames come without a skeleton.
        MatchError: the frames show no human.
    """
    if isinstance(frames, Motion | str | Path):
        frames = as_motion(frames)
        options.setdefault("calibration", frames)
        skeleton, frames = frames.skeleton, _frames_of(frames)
    if skeleton is None:
        raise UsageError("frames alone do not say whose joints they are: give the skeleton too")
    live = Stream(robot, skeleton, **options)
    for positions, rotations, time in frames:
        yield live.push(positions, rotations, time=time).qpos


def _frames_of(motion: Motion) -> Iterator[tuple[Floats, Floats | None, float]]:
    turns: Iterable[Floats | None] = motion.rotations if motion.rotations is not None else repeat(None)
    for t, (positions, rotations) in enumerate(zip(motion.positions, turns, strict=False)):
        yield positions, rotations, t / motion.fps
