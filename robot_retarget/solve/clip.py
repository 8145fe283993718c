"""The whole clip at once: a sketch first, then the smooth path all frames agree on, window by window."""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import Edges
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solve.accord import in_accord
from robot_retarget.solve.footing import footholds, led, near_footholds
from robot_retarget.solve.frame import FrameSolver, Options, Pose
from robot_retarget.solve.mending import Mender, Passages, beside
from robot_retarget.solve.problem import frame_parameters
from robot_retarget.solve.progress import Count
from robot_retarget.solve.quadratic import Ahead, Pull
from robot_retarget.solve.sketch import Draft, settled, sketch
from robot_retarget.solve.smooth import smooth_offsets
from robot_retarget.solve.solution import Status
from robot_retarget.solve.speeds import within_speeds
from robot_retarget.solve.windows import Windows

PASS_TOLERANCE = 1e-5
"""A pass leaves a frame alone that it could better by a smaller share of its cost [-]."""
LOOKS = (2, 4, 6)
"""Before these passes links are looked for that pass through each other between frames."""
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
    met: float = 0.05
    """Wishes that cost so little in the sketch are nearly met: half the pull (`doubts`) [-]."""
    windows: Windows = field(default_factory=Windows)
    """How a long clip is cut."""


def clip_poses(
    solver: FrameSolver, edges: Edges, held: np.ndarray, smoothing: Smoothing, fps: float, count: Count
) -> list[Pose]:
    """Sketch and smooth every window after the one before, with bones as long as the first sketch has them."""
    poses: list[Pose] = []
    paths: Floats | None = None
    for window in smoothing.windows.cut(len(edges), fps):
        span = slice(window.first, window.last)
        part, known = edges.window(span), poses[window.first :]
        draft = sketch(solver, part, held[span], fps, known=[pose.qpos for pose in known])
        if paths is None:
            paths = solver.problem.match.paths_in(solver.robot, np.array(draft.qpos))
        solved = clip_passes(solver, part.over(paths), held[span], draft, smoothing, fps, count, fixed=window.fixed)
        poses += solved[window.fixed : window.final - window.first]
    return poses


def clip_passes(
    solver: FrameSolver,
    edges: Edges,
    held: np.ndarray,
    draft: Draft,
    smoothing: Smoothing,
    fps: float,
    count: Count,
    fixed: int = 0,
) -> list[Pose]:
    """Alternate between frames drawn to a smooth path and the smooth path through the frames.

    The method of multipliers on  Σ f_t(q_t)/σ_t + S(s)  subject to  q_t = s_t:  every pass moves each frame once against
    σ_t ρ‖q_t ⊖ s_t + y_t‖², then the path s, then the multipliers y; σ are the `doubts` of the draft. What the frames keep
    (ranges and floor exactly, footholds and separation as far as their weights carry) is kept in what is returned: the
    frames, not the path.
    Joint speeds are kept between the frames: the draft is slowed down to them, and no step leads further from a neighbour.
    The first `fixed` frames stay as the draft has them.
    """
    robot, draft = solver.robot, settled(solver, edges, held, draft, fixed)
    doubt = doubts(draft.cost, smoothing.met)
    weights = doubt[:, None] * _pull_weights(solver, smoothing)
    path = _paced(solver, draft.qpos, fps, fixed)
    wished = _wished(solver, edges, held, path, doubt, fps, fixed)
    poses = [Pose(q, Status.OUT_OF_ITERATIONS, np.inf, 0) for q in path]
    dual = np.zeros((len(poses), robot.model.nv))
    stiffness = smoothing.stiffness * (fps / 30) ** 4 / smoothing.weight
    passages = Passages(solver)
    for number in range(smoothing.passes):
        if number in LOOKS:
            passages.look(poses, range(max(fixed - 1, 0), len(poses) - 1))
        moved = np.array([integrate(robot, p.qpos, y) for p, y in zip(poses, dual, strict=True)])
        path = _smooth_path(solver, moved, stiffness, fixed)
        dual += [difference(robot, s, p.qpos) for s, p in zip(path, poses, strict=True)]
        dual[:fixed] = 0.0
        for t in range(fixed, len(poses)):
            poses[t] = _stepped(solver, poses, t, wished[t], Pull(path[t], -dual[t], weights[t]), passages, fps)
            count.one()
    pulls = [Pull(s, -y, weight) for s, y, weight in zip(path, dual, weights, strict=True)]
    mended = Mender(solver, wished, pulls, passages, fixed, fps).mended(poses)
    return [solver.lifted(pose) for pose in mended]


def doubts(cost: Floats, met: float) -> Floats:
    """σ = c⁴/(c⁴ + m⁴) (T,): how much each frame is drawn to the smooth path, c being what its wishes cost in the draft.

    Wishes that no pose fulfils, of another body or of a measurement with noise, waver from frame to frame in what they
    leave, and smoothing takes that away. Where nothing is left, as of a robot's own motion, what is quick is meant.
    """
    return cost**4 / (cost**4 + met**4)


def _wished(
    solver: FrameSolver, edges: Edges, held: np.ndarray, draft: list[Floats], doubt: Floats, fps: float, fixed: int
) -> list[tuple[Floats, ...]]:
    """What is asked of each frame, with the footholds where the draft has them."""
    corners, near = np.array([solver.corners(q) for q in draft]), near_footholds(held, fps)
    places = led(in_accord(solver, edges, held, draft, footholds(held, corners, fixed)), held, corners, fixed)
    leads = [solver.grip.lead(*frame) for frame in zip(held, places, near, doubt, strict=True)]
    return [(*frame_parameters(edges, t), *lead) for t, lead in enumerate(leads)]


def _paced(solver: FrameSolver, draft: list[Floats], fps: float, fixed: int) -> list[Floats]:
    """The draft slowed down to the joints' speeds: whatever a pass does within the boxes then keeps them."""
    hinges, paced = solver.robot.qpos_index, np.array(draft)
    paced[:, hinges] = within_speeds(paced[:, hinges], solver.robot.max_speed / fps, fixed)
    return list(paced)


def _stepped(
    solver: FrameSolver,
    poses: list[Pose],
    t: int,
    wished: tuple[Floats, ...],
    pull: Pull,
    passages: Passages,
    fps: float,
) -> Pose:
    """A frame after one more step: within reach of its neighbours, and links apart on the way to them where they met."""
    after = solver.descend(
        poses[t],
        wished,
        pull=pull,
        ahead=_ahead(solver.options, poses, t, fps),
        iterations=1,
        tolerance=PASS_TOLERANCE,
        box=solver.reachable(beside(poses, t), 1 / fps),
        between=passages.between(poses, t),
    )
    return _resumed(poses[t], after, solver.robot)


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


def _pull_weights(solver: FrameSolver, smoothing: Smoothing) -> Floats:
    """ρ per tangent direction: the root carries everything, so it is drawn more."""
    weight = np.full(solver.robot.model.nv, smoothing.root * smoothing.weight)
    weight[solver.hinges] = smoothing.weight
    return weight
