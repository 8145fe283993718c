"""The banded matrix of a clip: a block for every frame, and the differences that couple frames.

    H = blockdiag(N_t) + Dᵀ K D

D takes second and third differences of each tangent direction, K are their weights. A row of H reaches as many frames as the
highest difference: its half-bandwidth is the order times the number of directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import get_lapack_funcs

from robot_retarget.base.arrays import Floats
from robot_retarget.solver.limits import Differences

pbtrf, pbtrs = get_lapack_funcs(("pbtrf", "pbtrs"), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class DifferenceCosts:
    """Costs  Σ κ ‖Δᵏq − b‖²  of one order k over T frames: κ and b at the frames that a difference begins at."""

    factors: Floats
    """(k + 1,) of the frames in a difference: 1 −2 1, or −1 3 −3 1."""
    weight: Floats
    bend: Floats
    """(T − k, nv)."""

    @classmethod
    def of(cls, order: int, costs: Differences, frames: int) -> "DifferenceCosts":
        """Return the costs of a clip; those of a difference stand at its second frame."""
        centre = slice(1, max(1 + frames - order, 1))
        factors = np.diff(np.eye(order + 1), order, axis=0)[0]
        return cls(
            factors, *(np.broadcast_to(side, (frames, side.shape[-1]))[centre] for side in (costs.weight, costs.bend))
        )

    def at_rate(self, share: float) -> "DifferenceCosts":
        """Return the costs of the same motion at `share` times the frame rate."""
        return replace(self, weight=self.weight * share ** (2 * self.order), bend=self.bend / share**self.order)

    @property
    def order(self) -> int:
        """The number of frames that a difference reaches beyond its first."""
        return len(self.factors) - 1

    def added(self, speed: Floats, cost: Floats, gradient: Floats) -> None:
        """Add the costs (T,) and half their gradient (T, nv) of a path with changes (T − 1, nv) from frame to frame."""
        missed = np.diff(speed, self.order - 1, axis=0) - self.bend
        force = self.weight * missed
        cost[1 : 1 + len(force)] += np.einsum("tv,tv->t", force, missed)
        for shift, factor in enumerate(self.factors):
            gradient[shift : shift + len(force)] += factor * force


class FrameCoupling:
    """Dᵀ K D: its diagonals, k frames apart."""

    def __init__(self, costs: Sequence[DifferenceCosts], frames: int, directions: int):
        """Sum the differences of all orders; those without weight take no band."""
        costs = [each for each in costs if each.weight.any()]
        self.diagonals = [
            np.zeros((frames - k, directions))
            for k in range(min(1 + max((each.order for each in costs), default=0), frames))
        ]
        """(T − k, nv) per k = 0, 1 …: between frames t and t + k."""
        for each in costs:
            for first, second in combinations_with_replacement(range(len(each.factors)), 2):
                own = each.factors[first] * each.factors[second] * each.weight
                self.diagonals[second - first][first : first + len(own)] += own

    def after(self, fixed: int) -> "FrameCoupling":
        """Return the coupling of the frames from the number `fixed` on."""
        found = FrameCoupling.__new__(FrameCoupling)
        found.diagonals = [each[fixed:] for each in self.diagonals if len(each) > fixed]
        return found

    def __matmul__(self, x: Floats) -> Floats:
        """Return the product with a step (T, nv)."""
        product = self.diagonals[0] * x
        for k, own in enumerate(self.diagonals[1:], 1):
            product[:-k] += own * x[k:]
            product[k:] += own * x[:-k]
        return product


class BandedSystem:
    """The Cholesky factor of blocks and diagonals, in the memory of one band."""

    def __init__(self, frames: int, directions: int, reach: int):
        """Allocate a band of T frames that couples frames up to `reach` apart."""
        self.frames, self.directions, self.below = frames, directions, max(reach, 1) * directions
        column, row = np.nonzero(np.add.outer(np.arange(directions), np.arange(directions)) < directions)
        self._place, self._source = column * (self.below + 1) + row, (column + row) * directions + column
        self._band = np.zeros((frames, directions * (self.below + 1)))

    def factor(self, blocks: Floats, diagonals: Sequence[Floats]) -> None:
        """Factor a positive definite matrix.

        Args:
            blocks: (T, nv, nv) on its diagonal.
            diagonals: (T − k, nv) per k = 1, 2 … between the directions of frames t and t + k.
        """
        self._band[:] = 0.0
        self._band[:, self._place] = blocks.reshape(self.frames, -1)[:, self._source]
        columns = self._band.reshape(self.frames, self.directions, self.below + 1)
        for k, own in enumerate(diagonals, 1):
            columns[: len(own), :, k * self.directions] += own
        band = columns.reshape(-1, self.below + 1).T
        self._factor, info = pbtrf(band, lower=1, overwrite_ab=1)
        if info:
            raise np.linalg.LinAlgError(f"the matrix of a clip is not positive definite (row {info})")

    def solve(self, right: Floats) -> Floats:
        """Return the solution (T, nv) for a right side (T, nv)."""
        return pbtrs(self._factor, right.reshape(-1), lower=1)[0].reshape(right.shape)
