"""Solve a clip: frame by frame as it comes, or as a whole, a sketch first and then the smooth path all frames agree on."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.retarget.edges import Edges
from robot_retarget.retarget.footing import CORNERS, Stepping, footholds, held_corners
from robot_retarget.retarget.frame import Box, FrameSolver, Options, Pose
from robot_retarget.retarget.problem import Problem, frame_parameters
from robot_retarget.retarget.quadratic import Ahead, Pull
from robot_retarget.retarget.sketch import sketch
from robot_retarget.retarget.smooth import smooth_offsets
from robot_retarget.retarget.solution import Solution, Status
from robot_retarget.retarget.starts import ways
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.model import FREE, SLIDE
from robot_retarget.trajectory import Trajectory

Progress = Callable[[int, int], None]
"""Told (frames done, frames in all)."""


PASS_TOLERANCE = 1e-5
"""A pass leaves a frame alone that it could better by a smaller share of its cost [-]."""


SETTLED = 0.01
"""A frame that the last pass moved by less counts as converged [rad or m]."""


OVERLAP = 5e-4
"""Links inside each other by more are not accepted without a full descent [m]."""


@dataclass(frozen=True)
class Smoothing:
    """How the whole clip is brought to agree with a smooth path (`clip_passes`)."""

    passes: int = 8
    weight: float = 40.0
    """ρ, how strongly a frame is drawn to the smooth path [1/rad²]."""
    root: float = 10.0
    """How much more the root is drawn, per rad² and per squared leg length [-]."""
    stiffness: float = 20.0
    """Weight of squared second differences, at 30 frames a second [1/rad²]."""


def solve(
    problem: Problem,
    edges: Edges,
    fps: float,
    source: str = "",
    options: Options | None = None,
    smoothing: Smoothing | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Solve the clip as a whole; with `smoothing.passes` = 0 frame by frame, each from the one before.

    Args:
        fps: frames per second of the edges.
        progress: called with (frames done, frames in all), all passes counted.
    """
    began = time.perf_counter()
    chosen, smoothly = options or Options(), smoothing or Smoothing()
    solver = FrameSolver(problem, chosen)
    held = held_corners(edges.stances if chosen.footholds else {}, problem.feet, len(edges))
    count = _Count(progress, len(edges) * max(smoothly.passes, 1))
    if smoothly.passes == 0 or len(edges) < 3:
        poses, drafted = causal_pass(solver, edges, held, fps, count), time.perf_counter() - began
    else:
        draft = sketch(solver, edges, held, fps)
        drafted = time.perf_counter() - began
        poses = clip_passes(solver, edges, held, draft, smoothly, fps, count)
    spent = time.perf_counter() - began
    return _solution(problem, edges, poses, fps, source, {"draft": drafted, "refine": spent - drafted, "solve": spent})


def causal_pass(solver: FrameSolver, edges: Edges, held: np.ndarray, fps: float, count: "_Count") -> list[Pose]:
    """Each frame from the one before; a foot that begins to stand stays where it was."""
    robot, stepping, poses = solver.robot, Stepping(held), []
    before = ways(solver, (*frame_parameters(edges, 0), *solver.grip.lay_down(held[0])), edges, 0)[0].qpos
    for t in range(len(edges)):
        holds = solver.grip.hold(*stepping.at(t, _corners(solver.problem, before)))
        neighbours = [before[robot.qpos_index]] if t else []
        box = solver.ranges.around(neighbours, robot.max_speed / fps)
        start = _onward(robot, poses, box) if t > 1 else before
        wished = (*frame_parameters(edges, t), *holds)
        poses.append(solver.lifted(solver.descend(start, wished, box=box)))
        before = poses[-1].qpos
        count.one()
    return poses


def _onward(robot: Robot, poses: list[Pose], box: Box) -> Floats:
    """Where the last two poses lead to by the next frame, as far as the box allows."""
    before, last = poses[-2].qpos, poses[-1].qpos
    start = integrate(robot, last, difference(robot, before, last))
    start[robot.qpos_index] = np.clip(start[robot.qpos_index], box.lower, box.upper)
    return start


