"""The whole clip at once: a sketch first, then the smooth path all frames agree on, window by window."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.retarget.accord import in_accord
from robot_retarget.retarget.edges import Edges
from robot_retarget.retarget.footing import footholds, led
from robot_retarget.retarget.frame import Box, FrameSolver, Options, Pose
from robot_retarget.retarget.problem import frame_parameters
from robot_retarget.retarget.progress import Count
from robot_retarget.retarget.quadratic import Ahead, Pull
from robot_retarget.retarget.sketch import sketch
from robot_retarget.retarget.smooth import smooth_offsets
from robot_retarget.retarget.solution import Status
from robot_retarget.retarget.speeds import within_speeds
from robot_retarget.retarget.windows import Windows
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate

PASS_TOLERANCE = 1e-5
"""A pass leaves a frame alone that it could better by a smaller share of its cost [-]."""
SETTLED = 0.01
"""A frame that the last pass moved by less counts as converged [rad or m]."""


@dataclass(frozen=True)
class Smoothing:
    """How the whole clip is brought to agree with a smooth path (`clip_passes`)."""

    passes: int = 8
    weight: float = 40.0
    """ρ, how strongly a frame is drawn to the smooth path [1/rad²]."""
    root: float = 10.0
    """How much more the root is drawn, per rad² and per m² [-]."""
    stiffness: float = 20.0
    """Weight of squared second differences, at 30 frames a second [1/rad²]."""
    windows: Windows = field(default_factory=Windows)
    """How a long clip is cut."""


def clip_poses(
    solver: FrameSolver, edges: Edges, held: np.ndarray, smoothing: Smoothing, fps: float, count: Count
) -> list[Pose]:
    """Sketch and smooth every window after the one before."""
    poses: list[Pose] = []
    for window in smoothing.windows.cut(len(edges), fps):
        span = slice(window.first, window.last)
        part, known = edges.window(span), poses[window.first :]
        draft = sketch(solver, part, held[span], fps, known=[pose.qpos for pose in known])
        solved = clip_passes(solver, part, held[span], draft, smoothing, fps, count, fixed=window.fixed)
        poses += solved[window.fixed : window.final - window.first]
    return poses


def clip_passes(
    solver: FrameSolver,
    edges: Edges,
    held: np.ndarray,
    draft: list[Floats],
    smoothing: Smoothing,
    fps: float,
    count: Count,
    fixed: int = 0,
) -> list[Pose]:
    """Alternate between frames drawn to a smooth path and the smooth path through the frames.

    The method of multipliers on  Σ f_t(q_t) + S(s)  subject to  q_t = s_t:  every pass moves each frame once against
    ρ‖q_t ⊖ s_t + y_t‖², then the path s, then the multipliers y. What the frames keep (ranges and floor exactly,
    footholds and separation as far as their weights carry) is kept in what is returned: the frames, not the path.
    Joint speeds are kept between the frames: the draft is slowed down to them, and no step leads further from a neighbour.
    The first `fixed` frames stay as the draft has them.
    """
    robot, weight = solver.robot, _pull_weights(solver, smoothing)
    draft = _paced(solver, draft, fps, fixed)
    corners = np.array([solver.corners(q) for q in draft])
    places = led(in_accord(solver, edges, held, draft, footholds(held, corners, fixed)), held, corners, fixed)
    wished = [
        (*frame_parameters(edges, t), *solver.grip.lead(h, p))
        for t, (h, p) in enumerate(zip(held, places, strict=True))
    ]
    poses = [Pose(q, Status.OUT_OF_ITERATIONS, np.inf, 0) for q in draft]
    dual, path = np.zeros((len(poses), robot.model.nv)), draft
    stiffness = smoothing.stiffness * (fps / 30) ** 4 / smoothing.weight
    for _ in range(smoothing.passes):
        moved = np.array([integrate(robot, p.qpos, y) for p, y in zip(poses, dual, strict=True)])
        path = _smooth_path(solver, moved, stiffness, fixed)
        dual += [difference(robot, s, p.qpos) for s, p in zip(path, poses, strict=True)]
        dual[:fixed] = 0.0
        for t in range(fixed, len(poses)):
            box, pull = _reachable(solver, poses, t, fps), Pull(path[t], -dual[t], weight)
            ahead = _ahead(solver.options, poses, t, fps)
            after = solver.descend(
                poses[t], wished[t], pull=pull, ahead=ahead, iterations=1, tolerance=PASS_TOLERANCE, box=box
            )
            poses[t] = _resumed(poses[t], after, robot)
            count.one()
    pulls = [Pull(s, -y, weight) for s, y in zip(path, dual, strict=True)]
    _mend_overlaps(solver, poses, wished, pulls, fixed, fps)
    return [solver.lifted(pose) for pose in poses]


def _paced(solver: FrameSolver, draft: list[Floats], fps: float, fixed: int) -> list[Floats]:
    """The draft slowed down to the joints' speeds: whatever a pass does within the boxes then keeps them."""
    hinges, paced = solver.robot.qpos_index, np.array(draft)
    paced[:, hinges] = within_speeds(paced[:, hinges], solver.robot.max_speed / fps, fixed)
    return list(paced)


def _mend_overlaps(
    solver: FrameSolver, poses: list[Pose], wished: list[tuple[Floats, ...]], pulls: list[Pull], fixed: int, fps: float
) -> None:
    """A full descent for frames whose links the passes left inside each other; a second one without the pull, from the
    frame before, for those that the smooth path draws through each other; at last a pose on the way from the frame before.
    """
    left = _overlapping(solver, poses, range(fixed, len(poses)))
    for t in left:
        box = _reachable(solver, poses, t, fps)
        poses[t] = solver.descend(poses[t].qpos, wished[t], pull=pulls[t], box=box)
    left = _overlapping(solver, poses, left)
    for t in left:
        poses[t] = solver.descend(poses[max(t - 1, 0)].qpos, wished[t], box=_reachable(solver, poses, t, fps))
    for t in _overlapping(solver, poses, left):
        if t > 0:
            poses[t] = solver.held_back(poses[t - 1].qpos, poses[t], wished[t])


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


def _smooth_path(solver: FrameSolver, moved: Floats, stiffness: float, fixed: int) -> list[Floats]:
    """The smooth path nearest to configurations: s = q ⊕ δ with the offsets of `smooth_offsets`."""
    speed = np.array([difference(solver.robot, a, b) for a, b in pairwise(moved)]).reshape(-1, solver.robot.model.nv)
    offsets = smooth_offsets(speed, stiffness, fixed)
    return [integrate(solver.robot, q, d) for q, d in zip(moved, offsets, strict=True)]


def _reachable(solver: FrameSolver, poses: list[Pose], t: int, fps: float) -> Box:
    """What the hinges can be at a frame between its neighbours, at their speeds."""
    index = solver.robot.qpos_index
    neighbours = [poses[k].qpos[index] for k in (t - 1, t + 1) if 0 <= k < len(poses)]
    return solver.ranges.around(neighbours, solver.robot.max_speed / fps)


def _overlapping(solver: FrameSolver, poses: list[Pose], frames: Iterable[int]) -> list[int]:
    """Those of some frames whose links are inside each other."""
    return [t for t in frames if solver.overlapping(poses[t].qpos)]


def _pull_weights(solver: FrameSolver, smoothing: Smoothing) -> Floats:
    """ρ per tangent direction: the root carries everything, so it is drawn more."""
    weight = np.full(solver.robot.model.nv, smoothing.root * smoothing.weight)
    weight[solver.hinges] = smoothing.weight
    return weight
