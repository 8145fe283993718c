"""A live stream: takes a frame of the human, returns a configuration within a millisecond."""

import warnings
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import repeat
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.base.untrusted.arrays import FARTHEST
from robot_retarget.graph.describe import CausalTargets, RobotGraph, among, describe
from robot_retarget.graph.footholds import placed_feet
from robot_retarget.graph.kind import Kind
from robot_retarget.graph.kinds import stream_kinds
from robot_retarget.graph.placed_scene import RootScaling, root_scaling_of
from robot_retarget.graph.track import Status
from robot_retarget.graph.weights import Weights
from robot_retarget.human.capture import USUAL_FPS
from robot_retarget.human.causal import CausalFeatures, CausalSurroundings
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import as_motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.human.surroundings import LiveScene
from robot_retarget.robot import Robot, as_robot
from robot_retarget.robot.dynamics import Placer
from robot_retarget.robot.kinematics import PlacedPoints
from robot_retarget.robot.support import CORNERS, sole_corners, together
from robot_retarget.scene import Scene, read_scene
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.limits import Targets
from robot_retarget.solver.options import RealTime
from robot_retarget.solver.problem import Problem, build_problem, require_kinds
from robot_retarget.solver.realtime import FixedLag, RealTimeSolver, SolvedFrame
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.starts import root_placer

FIRST = 1 / USUAL_FPS
"""Assumed duration of the first frame [s]."""


@dataclass(frozen=True, eq=False)
class StreamPose:
    """The result of a stream for a frame."""

    qpos: Floats
    """(nq,)."""
    time: float
    """Time of the newest frame on the source's clock [s]."""
    status: Status
    age: float = 0.0
    """Delay of the frame that the pose follows [s]."""
    bodies: Mapping[str, Floats] = field(default_factory=dict)
    """(7,) pose of each body of the scene around the robot at the newest frame: x y z [m], quaternion w x y z."""
    size: float = 1.0
    """Size of the bodies over their captured size [-]."""


@dataclass(frozen=True, eq=False)
class StreamInput:
    """A frame of a performer."""

    positions: Floats
    """(J, 3) [m]."""
    rotations: Floats | None
    """(J, 4) w x y z."""
    time: float
    """[s]."""
    scene: Scene | None = None
    """The bodies around with their poses of this frame."""


class Follower:
    """One calibrated performer and one robot."""

    graph: RobotGraph
    all_targets: CausalTargets

    def __init__(self, graph: RobotGraph, options: RealTime, lag: int, native: bool):
        match = graph.match
        self.graph, self.all_targets = graph, CausalTargets(graph)
        around = graph.human.around
        self.human: CausalFeatures = CausalFeatures(
            graph.human,
            None if around is None else CausalSurroundings(match, graph.motion.skeleton, around.scene),
        )
        self.root_scaling: RootScaling = root_scaling_of(graph.human, match)
        self.problem: Problem = build_problem(graph.robot, match, graph.tracks, native=native, lag=lag)
        frames = FrameSolver(self.problem)
        self.solver: RealTimeSolver = RealTimeSolver(frames, options)
        self.lag: FixedLag | None = FixedLag(frames, lag, options, graph.fps) if lag else None
        soles = together([sole_corners(match.anatomy, foot) for foot in placed_feet(match, graph.robot)])
        self.corners: PlacedPoints = PlacedPoints(graph.robot, soles)
        self.stood: Placer = root_placer(graph.robot, match.anatomy, graph.robot.standing())
        self.targets: Targets | None = None
        self.latest: HumanFeatures | None = None
        self._intervals: deque[float] = deque(maxlen=LEAST_OBSERVED + 1)

    def begin(self, frame: StreamInput, standing: bool) -> StreamPose:
        """Return the first pose: the performer's, or the standing pose, which then eases into the motion."""
        human = self._read(frame, FIRST)
        start = self._standing(human)
        self.targets = self._targets_at(human, start, FIRST)
        pose = self.solver.stand(start, self.targets) if standing else self.solver.begin(start, self.targets)
        return self._given(pose, frame.time, FIRST)

    def follow(self, frame: StreamInput, since: float) -> StreamPose:
        """Return the pose for a frame, `since` seconds after the one before."""
        self._warn_of_rate(since)
        self.targets = self._targets_at(self._read(frame, since), self.solver.qpos, since)
        return self._given(self._stepped(since), frame.time, since)

    def _warn_of_rate(self, since: float) -> None:
        """Warn once where a lagging stream is fed at another rate than it was calibrated at, on the mean of `LEAST_OBSERVED` frames."""
        self._intervals.append(since)
        if self.lag is None or len(self._intervals) != LEAST_OBSERVED:
            return
        fed, calibrated = LEAST_OBSERVED / max(sum(self._intervals), SHORTEST), self.graph.motion.fps
        if not 1 / ANOTHER_RATE < fed / calibrated < ANOTHER_RATE:
            warnings.warn(
                f"frames come at {fed:.0f} a second, and the calibration has {calibrated:.0f}: with a lag of {self.lag.lag} frames "
                "limbs follow less closely; calibrate at the rate of the stream",
                stacklevel=4,
            )

    def _read(self, frame: StreamInput, since: float) -> HumanFeatures:
        self.latest = self.human.step(frame.positions, frame.rotations, since, frame.scene)
        return self.latest

    def rest(self, time: float, since: float) -> StreamPose:
        """Return the pose at a time without a new frame; the targets stay."""
        return replace(self._given(self._stepped(since), time, since), status=Status.HELD)

    def _stepped(self, since: float) -> FrameSolution:
        assert self.targets is not None and self.latest is not None
        human = self.latest
        return self.solver.step(self.targets, since, lambda: self._standing(human))

    def _standing(self, human: HumanFeatures) -> Floats:
        """Return the standing pose (nq,) with the human's pelvis position and heading."""
        return self.stood(self.root_scaling.path(human)[0], human.facing[0])

    def _given(self, pose: FrameSolution, time: float, since: float) -> StreamPose:
        """Return the pose of the stream, smoothed if there is a lag."""
        late, answered = pose, time
        if self.lag is not None and self.targets is not None:
            late, answered = self.lag.smoothed(SolvedFrame(pose, self.targets, time, since))
        scene = self.all_targets.scene
        around = ({}, 1.0) if scene is None else (dict(zip(scene.names, scene.poses(1)[0], strict=True)), scene.size)
        return StreamPose(late.qpos, time, late.status, time - answered, *around)

    def _targets_at(self, human: HumanFeatures, qpos: Floats, seconds: float) -> Targets:
        targets = self.all_targets.at(human, self.corners.at(qpos).reshape(-1, CORNERS, 3), seconds)
        return Targets(*(np.array(each) for each in targets)) if self.lag else Targets(*targets)


