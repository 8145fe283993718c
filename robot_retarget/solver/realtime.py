"""The real-time iteration: one frame after the other, each by a step or two from the prediction of the frames before.

    minimise  Σ π ϱ(e) + Σ w ‖q ⊖ (q₁ ⊕ β h v₁)‖²

with q₁ the pose before, v₁ its velocity and h the time since. The second term is the second-difference edge to the two
frames before, made independent of the rate. With its w and β, the pose follows an edge of π = 1/rad² like a mass m on a
spring and a damper, m ẍ = −(x − y) − c ẋ, sampled exactly every h.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, exp, pi, sqrt

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, smoothstep
from robot_retarget.graph.track import CAUSAL_DIFFERENCE, THIRD_DIFFERENCE, Status
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solver.clip_model import ClipProblem, clip_of
from robot_retarget.solver.descent import Box, FrameSolution
from robot_retarget.solver.limits import Targets
from robot_retarget.solver.minimum import ClipMinimum
from robot_retarget.solver.near_links import NearLinks
from robot_retarget.solver.one_thread import ONE_THREAD
from robot_retarget.solver.options import RealTime, Smoothing
from robot_retarget.solver.quadratic import Proximal
from robot_retarget.solver.sqp import FrameSolver

# The home pose of a frame: the end of a descent from the standing pose, independent of the past.
#
# The pose that follows the performer stays in its basin of attraction. In parallel, a second pose starts from the
# standing pose repeatedly and advances one step at a time. Where it reaches the first, mostly after two to four steps, it rests
# until the next start. If it ends elsewhere and costs clearly less, the hinges that differ move to it along a smooth curve in
# time, and all other hinges follow their targets.

LED = 0.25
"""Hinges move to the home pose if they differ by more than this share of the basin threshold (`RealTime.same`), and without
such hinges the second pose has reached the first [-]; the mean limb error of streams of a clap and a kick on the G1 is 12.5°
with half, 12.5° with it and 15.2° with double ..."""
GIVE = 0.1
"""... and may deviate from their curve by this share of it, so that the other targets keep their effect [-]. That error is
13.0° with half and 12.4° with double."""
ROUNDING = 0.99
"""Each frame takes one step when frames arrive at the step rate, for any rounding of their times [-]."""


@dataclass(eq=False)
class HomeTransition:
    """A transition to the home pose."""

    hinges: np.ndarray
    """(n,) whether a hinge takes part."""
    since: Floats
    """(n,) angles at the start [rad]."""
    lasts: float
    """Duration [s]."""
    gone: float = 0.0
    """Elapsed time [s]."""

    @property
    def arrived(self) -> bool:
        """Whether the duration is over."""
        return self.gone >= self.lasts

    def around(self, box: Box, home: Floats, slack: float) -> Box:
        """Return the box with the moving hinges on their curve to the home angles (n,), as far as the box allows."""
        share = smoothstep(min(self.gone / self.lasts, 1.0))
        aim = np.clip((1 - share) * self.since + share * home, box.lower, box.upper)
        lower = np.where(self.hinges, np.maximum(aim - slack, box.lower), box.lower)
        upper = np.where(self.hinges, np.minimum(aim + slack, box.upper), box.upper)
        return Box(lower, upper, box.root)


class BasinEscape:
    """Search for the home pose of a stream, and move to it."""

    solver: FrameSolver
    options: RealTime
    steps: int
    waited: float

    def __init__(self, solver: FrameSolver, options: RealTime):
        self.solver, self.options = solver, options
        self.pose: FrameSolution | None = None
        """The second pose; None while it rests."""
        self.steps, self.waited = options.home_steps, 0.0
        self.lead: HomeTransition | None = None

    def move_home(self, standing: Floats, targets: Targets, before: Floats) -> None:
        """Descend from a standing pose to the home pose, and start the transition to it."""
        self.pose = self.solver.solve_frame(standing, targets, iterations=self.options.start)
        self._set_out(before, targets)

    def search_step(
        self, current: FrameSolution, targets: Targets, standing: Callable[[], Floats], seconds: float
    ) -> None:
        """Take one step of the search if it is due; start the transition when the home pose is found and cheaper."""
        self.waited += seconds
        if self.waited < ROUNDING / self.options.home_rate:
            return
        self.waited, there = 0.0, self.steps >= self.options.home_steps and self.lead is None
        if there and self.pose is not None and self._better(self.pose, current):
            self._set_out(current.qpos, targets)
        elif there:
            self.pose, self.steps = FrameSolution(standing(), current.status, np.inf, 0), 0
        self.steps += 1
        if self.pose is not None:
            self.pose = self.solver.real_time_step(self.pose.qpos, targets, None, self.solver.ranges(targets), 1)
            if self.lead is None and not self._leads(self._way(current.qpos)).any():
                self.pose = None

    def box(self, box: Box, seconds: float) -> Box:
        """Return the box with the moving hinges on their curves."""
        if self.lead is None or self.pose is None:
            return box
        self.lead.gone += seconds
        led = self.lead.around(box, self.pose.qpos[self.solver.robot.qpos_index], GIVE * self.options.same)
        if self.lead.arrived:
            self.lead, self.steps = None, self.options.home_steps
        return led

    def _better(self, home: FrameSolution, current: FrameSolution) -> bool:
        apart = self._way(current.qpos).max(initial=0.0)
        return bool(apart > self.options.same and home.cost < self.options.worth * current.cost)

    def _way(self, qpos: Floats) -> Floats:
        """Return how far each hinge (n,) of a configuration is from the second pose [rad]."""
        assert self.pose is not None
        return np.abs(self.pose.qpos - qpos)[self.solver.robot.qpos_index]

    def _leads(self, way: Floats) -> Bools:
        """Return which hinges (n,) would move to the second pose."""
        return way > LED * self.options.same

    def _set_out(self, before: Floats, targets: Targets) -> None:
        way = self._way(before)
        hinges = self._leads(way)
        if hinges.any():
            needed = (way / self.solver.problem.limits.bounds(targets).speed)[hinges].max() / self.options.unhurried
            since = before[self.solver.robot.qpos_index]
            self.lead = HomeTransition(hinges, since, max(float(needed), self.options.ease))


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
        self.velocity: Floats = np.zeros(self.robot.model.nv)
        """(nv,) velocity of the pose [rad/s, m/s]."""
        self.pace: float = 1.0
        """The usable share of the joints' speeds [-]."""

    def begin(self, start: Floats, targets: Targets) -> FrameSolution:
        """Return the first pose, independent of earlier frames."""
        pose = self.solver.solve_frame(start, targets, iterations=self.options.start)
        return self._kept(self.solver.raise_above_floor(pose, targets), np.zeros_like(self.velocity))

    def stand(self, qpos: Floats, targets: Targets) -> FrameSolution:
        """Return the first pose at rest in a stand; later steps move it towards the targets."""
        pose = self.solver.raise_above_floor(FrameSolution(qpos, Status.CALIBRATING, 0.0, 0), targets)
        self.home.move_home(pose.qpos, targets, pose.qpos)
        return self._kept(pose, np.zeros_like(self.velocity))

    @property
    def qpos(self) -> Floats:
        """(nq,) configuration of the latest pose."""
        assert self.pose is not None
        return self.pose.qpos

    def step(self, targets: Targets, seconds: float, standing: Callable[[], Floats]) -> FrameSolution:
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
        steps = max(1, round(options.steps * seconds))
        pose = self.solver.real_time_step(anchor, targets, proximal, box, steps)
        if pose.status is Status.BLOCKED:
            self.home.lead = None
            box = self.solver.reachable(before, targets, seconds)
            pose = self.solver.real_time_step(before, targets, proximal, box, 1)
        pose = self.solver.repaired(before, pose, targets)
        self.home.search_step(pose, targets, standing, seconds)
        return self._kept(pose, difference(self.robot, before, pose.qpos) / seconds)

    def _kept(self, pose: FrameSolution, velocity: Floats) -> FrameSolution:
        self.pose, self.velocity = pose, velocity
        return pose

    def _reachable(self, before: Floats, targets: Targets, seconds: float) -> Box:
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


