"""CasADi functions called through their buffers: no conversion, and no allocation except for the results.

Functions of one frame are mapped over frames: one call evaluates a block of them.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Thread
from typing import ClassVar

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.solver.native import library_of, loaded, remember, remembered

BLOCK = 32
"""Frames of a mapped call; single calls evaluate the rest. A boxing OP3 is solved in 1.6 s with half and with this, in
1.9 s with double."""
WITHIN = 1e-5
"""A bound or row counts as satisfied if it is missed by no more: the 1e-6 of the library DAQP applies to rows scaled by the
Hessian."""
EXACT = WITHIN / 100
"""A row that was left out counts as satisfied if it is missed by no more, a hundredth of `WITHIN`: the result must not depend
on the left-out rows."""
BUILDS = 16
"""Number of builds that a process keeps, of some megabytes each: a clip takes two, and building takes .2 s of a clip's 1 to 2 s."""
FEW = 24
"""Number of rows of the first program of a frame: it takes 60 % of the time of one with 72 rows."""


class Compiled:
    """A CasADi function of dense arrays, or one mapped over frames. A call costs only the arithmetic: a fifth of a plain call."""

    buffer: ca.FunctionBuffer
    trigger: Callable[[], None]
    shapes: list[tuple[int, int]]
    arguments: list[Floats]
    results: list[Floats]

    def __init__(self, function: ca.Function, frames: int = 1):
        self.buffer, self.trigger = function.buffer()
        self.shapes = [function.size_out(k) for k in range(function.n_out())]
        self.arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self.results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        # CasADi's stub lists the size of a buffer, which the buffer itself carries.
        for k, array in enumerate(self.arguments):
            self.buffer.set_arg(k, array.data)  # pyright: ignore[reportCallIssue]
        for k, array in enumerate(self.results):
            self.buffer.set_res(k, array.data)  # pyright: ignore[reportCallIssue]
        sizes = [function.size_in(k) for k in range(function.n_in())]
        self._given = [_by_frame(*each, frames) for each in zip(self.arguments, sizes, strict=True)]
        self._found = [_by_frame(*each, frames) for each in zip(self.results, self.shapes, strict=True)]

    def __call__(self, *values: Floats) -> list[Floats]:
        """Return vectors flat and matrices as (rows, columns). Missing trailing arguments keep their last values."""
        for place, value in zip(self._given, values, strict=False):
            place[0] = value if value.ndim < 2 else value.T
        self.trigger()
        return [
            result.copy() if columns == 1 else place[0].T.copy()
            for result, place, (_, columns) in zip(self.results, self._found, self.shapes, strict=True)
        ]

    def fill(self, values: Sequence[Floats], results: Sequence[Floats], frames: slice) -> None:
        """Evaluate some frames of arguments (N, …) into results (N, …); unused places of a block keep their contents."""
        count = frames.stop - frames.start
        for place, value in zip(self._given, values, strict=True):
            part = value[frames]
            place[:count] = part if part.ndim < 3 else part.swapaxes(1, 2)
        self.trigger()
        for result, place in zip(results, self._found, strict=True):
            result[frames] = place[:count]


def _by_frame(array: Floats, size: tuple[int, int], frames: int) -> Floats:
    """Return the view of a buffer (rows, columns · frames) by frame: (frames, rows), or (frames, columns, rows) of matrices."""
    rows, columns = size[0], size[1] // frames
    return array.reshape((frames, rows) if columns == 1 else (frames, columns, rows))


class Mapped:
    """A CasADi function of dense arrays, evaluated for one frame or for all rows of its arguments."""

    single: Compiled

    def __init__(self, function: ca.Function):
        self.single, self._function = Compiled(function), function
        self._blocks: dict[int, Compiled] = {}
        self.shapes = self.single.shapes

    def block(self, threads: int) -> Compiled:
        """Return the function of `BLOCK` frames, which are shared among threads."""
        if threads not in self._blocks:
            shared = self._function.map(BLOCK, "thread", threads) if threads > 1 else self._function.map(BLOCK)
            self._blocks[threads] = Compiled(shared, BLOCK)
        return self._blocks[threads]

    def __call__(self, *values: Floats, threads: int = 1) -> list[Floats]:
        """Return the results for arguments (N, …): vectors (N, rows), matrices (N, rows, columns); without N for one frame."""
        if values[0].ndim == 1:
            return self.single(*values)
        count = len(values[0])
        if count == 1:
            return [result[None] for result in self.single(*(value[0] for value in values))]
        results = [np.empty((count, rows) if columns == 1 else (count, columns, rows)) for rows, columns in self.shapes]
        for first in range(0, count, BLOCK):
            last = min(first + BLOCK, count)
            if 2 * (last - first) > BLOCK:
                self.block(threads).fill(values, results, slice(first, last))
            else:
                for k in range(first, last):
                    self.single.fill(values, results, slice(k, k + 1))
        return [result if result.ndim < 3 else result.swapaxes(1, 2) for result in results]


class Upgraded:
    """A function that runs on CasADi's virtual machine until its machine code is ready; the results are the same."""

    native: bool

    def __init__(self, function: ca.Function, native: bool):
        """Evaluate a function, of machine code if `native` is set."""
        self._serves, self.native = Mapped(function), native
        self.shapes = self._serves.shapes

    def __call__(self, *values: Floats, threads: int = 1) -> list[Floats]:
        """Evaluate as `Mapped` does."""
        return self._serves(*values, threads=threads)

    def upgrade(self, code: ca.Function) -> None:
        """Evaluate machine code from now on."""
        self._serves, self.native = Mapped(code), True