CALIBRATED = 1.0
"""Time for which an unknown performer is observed before the robot follows [s]."""
LEAST_OBSERVED = 12
"""Smallest number of frames for which a performer is observed: those of `CALIBRATED` at 12 frames a second."""
ANOTHER_RATE = 1.5
"""Ratio of rates from which on a stream with a lag is worse: by 2° of limb direction at 2 (120 and 30 per second after 60)."""
SHORTEST = 1e-6
"""A quaternion whose largest component is smaller is no rotation [-]."""


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
        scene: Scene | str | Path | None = None,
        scene_scale: float | None = None,
    ):
        """Set up the stream for a robot and the performer's joints.

        Args:
            calibration: a motion of the same skeleton that replaces the observation of the first second; the robot then
                follows at once.
            lag: number of frames by which a pose is delayed; a larger lag is smoother.
            kinds: the kinds of edges; None takes `stream_kinds` (`graph.kinds`).
            native: compile the problem in the background and use the machine code when it is ready.
            scene: the bodies around the performer, or a file that `read_scene` reads; None takes those of the calibration, if
                any. Each has its first pose until a frame brings another, or the pose of the joint that carries it.
            scene_scale: size of the bodies around the robot over their captured size [-]; None scales them with the human.

        Raises:
            MatchError: the calibration shows no human, or the robot is no humanoid.
            SceneError: the scene cannot be read, or does not fit the performer.
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
        self.faults: Counter[str] = Counter()
        """Number of frames, and of poses of bodies, that were not followed, by kind of fault."""
        self.performer: Follower | None = None
        self.around: LiveScene | None = None
        """The bodies around the performer."""
        scene = calibration.scene if scene is None and calibration is not None else scene
        if scene is not None:
            read = scene if isinstance(scene, Scene) else read_scene(scene)
            sized = read if scene_scale is None else replace(read, scale=scene_scale)
            self.around = LiveScene(sized, skeleton, self.faults)
        self._watched: list[tuple[StreamInput, Floats | None]] = []
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

        Without this call the stream switches to it when it is ready.
        """
        if self.performer is not None:
            self.performer.problem.wait()

    def push(
        self,
        positions: Floats,
        rotations: Floats | None = None,
        *,
        time: float,
        poses: Mapping[str, Floats] | None = None,
    ) -> StreamPose:
        """Return the configuration for a frame.

        Args:
            positions: (J, 3) positions of the joints, z up [m].
            rotations: (J, 4) world rotations of the joints, w x y z; None if they are unknown.
            time: time of the frame on the source's clock [s].
            poses: (7,) by the names of bodies of the scene: x y z [m], quaternion w x y z. Others keep theirs.

        Raises:
            UsageError: the shapes do not match the skeleton.
            MatchError: the observed frames show no human.
        """
        fault = self._fault(positions, rotations, time)
        if fault:
            self.faults[fault] += 1
            return self._standing(time) if self._last is None else self._last
        bodies = None if self.around is None else self.around.step(poses or {}, positions, rotations)
        around = None if self.around is None or bodies is None else self.around.scene(bodies[None])
        frame = StreamInput(positions, rotations, time, around)
        if self.performer is None:
            turns = None if rotations is None else np.array(rotations)
            self._watched.append((replace(frame, positions=np.array(positions), rotations=turns), bodies))
            first = self._watched[0][0].time
            if time - first < CALIBRATED or len(self._watched) < LEAST_OBSERVED:
                return self._standing(time)
            watched, self._watched = self._watched_motion(), []  # where it shows no human, another second is watched
            self.performer = self._calibrated(watched)
        if self.performer.targets is None or self._last is None:
            self._last = self.performer.begin(frame, standing=self._last is not None)
        else:
            self._last = self.performer.follow(frame, time - self._last.time)
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
        motion = motion if self.around is None else self.around.around(motion)
        graph = describe(motion, self.robot, fps=motion.fps, weights=self.weights, kinds=self.kinds)
        return Follower(graph, self.options, self.lag, self.native)

    def _watched_motion(self) -> Motion:
        """Return the watched frames as a motion at their mean rate."""
        frames = [frame for frame, _ in self._watched]
        positions = np.array([frame.positions for frame in frames])
        turns = [frame.rotations for frame in frames]
        rotations = None if any(turn is None for turn in turns) else np.array(turns)
        motion = Motion(self.skeleton, positions, rotations, fps=(len(frames) - 1) / (frames[-1].time - frames[0].time))
        if self.around is None:
            return motion
        return replace(motion, scene=self.around.scene(np.array([bodies for _, bodies in self._watched])))

    def _standing(self, time: float) -> StreamPose:
        self._last = StreamPose(self.robot.standing(), time, Status.CALIBRATING)
        return self._last

    def _fault(self, positions: Floats, rotations: Floats | None, time: float) -> str | None:
        joints = len(self.skeleton)
        if np.shape(positions) != (joints, 3) or (rotations is not None and np.shape(rotations) != (joints, 4)):
            raise UsageError(
                f"a frame of {joints} joints has positions ({joints}, 3) and rotations ({joints}, 4) or None"
            )
        if not (positions.min() > -FARTHEST and positions.max() < FARTHEST and isfinite(time)):
            return "not finite"
        if rotations is not None:
            largest = np.abs(rotations).max(axis=1)
            if not (largest.min() > SHORTEST and largest.max() < inf):
                return "not finite"
        if self._last is not None and time <= self._last.time:
            return "not after the one before"
        return None


