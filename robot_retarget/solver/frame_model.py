"""The quadratic model of one frame: the formulas of `quadratic` without arrays over frames, which would cost a stream half its time."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.rows import ContactRows
from robot_retarget.solver.problem import EdgeTargets
from robot_retarget.solver.quadratic import CostModel, Proximal, diagonal
from robot_retarget.solver.stencils import Neighbours


@dataclass(frozen=True, eq=False)
class FrameModel:
    """cost + 2 gᵀv + vᵀNv for small steps v, with rows v ≥ row_lower; the last variable is the slack of separation."""

    cost: float
    """Without the terms of proximal and neighbours."""
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


def frame_model(
    costs: CostModel, q: Floats, targets: EdgeTargets, proximal: Proximal | None, around: Neighbours | None
) -> FrameModel:
    """Return the model at a configuration (nq,).

    Args:
        costs: of the problem.
        q: (nq,).
        targets: of the frame.
        proximal: draws the pose towards another; None for no such term.
        around: the frames that costs join with this one; None without any.
    """
    cost, gradient, normal = costs.problem.model(q, targets)
    slope, deficit = costs.problem.inequalities.rows(q, targets)
    near = costs.measured(q[None], targets.clip)
    apart, lacking = costs.row_lower(near.deficit), float(costs.lacking(near.deficit))
    own = costs.terms(q, targets)
    joining = costs.joining(ContactRows(near.slope, apart), q, around) if around is not None and costs.offsets else ()
    total = float(cost) + costs.options.overlap_cost * lacking**2 + sum(float(term[0]) for term in own)
    for _, pull, weight in (*own, *joining):
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