# A lag: the frames that wait are a short clip after the poses that were returned.

GIVEN = len(THIRD_DIFFERENCE) - 1
"""Number of returned poses before the frames that wait: third differences span as many more than the frame."""


@dataclass(frozen=True, eq=False)
class SolvedFrame:
    """A frame of a stream after the real-time iteration."""

    pose: FrameSolution
    targets: Targets
    time: float
    seconds: float
    """Time since the frame before [s]."""


class FixedLag:
    """Return poses `lag` frames late: with every frame, the clip of those that wait takes a step towards its minimum."""

    def __init__(self, solver: FrameSolver, lag: int, options: RealTime, fps: float):
        """Set the lag in frames, and the rate [1/s] at which the solver's tracks define differences."""
        self.solver, self.lag, self.options, self.fps = solver, lag, options, fps
        self.waiting: deque[SolvedFrame] = deque()
        self.path: list[Floats] = []
        """(nq,) of the poses that were returned last, at most `GIVEN`, and of the frames that wait."""
        self.near: NearLinks | None = None

    @ONE_THREAD
    def smoothed(self, newest: SolvedFrame) -> tuple[FrameSolution, float]:
        """Return the pose of the oldest waiting frame, and its time [s].

        Until `lag` frames wait, the first pose is returned repeatedly.
        """
        self.waiting.append(newest)
        self.path = [*(self.path or [newest.pose.qpos]), newest.pose.qpos]
        first, known = self.waiting[0], len(self.path) - len(self.waiting)
        minimum = ClipMinimum(self._clip(known), np.array(self.path), self.near)
        minimum.damping[-1] = self.options.drawn
        minimum.step()
        self.path, self.near = [*minimum.clip.limited(minimum.qpos)], minimum.model.frames.near
        before = self.path[known - 1]
        if len(self.waiting) <= self.lag:
            return replace(first.pose, qpos=before), first.time
        pose = self.solver.closed(replace(first.pose, qpos=self.path[known]))
        pose = self.solver.repaired(before, pose, first.targets)
        self.waiting.popleft()
        self.path[known], self.near = pose.qpos, self.near.of(np.arange(1, len(self.near)))
        self.path = self.path[-self.lag - GIVEN :]
        return pose, first.time

    def _clip(self, known: int) -> ClipProblem:
        """Return the clip of the frames that wait, after a number of known ones."""
        frames = [self.waiting[0]] * known + [*self.waiting]
        sides = zip(*(vars(solved.targets).values() for solved in frames), strict=True)
        seconds = np.minimum([solved.seconds for solved in frames], self.options.gap)
        clip = clip_of(self.solver, Targets(*map(np.array, sides)), Smoothing(), 1 / seconds.mean(), known)
        differences = tuple(each.at_rate(clip.fps / self.fps) for each in clip.differences)
        seconds[known] = seconds[-1]  # this frame is returned now
        return replace(clip, differences=differences, reach=clip.bounds.speed * seconds[:, None])