def stream(
    robot: Robot | str | Path,
    frames: Motion | str | Path | Iterable[tuple[Any, ...]],
    skeleton: Skeleton | None = None,
    **options: Any,
) -> Iterator[Floats]:
    """Yield configurations (nq,) one at a time, each from the frames until then.

    Args:
        robot: a robot, or a name or model file that `load_robot` loads.
        frames: a motion or its file, which is also its calibration and is followed at its own rate; or positions (J, 3) [m],
            rotations (J, 4) or None, time [s] of a skeleton's joints and, if bodies move, their poses by name.
        options: those of `Stream`. Bodies of a scene around a motion move as the scene states.

    Raises:
        UsageError: frames come without a skeleton.
        MatchError: the frames show no human.
        SceneError: a body does not fit the motion.
    """
    if isinstance(frames, Motion | str | Path):
        motion = among(as_motion(frames), options.pop("scene", None), options.pop("scene_scale", None))
        options.setdefault("calibration", motion)
        options["scene"] = motion.scene
        skeleton, frames = motion.skeleton, _frames_of(motion)
    if skeleton is None:
        raise UsageError("frames alone do not say whose joints they are: give the skeleton too")
    live = Stream(robot, skeleton, **options)
    for positions, rotations, time, *poses in frames:
        yield live.push(positions, rotations, time=time, poses=poses[0] if poses else None).qpos


def _frames_of(motion: Motion) -> Iterator[tuple[Floats, Floats | None, float, Mapping[str, Floats]]]:
    turns: Iterable[Floats | None] = motion.rotations if motion.rotations is not None else repeat(None)
    for t, (positions, rotations) in enumerate(zip(motion.positions, turns, strict=False)):
        yield positions, rotations, t / motion.fps, motion.poses_at(t)
