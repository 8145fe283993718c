"""The non-monotone spectral projected gradient method, for many independent problems side by side.

The step 1/μ is the Barzilai–Borwein value of [Glunt1993], μ = ⟨Δg, Δz⟩ / ⟨Δz, Δz⟩; the trial point is projected on
the box, and the way to it is halved until f ≤ C + γ a ⟨g, d⟩ with the averaged reference value of [ZhangHager2004],

    Q' = η Q + 1,    C' = (η Q C + f) / Q'.

The stopping rule and the parameters are those [Mucherino2017] takes over: f or ‖d‖ below 1e-6, 10,000 iterations.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.graph.track import Status


@dataclass(frozen=True)
class Spectral:
    """Parameters of the method.

    Raises:
        UsageError: a parameter outside its range.
    """

    value_tolerance: float = 1e-6
    """Stop where f falls below it [Mucherino2017]."""
    step_tolerance: float = 1e-6
    """Stop where the projected direction is shorter [Mucherino2017] [m]."""
    max_iterations: int = 10_000
    """Of every problem [Mucherino2017]."""
    memory: float = 0.99
    """η: 0 is the monotone search of Armijo, 1 remembers every value alike."""
    decrease: float = 1e-4
    """γ of the sufficient decrease."""
    least_curvature: float = 1e-12
    """μ is kept above it, and below its inverse."""
    least_fraction: float = 1e-12
    """Halving stops at this fraction of the direction."""

    def __post_init__(self) -> None:
        if not (0 <= self.memory <= 1 and 0 < self.decrease < 1 and self.max_iterations >= 1):
            raise UsageError(f"memory must be in [0, 1], decrease in (0, 1), iterations ≥ 1; got {self}")


class ColumnFunctions(Protocol):
    """B functions of one shape: values (B,) and gradients (n, B) at z (n, B)."""

    def __call__(self, z: Floats) -> tuple[Floats, Floats]: ...

    def take(self, columns: NDArray[np.int64]) -> "ColumnFunctions":
        """The functions of some of the columns."""
        ...


@dataclass(frozen=True)
class Single:
    """One function of z (n,) as a family of one column."""

    function: Callable[[Floats], tuple[float, Floats]]

    def __call__(self, z: Floats) -> tuple[Floats, Floats]:
        value, slope = self.function(z[:, 0])
        return np.array([value]), slope[:, None]

    def take(self, columns: NDArray[np.int64]) -> "Single":
        return self


@dataclass(frozen=True)
class Minimum:
    """Where the search of every column ended."""

    z: Floats
    """(n, B)."""
    values: Floats
    """(B,)."""
    statuses: tuple[Status, ...]
    iterations: tuple[int, ...]
    history: tuple[float, ...]
    """Sum of the values over the columns after each iteration."""


def minimise(functions: ColumnFunctions, start: Floats, lower: Floats, upper: Floats, options: Spectral) -> Minimum:
    """Minimise every column within its box, each with its own step, reference value and stopping.

    Args:
        functions: the family.
        start: (n, B).
        lower: (n, B) or broadcast to it.
        upper: as `lower`.
        options: parameters of the method.
    """
    count = start.shape[1]
    search = _Search(
        functions, start, np.broadcast_to(lower, start.shape), np.broadcast_to(upper, start.shape), options
    )
    best, values = start.copy(), np.empty(count)
    statuses, iterations, history = (
        [Status.OUT_OF_ITERATIONS] * count,
        np.zeros(count, dtype=int),
        [float(search.f.sum())],
    )
    settled = 0.0
    for iteration in range(options.max_iterations + 1):
        stopped, why = search.direct()
        if iteration == options.max_iterations:
            stopped, why = np.ones_like(stopped), np.where(stopped, why, _CODES.index(Status.OUT_OF_ITERATIONS))
        if stopped.any():
            ended = search.columns[stopped]
            best[:, ended], values[ended], iterations[ended] = search.z[:, stopped], search.f[stopped], iteration
            settled += float(search.f[stopped].sum())
            for column, code in zip(ended, why[stopped], strict=True):
                statuses[column] = _CODES[code]
            search.keep(~stopped)
        if not search.columns.size:
            break
        search.advance()
        history.append(settled + float(search.f.sum()))
    return Minimum(best, values, tuple(statuses), tuple(int(n) for n in iterations), tuple(history))


_CODES = list(Status)


class _Search:
    """The state of the columns that are still moving."""

    def __init__(self, functions: ColumnFunctions, z: Floats, lower: Floats, upper: Floats, options: Spectral):
        self.functions, self.options = functions, options
        self.lower, self.upper = lower, upper
        self.columns = np.arange(z.shape[1])
        self.z = np.clip(z, lower, upper)
        self.f, self.g = functions(self.z)
        self.reference, self.weight = self.f.copy(), np.ones_like(self.f)
        self.curvature = np.ones_like(self.f)
        self.stuck = np.zeros(len(self.f), dtype=bool)

    def direct(self) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Set the projected direction; which columns are done, and why."""
        trial = self.z - self.g / self.curvature
        np.clip(trial, self.lower, self.upper, out=trial)
        self.direction = np.subtract(trial, self.z, out=trial)
        zero = self.f < self.options.value_tolerance
        still = _dot(self.direction, self.direction) < self.options.step_tolerance**2
        done, blocked = (_CODES.index(status) for status in (Status.CONVERGED, Status.BLOCKED))
        why = np.where(self.stuck & ~zero & ~still, blocked, done)
        return zero | still | self.stuck, why

    def advance(self) -> None:
        """Go along the direction, halving where the decrease is not sufficient; then renew μ, C and Q."""
        slope = self.options.decrease * _dot(self.g, self.direction)
        z = self.z + self.direction
        f, g = self.functions(z)
        fraction, limit = 1.0, self.reference
        bad = np.flatnonzero(~(f <= limit + slope))
        while bad.size and fraction > self.options.least_fraction:
            fraction /= 2.0
            z[:, bad] = self.z[:, bad] + fraction * self.direction[:, bad]
            f[bad], g[:, bad] = self.functions.take(bad)(z[:, bad]) if bad.size < len(f) else self.functions(z)
            bad = bad[~(f[bad] <= limit[bad] + fraction * slope[bad])]
        if bad.size:
            self.stuck[bad] = True
            z[:, bad], f[bad], g[:, bad] = self.z[:, bad], self.f[bad], self.g[:, bad]
        self._renew(z, f, g)

    def _renew(self, z: Floats, f: Floats, g: Floats) -> None:
        dz, dg = z - self.z, g - self.g
        square, product = _dot(dz, dz), _dot(dg, dz)
        # Along negative curvature the formula has no meaning; the last good step is kept.
        useful = (square > 0) & (product > 0)
        curvature = np.divide(product, square, out=self.curvature.copy(), where=useful)
        self.curvature = np.clip(curvature, self.options.least_curvature, 1 / self.options.least_curvature)
        remembered = self.options.memory * self.weight
        self.weight = remembered + 1.0
        self.reference = (remembered * self.reference + f) / self.weight
        self.z, self.f, self.g = z, f, g

    def keep(self, going: NDArray[np.bool_]) -> None:
        """Drop the columns that are done."""
        kept = np.flatnonzero(going)
        self.columns = self.columns[kept]
        self.functions = self.functions.take(kept)
        for name in ("z", "g", "direction", "lower", "upper"):
            setattr(self, name, getattr(self, name)[:, kept])
        for name in ("f", "reference", "weight", "curvature", "stuck"):
            setattr(self, name, getattr(self, name)[kept])


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("nb,nb->b", a, b)