class Build:
    """Functions with a key: machine code that the cache has under it, else built, and compiled in the background."""

    functions: list[Upgraded]
    _built: ClassVar[dict[str, list[ca.Function]]] = {}

    def __init__(self, build: Callable[[], Sequence[ca.Function]], key: str | None, native: bool):
        """Load or build functions, or take those that this process built last; compile them if `native` is set."""
        kept = remembered(key) if key and native else None
        built = kept or self._built.pop(key or "", None) or [function.expand() for function in build()]
        if key and kept is None:
            self._built[key] = built
            for oldest in list(self._built)[:-BUILDS]:
                self._built.pop(oldest, None)
        self.functions = [Upgraded(function, kept is not None) for function in built]
        compiled = key and native and kept is None
        self._compiling = Thread(target=self._compile, args=(key, built)) if compiled else None
        if self._compiling:
            self._compiling.start()

    @property
    def native(self) -> bool:
        """Whether machine code evaluates every function."""
        return all(function.native for function in self.functions)

    def wait(self) -> None:
        """Block until the machine code is in use or its compilation has failed."""
        if self._compiling:
            self._compiling.join()

    def _compile(self, key: str, built: Sequence[ca.Function]) -> None:
        libraries: dict[str, Path] = {}
        for function, own in zip(built, self.functions, strict=True):
            library = library_of(function)
            code = None if library is None else loaded(function.name(), library)
            if library is None or code is None:
                return
            own.upgrade(code)
            libraries[function.name()] = library
        remember(key, libraries)


class QuadraticPrograms:
    """minimise ½ xᵀHx + gᵀx  subject to  lower ≤ x ≤ upper,  row_lower ≤ A x, for N frames; DAQP's dual active set."""

    def __init__(self, variables: int, threads: int = 1):
        self.variables, self.threads = variables, threads
        self._run: dict[int, Mapped] = {}

    def solve(
        self, hessian: Floats, gradient: Floats, lower: Floats, upper: Floats, rows: Floats, row_lower: Floats
    ) -> tuple[Floats, Bools]:
        """Return the minimisers (N, n) within their bounds, and whether rows hold within `WITHIN`.

        The `FEW` rows with the least room at 0 come first; where the minimiser breaks another row, all rows follow.

        Args:
            hessian: (N, n, n).
            gradient: (N, n).
            lower: (N, n).
            upper: (N, n).
            rows: (N, R, n).
            row_lower: (N, R).
        """
        problem = hessian, gradient, lower, upper
        few, frames = np.argsort(-row_lower, axis=1, kind="stable")[:, :FEW], np.arange(len(rows))[:, None]
        x, kept = self._solved(*problem, rows[frames, few], row_lower[frames, few])
        room = _times(rows, x) - row_lower
        broken = np.flatnonzero((room < -EXACT).any(axis=1) | ~kept)
        if broken.size:
            x[broken], kept[broken] = self._solved(*(each[broken] for each in (*problem, rows, row_lower)))
            kept[broken] &= (_times(rows[broken], x[broken]) >= row_lower[broken] - WITHIN).all(axis=1)
        return x, kept

    def solve_frame(
        self, hessian: Floats, gradient: Floats, lower: Floats, upper: Floats, rows: Floats, row_lower: Floats
    ) -> tuple[Floats, bool]:
        """Return the same of one frame with any number of rows: the minimiser (n,), and whether rows hold."""
        problem = hessian, gradient, lower, upper
        few = np.argsort(-row_lower, kind="stable")[:FEW]
        x, kept = self._one(*problem, rows.take(few, axis=0), row_lower.take(few))
        if kept and (rows @ x >= row_lower - EXACT).all():
            return x, True
        x, kept = self._one(*problem, rows, row_lower)
        return x, kept and bool((rows @ x >= row_lower - WITHIN).all())

    def _one(
        self, hessian: Floats, gradient: Floats, lower: Floats, upper: Floats, rows: Floats, row_lower: Floats
    ) -> tuple[Floats, bool]:
        """Solve one frame with all of some rows; return also whether bounds hold."""
        missing = -len(rows) % FEW or FEW * (not len(rows))
        if missing:
            rows = np.concatenate([rows, np.zeros((missing, self.variables))])
            row_lower = np.concatenate([row_lower, np.full(missing, -np.inf)])
        (found,) = self._mapped(len(rows)).single(hessian, gradient, rows, lower, upper, row_lower)
        x = found.clip(lower, upper)
        return x, bool(np.abs(x - found).max() <= WITHIN)

    def _solved(
        self, hessian: Floats, gradient: Floats, lower: Floats, upper: Floats, rows: Floats, row_lower: Floats
    ) -> tuple[Floats, Bools]:
        """Solve with all of some rows; return also whether bounds hold (N,)."""
        found = self._mapped(rows.shape[1])(hessian, gradient, rows, lower, upper, row_lower, threads=self.threads)[0]
        x = found.clip(lower, upper)
        return x, np.abs(x - found).max(axis=1) <= WITHIN

    def _mapped(self, count: int) -> Mapped:
        """Return the program with a number of rows."""
        if count not in self._run:
            n = self.variables
            shape = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(count, n)}
            conic = ca.conic("program", "daqp", shape, {"error_on_fail": False})
            h, g, a, low, high, row_low = (
                ca.MX.sym("x", *size) for size in ((n, n), (n, 1), (count, n), (n, 1), (n, 1), (count, 1))
            )
            found = conic(h=h, g=g, a=a, lbx=low, ubx=high, lba=row_low, uba=np.inf)["x"]
            self._run[count] = Mapped(ca.Function("program", [h, g, a, low, high, row_low], [found]))
        return self._run[count]


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """(N, R, n) · (N, n)."""
    return (matrices @ vectors[..., None])[..., 0]
