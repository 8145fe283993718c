"""The state of descents: the boxes that steps stay in, trust regions, and the frames on their way to a minimum.

`frame_model` is the quadratic model of one frame: the formulas of `quadratic` without arrays over frames. With those a frame of a
stream has the same result, bit by bit, and takes 8–39 % longer (G1, OP3).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.graph.track import Status
from robot_retarget.solver.limits import Targets
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.quadratic import Between, CostModel, Proximal, Quadratic, diagonal


@dataclass(frozen=True)
class Box:
    """The interval of each hinge at a frame, or at N frames: its range, cut to the reach of its neighbours in time."""

    lower: Floats
    upper: Floats
    """(…, n)."""
    root: tuple[Floats, Floats] | None = None
    """A configuration (nq,), and the largest distance of the root from it (R,) per tangent direction [m, rad]; None
    leaves it free."""

    def around(self, neighbours: Sequence[tuple[Floats, Floats]]) -> "Box":
        """Return the box within reach of every neighbour, given by angles and reach (…, n); where two are too far apart, the angle halfway."""
        lower, upper = self.lower, self.upper
        for angles, reach in neighbours:
            lower, upper = np.maximum(lower, angles - reach), np.minimum(upper, angles + reach)
        middle = (lower + upper) / 2
        return Box(np.where(lower > upper, middle, lower), np.where(lower > upper, middle, upper))

    def outside(self, angles: Floats) -> Floats:
        """How far an angle is out of the box (…) [rad]: a step into it is accepted at any cost unless links meet."""
        return np.maximum(self.lower - angles, angles - self.upper).max(axis=-1, initial=0.0)

    def at(self, frames: Ints | None) -> "Box":
        """Return the box of some frames; None makes that of a clip of one frame."""
        return Box(self.lower[frames], self.upper[frames], self.root)


@dataclass(frozen=True, eq=False)
class FrameSolution:
    """The end of a descent."""

    qpos: Floats
    status: Status
    cost: float
    """The cost before the last step, which was too small to be evaluated."""
    iterations: int
    clearance_deficit: float = 0.0
    """How much the nearest links lacked to be apart at the last evaluation, over the leg."""


class TrustRegions:
    """The trust regions of N descents, with their counts of accepted and refused steps (Levenberg–Marquardt)."""

    def __init__(self, options: SolveOptions, frames: int):
        self.longest, self.growth = options.trust_region, options.growth
        self.radius, self.damping = np.full(frames, self.longest), np.full(frames, options.damping)
        self.taken, self.refused = np.zeros(frames, int), np.zeros(frames, int)

    def take(self, frames: Ints) -> None:
        """Widen the regions of frames whose step is accepted."""
        self.damping[frames] = np.maximum(self.damping[frames] / 4, 1e-6)
        self.radius[frames] = np.minimum(self.longest, self.growth * self.radius[frames])
        self.taken[frames] += 1
        self.refused[frames] = np.maximum(self.refused[frames] - 1, 0)

    def refuse(self, frames: Ints, step: Floats) -> None:
        """Narrow the regions of frames whose step (F, nv) is refused."""
        self.damping[frames] = self.damping[frames] * 10 + 1e-2
        self.radius[frames] = 0.3 * np.minimum(self.radius[frames], np.abs(step).max(axis=1))
        self.refused[frames] += 1


@dataclass(eq=False)
class Descent:
    """N frames on their way to a minimum, each independent of the others."""

    qpos: Floats
    """(N, nq)."""
    targets: Targets
    base: Quadratic
    """The model at `qpos`, of the costs of single frames."""
    regions: TrustRegions
    box: Box
    proximal: Proximal | None = None
    between: Between | None = None
    tolerance: float = 0.0
    status: np.ndarray = field(init=False)
    """(N,) of `Status`."""
    entering: Bools = field(init=False)
    """(N,) whether a frame has not yet been inside its box."""
    last: dict[int, Floats] = field(default_factory=dict)
    """The steps that are too small to be evaluated."""

    def __post_init__(self) -> None:
        self.status = np.full(len(self.qpos), Status.OUT_OF_ITERATIONS)
        self.entering = np.ones(len(self.qpos), dtype=bool)

    def at(self, frames: Ints) -> tuple[Targets, Between | None]:
        """Return targets and ways of some frames."""
        if len(frames) == len(self.qpos):
            return self.targets, self.between
        between = None if self.between is None else [self.between[k] for k in frames.tolist()]
        return self.targets.at(frames), between


@dataclass(frozen=True, eq=False)
class FrameModel:
    """cost + 2 gᵀv + vᵀNv for small steps v, with rows v ≥ row_lower; the last variable is the slack of separation."""

    cost: float
    """Without the proximal term."""
    gradient: Floats
    """g (nv,)."""
    normal: Floats
    """N (nv, nv)."""
    rows: Floats
    """(R, nv + 1)."""
    row_lower: Floats
    """(R,)."""
    clearance_deficit: float
    """How much more than the tolerance the nearest links lack to their margin, over the leg."""


def frame_model(costs: CostModel, q: Floats, targets: Targets, proximal: Proximal | None) -> FrameModel:
    """Return the model at a configuration (nq,).

    Args:
        costs: of the problem.
        q: (nq,).
        targets: of the frame.
        proximal: draws the pose towards another; None without this term.
    """
    cost, gradient, normal = costs.problem.model(q, targets)
    slope, deficit = costs.problem.inequalities.rows(q, targets)
    near = costs.measured(q[None], targets.at(None))
    apart, lacking = costs.row_lower(near.deficit), float(costs.lacking(near.deficit))
    own = costs.terms(q, targets)
    total = float(cost) + costs.options.overlap_cost * lacking**2 + sum(float(term[0]) for term in own)
    for _, pull, weight in own:
        gradient, normal = gradient + pull, normal + weight
    if proximal is not None:
        gradient += proximal.weight * proximal.change(costs.robot, q)
        diagonal(normal)[:] += proximal.weight
    return FrameModel(total, gradient, normal, _rows(slope, near.slope), np.concatenate([deficit, apart]), lacking)


def _rows(hard: Floats, soft: Floats) -> Floats:
    """Return rows (R, nv + 1) of slopes (…, nv) that must hold, and of those that the slack relaxes."""
    count, nv = hard.shape
    rows = np.empty((count + len(soft), nv + 1))
    rows[:count, :nv], rows[count:, :nv] = hard, soft
    rows[:count, nv], rows[count:, nv] = 0.0, 1.0
    return rows
