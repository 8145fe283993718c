"""One calibrated performer and robot: derives the targets of each frame, solves them and returns the pose."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.describe import CausalTargets, RobotGraph
from robot_retarget.graph.placed_scene import RootScaling, root_scaling_of
from robot_retarget.graph.soles import placed_feet
from robot_retarget.graph.track import Status
from robot_retarget.human.causal import CausalFeatures, CausalSurroundings
from robot_retarget.human.features import HumanFeatures
from robot_retarget.robot.dynamics import Placer
from robot_retarget.robot.kinematics import PlacedPoints
from robot_retarget.robot.support import CORNERS, sole_corners, together
from robot_retarget.scene.scene import Scene
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.live.lag import FixedLag, SolvedFrame
from robot_retarget.solver.live.realtime import RealTimeSolver
from robot_retarget.solver.options import RealTime
from robot_retarget.solver.problem import EdgeTargets, Problem, build_problem
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.starts import root_placer

FIRST = 1 / 30
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
        self.lag: FixedLag | None = FixedLag(frames, lag, options) if lag else None
        soles = together([sole_corners(match.anatomy, foot) for foot in placed_feet(match, graph.robot)])
        self.corners: PlacedPoints = PlacedPoints(graph.robot, soles)
        self.stood: Placer = root_placer(graph.robot, match.anatomy, graph.robot.standing())
        self.targets: EdgeTargets | None = None
        self.latest: HumanFeatures | None = None

    def begin(self, frame: StreamInput, standing: bool) -> StreamPose:
        """Return the first pose: the performer's, or the standing pose, which then eases into the motion."""
        human = self._read(frame, FIRST)
        start = self._standing(human)
        self.targets = self._targets_at(human, start, FIRST)
        pose = self.solver.stand(start, self.targets) if standing else self.solver.begin(start, self.targets)
        return self._given(pose, frame.time, FIRST)

    def follow(self, frame: StreamInput, since: float) -> StreamPose:
        """Return the pose for a frame, `since` seconds after the one before."""
        self.targets = self._targets_at(self._read(frame, since), self.solver.qpos, since)
        return self._given(self._stepped(since), frame.time, since)

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

    def _targets_at(self, human: HumanFeatures, qpos: Floats, seconds: float) -> EdgeTargets:
        targets = self.all_targets.at(human, self.corners.at(qpos).reshape(-1, CORNERS, 3), seconds)
        return EdgeTargets(*(np.array(each) for each in targets)) if self.lag else EdgeTargets(*targets)
