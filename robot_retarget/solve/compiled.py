"""CasADi functions called through their buffers: no conversion, and no allocation except for the results."""

from collections.abc import Callable
from threading import Thread

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.solve.native import machine_code

WITHIN = 1e-5
"""A bound or row counts as satisfied if it is missed by no more: the solver's own 1e-6 applies to rows scaled by the
Hessian."""


class Compiled:
    """A CasADi function of dense arrays. A call costs only the arithmetic: a fifth of a plain call."""

    buffer: ca.FunctionBuffer
    trigger: Callable[[], None]
    shapes: list[tuple[int, int]]
    arguments: list[Floats]
    results: list[Floats]

    def __init__(self, function: ca.Function):
        self.buffer, self.trigger = function.buffer()
        self.shapes = [function.size_out(k) for k in range(function.n_out())]
        self.arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self.results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        # CasADi's stub lists the size of a buffer, which the buffer itself carries.
        for k, array in enumerate(self.arguments):
            self.buffer.set_arg(k, array.data)  # pyright: ignore[reportCallIssue]
        for k, array in enumerate(self.results):
            self.buffer.set_res(k, array.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, *values: Floats) -> list[Floats]:
        """Return vectors flat and matrices as (rows, columns). Missing trailing arguments keep their last values."""
        for argument, value in zip(self.arguments, values, strict=False):
            argument[:] = value if value.ndim < 2 else value.ravel(order="F")
        self.trigger()
        return [
            result.copy() if columns == 1 else result.reshape((rows, columns), order="F").copy()
            for result, (rows, columns) in zip(self.results, self.shapes, strict=True)
        ]


class Upgraded:
    """A function that runs on CasADi's virtual machine until its machine code is ready; the results are the same."""

    native: bool

    def __init__(self, function: ca.Function, native: bool):
        """Compile in the background if `native` is set."""
        self._serves, self.native = Compiled(function), False
        self._compiling = Thread(target=self._compile, args=(function,)) if native else None
        if self._compiling:
            self._compiling.start()

    def __call__(self, *values: Floats) -> list[Floats]:
        """Evaluate as `Compiled` does."""
        return self._serves(*values)

    def wait(self) -> None:
        """Block until the machine code is in use or its compilation has failed."""
        if self._compiling:
            self._compiling.join()

    def _compile(self, function: ca.Function) -> None:
        code = machine_code(function)
        if code is not None:
            self._serves, self.native = Compiled(code), True


def dense_function(name: str, inputs: list[ca.MX], outputs: list[ca.MX]) -> Compiled:
    """Compile expressions with dense outputs.

    Args:
        name: name of the function.
        inputs: symbols, in the order of the arguments.
        outputs: expressions of the inputs.
    """
    return Compiled(ca.Function(name, inputs, [ca.densify(o) for o in outputs]))


class QuadraticProgram:
    """minimise ½ xᵀHx + gᵀx  subject to  lower ≤ x ≤ upper,  row_lower ≤ A x; solved by DAQP's dual active set.

    H, g and the bounds are written in place (`hessian`, `gradient`, `lower`, `upper`); they start at 0.
    """

    run: Compiled
    hessian: Floats
    gradient: Floats
    lower: Floats
    upper: Floats
    rows: Floats
    row_lower: Floats

    def __init__(self, variables: int, rows: int):
        shape = {"h": ca.Sparsity.dense(variables, variables), "a": ca.Sparsity.dense(rows, variables)}
        function = ca.conic("program", "daqp", shape, {"error_on_fail": False})
        self.run = Compiled(function)
        given = dict(zip(function.name_in(), self.run.arguments, strict=True))
        self.hessian, self.gradient = given["h"].reshape((variables, variables), order="F"), given["g"]
        self.lower, self.upper = given["lbx"], given["ubx"]
        self.rows, self.row_lower = given["a"].reshape((rows, variables), order="F"), given["lba"]
        given["uba"][:] = np.inf

    def solve(self, rows: Floats, row_lower: Floats) -> Floats | None:
        """The minimiser, within its bounds, or None when rows A x ≥ row_lower cannot be kept within `WITHIN`."""
        self.rows[:], self.row_lower[:] = rows, row_lower
        found = self.run()[0]
        x = np.clip(found, self.lower, self.upper)
        return x if np.abs(x - found).max() <= WITHIN and (rows @ x >= row_lower - WITHIN).all() else None