def clip_passes(
    solver: FrameSolver,
    edges: Edges,
    held: np.ndarray,
    draft: list[Floats],
    smoothing: Smoothing,
    fps: float,
    count: "_Count",
) -> list[Pose]:
    """Alternate between frames drawn to a smooth path and the smooth path through the frames.

    The method of multipliers on  Σ f_t(q_t) + S(s)  subject to  q_t = s_t:  every pass moves each frame once against
    ρ‖q_t ⊖ s_t + y_t‖², then the path s, then the multipliers y. What the frames keep (ranges and floor exactly,
    footholds and separation as far as their weights carry) is kept in what is returned: the frames, not the path.
    Joint speeds are kept between the frames as they are; a draft that leaps further is not always brought under them.
    """
    robot, weight = solver.robot, _pull_weights(solver, smoothing)
    places = footholds(held, np.array([_corners(solver.problem, q) for q in draft]))
    wished = [
        (*frame_parameters(edges, t), *solver.grip.lead(h, p))
        for t, (h, p) in enumerate(zip(held, places, strict=True))
    ]
    poses = [Pose(q, Status.OUT_OF_ITERATIONS, np.inf, 0) for q in draft]
    dual = np.zeros((len(poses), robot.model.nv))
    stiffness = smoothing.stiffness * (fps / 30) ** 4 / smoothing.weight
    path = draft
    for _ in range(smoothing.passes):
        moved = np.array([integrate(robot, p.qpos, y) for p, y in zip(poses, dual, strict=True)])
        path = _smooth_path(solver, moved, stiffness)
        dual += [difference(robot, s, p.qpos) for s, p in zip(path, poses, strict=True)]
        for t, pose in enumerate(poses):
            box, pull = _reachable(solver, poses, t, fps), Pull(path[t], -dual[t], weight)
            ahead = _ahead(solver.options, poses, t, fps)
            after = solver.descend(
                pose, wished[t], pull=pull, ahead=ahead, iterations=1, tolerance=PASS_TOLERANCE, box=box
            )
            poses[t] = _resumed(pose, after, robot)
            count.one()
    for t in _still_overlapping(solver, poses):
        pull, box = Pull(path[t], -dual[t], weight), _reachable(solver, poses, t, fps)
        poses[t] = solver.descend(poses[t].qpos, wished[t], pull=pull, box=box)
    return [solver.lifted(pose) for pose in poses]


def _ahead(options: Options, poses: list[Pose], t: int, fps: float) -> Ahead | None:
    """The interaction edges of a frame: what its step from the frame before leads to."""
    if options.interaction == 0 or t == 0:
        return None
    return Ahead(poses[t - 1].qpos, options.horizon * fps, options.interaction)


def _resumed(before: Pose, after: Pose, robot: Robot) -> Pose:
    """A pose after one more pass: converged when that pass hardly moved it; iterations add up."""
    moved = float(np.abs(difference(robot, before.qpos, after.qpos)).max())
    status = Status.CONVERGED if moved < SETTLED else after.status
    return replace(after, status=status, iterations=before.iterations + after.iterations)


def _smooth_path(solver: FrameSolver, moved: Floats, stiffness: float) -> list[Floats]:
    """The smooth path nearest to configurations: s = q ⊕ δ with the offsets of `smooth_offsets`."""
    speed = np.array([difference(solver.robot, a, b) for a, b in pairwise(moved)])
    offsets = smooth_offsets(speed, stiffness)
    return [integrate(solver.robot, q, d) for q, d in zip(moved, offsets, strict=True)]


def _reachable(solver: FrameSolver, poses: list[Pose], t: int, fps: float) -> Box:
    """What the hinges can be at a frame between its neighbours, at their speeds."""
    index = solver.robot.qpos_index
    neighbours = [poses[k].qpos[index] for k in (t - 1, t + 1) if 0 <= k < len(poses)]
    return solver.ranges.around(neighbours, solver.robot.max_speed / fps)


def _still_overlapping(solver: FrameSolver, poses: list[Pose]) -> list[int]:
    """Frames whose links the passes left inside each other; they get a full descent."""
    if solver.landscape.separation is None:
        return []
    return [t for t, pose in enumerate(poses) if solver.landscape.separation.depth(pose.qpos) > OVERLAP]


def _pull_weights(solver: FrameSolver, smoothing: Smoothing) -> Floats:
    """ρ per tangent direction: the root carries everything, so it is drawn more; its travel counts in leg lengths."""
    robot = solver.robot
    weight = np.full(robot.model.nv, smoothing.root * smoothing.weight)
    for joint in robot.root_joints:
        first = int(robot.model.jnt_dofadr[joint])
        slide = robot.model.jnt_type[joint] in (FREE, SLIDE)
        weight[first : first + 3 if robot.floating else first + 1] *= 1 / solver.leg**2 if slide else 1.0
    weight[solver.hinges] = smoothing.weight
    return weight


class _Count:
    """Counts frames towards a progress report."""

    def __init__(self, progress: Progress | None, total: int):
        self.progress, self.total, self.done = progress, total, 0

    def one(self) -> None:
        self.done += 1
        if self.progress:
            self.progress(self.done, self.total)


def _corners(problem: Problem, qpos: Floats) -> Floats:
    """(F, 4, 3) the soles' corners [m]."""
    return problem.corners(qpos)[0].reshape(len(problem.feet), CORNERS, 3)


def _solution(
    problem: Problem, edges: Edges, poses: list[Pose], fps: float, source: str, timings: dict[str, float]
) -> Solution:
    qpos = np.array([p.qpos for p in poses])
    errors = np.array([np.abs(problem.stress(q, edges.distance[t])[0]) for t, q in enumerate(qpos)])
    trajectory = Trajectory(qpos, fps, problem.robot.joint_names, problem.robot.name, source)
    return Solution(
        trajectory,
        tuple(p.status for p in poses),
        np.array([p.cost for p in poses]),
        errors,
        tuple(edges.labels),
        np.array([p.iterations for p in poses]),
        timings,
    )
