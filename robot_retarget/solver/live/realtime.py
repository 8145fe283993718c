"""The real-time iteration: one frame after the other, each by a step or two from the prediction of the frames before.

    minimise  Σ π ϱ(e) + Σ w ‖q ⊖ (q₁ ⊕ β h v₁)‖²

with q₁ the pose before, v₁ its velocity and h the time since. The second term is the second-difference edge to the two
frames before, made independent of the rate. With its w and β, the pose follows an edge of π = 1/rad² like a mass m on a
spring and a damper, m ẍ = −(x − y) − c ẋ, sampled exactly every h.
"""

from collections import deque
from collections.abc import Callable
from math import cos, exp, pi, sqrt

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.track import CAUSAL_DIFFERENCE, Status
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solver.descent import Box, FrameSolution
from robot_retarget.solver.honoured import FARTHEST
from robot_retarget.solver.live.basin_escape import BasinEscape
from robot_retarget.solver.options import RealTime
from robot_retarget.solver.problem import EdgeTargets
from robot_retarget.solver.quadratic import Proximal
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.stencils import Neighbours


class RealTimeSolver:
    """A pose that follows its targets; it remembers the pose before and its velocity."""

    solver: FrameSolver
    robot: Robot
    options: RealTime

    def __init__(self, solver: FrameSolver, options: RealTime):
        """Follow with one solver; its tracks define the inertia."""
        self.solver, self.robot, self.options = solver, solver.robot, options
        dofs, free = solver.roots, self.robot.floating
        self.root: Floats = np.full(len(dofs), options.root_turn)
        self.root[: 3 if free else 0] = options.root_speed
        self.home: BasinEscape = BasinEscape(solver, options)
        self.pose: FrameSolution | None = None
        self.before: deque[Floats] = deque(maxlen=FARTHEST)
        """Configurations (nq,) of the latest frames, the latest first."""
        self.velocity: Floats = np.zeros(self.robot.model.nv)
        """(nv,) velocity of the pose [rad/s, m/s]."""
        self.pace: float = 1.0
        """The usable share of the joints' speeds [-]."""

    def begin(self, start: Floats, targets: EdgeTargets) -> FrameSolution:
        """Return the first pose, independent of earlier frames."""
        pose = self.solver.solve_frame(start, targets, iterations=self.options.start)
        return self._kept(self.solver.raise_above_floor(pose, targets), np.zeros_like(self.velocity))

    def stand(self, qpos: Floats, targets: EdgeTargets) -> FrameSolution:
        """Return the first pose at rest in a stand; later steps move it towards the targets."""
        pose = self.solver.raise_above_floor(FrameSolution(qpos, Status.CALIBRATING, 0.0, 0), targets)
        self.home.move_home(pose.qpos, targets, pose.qpos)
        return self._kept(pose, np.zeros_like(self.velocity))

    @property
    def qpos(self) -> Floats:
        """(nq,) configuration of the latest pose."""
        assert self.pose is not None
        return self.pose.qpos

    def step(self, targets: EdgeTargets, seconds: float, standing: Callable[[], Floats]) -> FrameSolution:
        """Return the next pose.

        Args:
            targets: of the frame.
            seconds: time since the previous pose [s].
            standing: returns the standing pose (nq,) at the human's place.
        """
        options, before = self.options, self.qpos
        if seconds > options.gap:
            seconds, self.pace, self.velocity = options.gap, 0.0, np.zeros_like(self.velocity)
        self.pace = min(1.0, self.pace + seconds / options.ease)
        box = self.home.box(self._reachable(before, targets, self.pace * seconds), seconds)
        weight, kept = follower(options, seconds)
        anchor = integrate(self.robot, before, kept * seconds * self.velocity)
        anchor[self.robot.qpos_index] = anchor[self.robot.qpos_index].clip(box.lower, box.upper)
        inertia = self.solver.problem.limits.differences(targets, CAUSAL_DIFFERENCE).weight
        proximal = Proximal(anchor, np.zeros_like(self.velocity), weight * inertia)
        around = Neighbours({-1 - k: q for k, q in enumerate(self.before)}, {0: targets}, seconds)
        steps = max(1, round(options.steps * seconds))
        pose = self.solver.real_time_step(anchor, targets, proximal, box, steps, around)
        if pose.status is Status.BLOCKED:
            self.home.lead = None
            pose = self.solver.real_time_step(
                before, targets, proximal, self.solver.reachable(before, targets, seconds), 1, around
            )
        pose = self.solver.repaired(before, pose, targets)
        self.home.search_step(pose, targets, standing, seconds)
        return self._kept(pose, difference(self.robot, before, pose.qpos) / seconds)

    def _kept(self, pose: FrameSolution, velocity: Floats) -> FrameSolution:
        self.pose, self.velocity = pose, velocity
        self.before.appendleft(pose.qpos)
        return pose

    def _reachable(self, before: Floats, targets: EdgeTargets, seconds: float) -> Box:
        box = self.solver.reachable(before, targets, seconds)
        return Box(box.lower, box.upper, (before, self.root * seconds))


def follower(options: RealTime, seconds: float) -> tuple[float, float]:
    """Return w [1/rad²] and β [-] of the edge to the frames before, for this time between frames [s].

    The recursion x = (y + w (x₁ + β (x₁ − x₂))) / (1 + w) has the poles of the damped spring, e^{(−ζ ± i √(1−ζ²)) ω h}:
    their product is r β and their sum r (1 + β), with r = w / (1 + w).
    """
    turn = 2 * pi * options.frequency * seconds
    radius = exp(-options.damping * turn)
    product, total = radius**2, 2 * radius * cos(sqrt(1 - options.damping**2) * turn)
    share = max(total - product, 0.0)
    return share / (1 - share), min(max(product / share, 0.0), 1.0) if share > 0 else 0.0
