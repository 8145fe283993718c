"""The step of a whole clip: a convex program over all frames, by a primal–dual interior-point method on a banded matrix.

    minimise  2 g·x + xᵀ H x + zᵀ G z   subject to   C x + G z ≥ d

The constraints are rows of frames (links, soles), boxes, and changes between frames within the joint speeds. A constraint gives
way at the price μ of its squared deficit; z is its force. The links of a frame share one slack s = Σ z/μ, which pays for the deepest
of them. So each force z gives G z, where G is diagonal but for 1/μ between links of a frame. With t = C x + G z − d and t z = τ, a
Newton step solves

    (H + Cᵀ W C) Δx = −r − Cᵀ W (p + (t z − σ τ)/z),    W = (G + t/z)⁻¹,    r = H x + g − Cᵀ z,    p = C x + G z − t − d

which has the band of H. Predictor and corrector of [Mehrotra1992] share its factor.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.solver.banded import BandedSystem, FrameCoupling

# In brackets: the change of the cost [%] with half and with double of a number, the range over two clips on the G1 and two on the OP3.

PRICE = 1e6
"""μ of boxes and joint speeds [1/rad²]: a force of 8/rad, that of the direction of a leg, breaks them by 8e-6 rad. Measured: with half, the cost of
four clips rises by 0 … 0.5 %, with double by -0.1 … 0.3 %."""
TO_BOUNDARY = 0.995
"""Share of the way to the nearest end of a slack or force that a Newton step takes at most [-] (with .95 -0.1 … 0.2, with .999
0 … 0.4)."""
NEWTON = 2
"""Newton steps of a program at most: the next linearisation moves the minimum further (with 3, -0.5 … 0.5 and 1.4 times the
factorisations; with 6, one OP3 clip costs 6 more) ..."""
DECIDED = 9
"""... and until their gain counts: measured, each leaves a tenth of the gap of 0.3 of the cost, and 1e-5 of it
is below every gain that counts."""
RELATIVE_GAP = 0.05
"""A program ends where the gap is a smaller share of its gain [-] (0; 0)."""
ALONE_GIVE = 0.01
"""Share of 1/μ by which each link gives way alone [-]: W stays below 100 μ, whose rounding the least damping exceeds."""
BISECTED = 12
"""The starting slack that links share is found to 12 bits of the logarithm of its interval [-]."""
ABSENT = 1e3
"""Room of a constraint that is absent [m, rad]; a step as long as this is a mistake."""


@dataclass(frozen=True, eq=False)
class StepRows:
    """Rows  J x_t ≥ d  of the frames of a clip, the same number for every frame."""

    slope: Floats
    """(T, R, nv)."""
    lower: Floats
    """(T, R) d; −`ABSENT` where a frame has fewer rows."""
    price: Floats
    """(T, R) μ."""
    links: Bools
    """(T, R) which rows share the slack of their frame; their μ is `shared`."""
    shared: float

    def penalties(self, step: Floats | None = None) -> Floats:
        """Return (T,) the costs of the deficits after a step (T, nv); at x = 0 without one."""
        moved = 0.0 if step is None else (self.slope @ step[..., None])[..., 0]
        lacking = np.maximum(self.lower - moved, 0.0) ** 2
        own = np.where(self.links, 0.0, self.price * lacking).sum(axis=1)
        return own + self.shared * np.where(self.links, lacking, 0.0).max(axis=1, initial=0.0)


@dataclass(frozen=True, eq=False)
class Room:
    """The room of a step: boxes of all directions (T, nv), and of the changes of hinges from the frame before (T, n)."""

    lower: Floats
    upper: Floats
    slower: Floats
    faster: Floats
    hinges: Ints


class StepProgram:
    """The convex program of one step."""

    def __init__(self, gradient: Floats, normal: Floats, coupling: FrameCoupling, rows: StepRows, room: Room):
        """Assemble the program.

        Args:
            gradient: g (T, nv), half of that of the whole cost.
            normal: (T, nv, nv) of the frames, damped.
            coupling: of the differences.
            rows: inequalities of frames.
            room: of the step.
        """
        self.gradient, self.normal, self.coupling, self.rows, self.hinges = (
            gradient,
            normal,
            coupling,
            rows,
            room.hinges,
        )
        parts = rows.lower, room.lower, -room.upper, room.slower, -room.faster
        ends = np.cumsum([0, *(part.size for part in parts)]).tolist()
        self._parts = [(slice(*own), part.shape) for own, part in zip(pairwise(ends), parts, strict=True)]
        self.lower = np.concatenate([part.ravel() for part in parts])
        self.give = np.full(len(self.lower), 1 / PRICE)
        self.give[: rows.lower.size] = np.where(rows.links, ALONE_GIVE, 1.0).ravel() / rows.price.ravel()

    def minimised(self, system: BandedSystem, gap: float, least: float) -> tuple[Floats, float, int]:
        """Return the step (T, nv), by how much it lowers the cost of the model, and the number of factorisations.

        Args:
            system: the memory of the factor.
            gap: Σ t z at the start, of the size of the expected gain.
            least: a gain that counts; more Newton steps decide whether there is one.
        """
        x = np.zeros_like(self.gradient)
        force, slack = self._start(gap / len(self.lower))
        worst, gained, taken = self._penalty(x), 0.0, 0
        while taken < NEWTON or (gained < least and taken < DECIDED):
            x, force, slack = self._newton(system, x, force, slack)
            gained = worst - self._penalty(x) - float((x * (2 * self.gradient + self._times(x))).sum())
            taken += 1
            if force @ slack < RELATIVE_GAP * max(gained, least):
                break
        return x, gained, taken

    def _start(self, barrier: float) -> tuple[Floats, Floats]:
        """Return forces z and slacks t = G z − d at x = 0, with t z ≥ τ: the bisection may leave less, or less than 0."""
        root = np.sqrt(self.lower**2 + 4 * barrier * self.give)
        force = np.where(self.lower > 0, (self.lower + root) / (2 * self.give), 2 * barrier / (root - self.lower))
        rows, links = self.rows, self.rows.links
        deepest = np.where(links, rows.lower, 0.0).max(axis=1, keepdims=True, initial=0.0)
        most = np.sqrt(barrier * np.maximum(links.sum(axis=1, keepdims=True), 1) / rows.shared)
        least = barrier / (rows.shared * (deepest + most))
        pushed = np.zeros_like(rows.lower)
        for _ in range(BISECTED):
            beyond = np.sqrt(least * most)
            pushed = np.where(links, barrier / (deepest + beyond - rows.lower), 0.0)
            strong = pushed.sum(axis=1, keepdims=True) > rows.shared * (deepest + beyond)
            least, most = np.where(strong, beyond, least), np.where(strong, most, beyond)
        self._rows(force)[links] = pushed[links]
        return force, np.maximum(self._given(force) - self.lower, barrier / force)

    def _newton(self, system: BandedSystem, x: Floats, force: Floats, slack: Floats) -> tuple[Floats, Floats, Floats]:
        """Return x, z and t after a predictor and a corrector."""
        stiff = 1 / (self.give + slack / force)
        self._factor(system, stiff)
        dual = self._times(x) + self.gradient - self._pulled(force)
        primal = self._constrained(x) + self._given(force) - slack - self.lower
        product = slack * force

        def towards(wanted: Floats | float) -> tuple[Floats, Floats, Floats]:
            pull = primal + (product - wanted) / force
            moved = system.solve(-dual - self._pulled(self._weighted(stiff, pull)))
            pressed = -self._weighted(stiff, self._constrained(moved) + pull)
            return moved, pressed, (wanted - product - slack * pressed) / force

        def length(pressed: Floats, freed: Floats) -> float:
            shortest = min(float((pressed / force).min()), float((freed / slack).min()))
            return min(1.0, -TO_BOUNDARY / shortest) if shortest < 0 else 1.0

        moved, pressed, freed = towards(0.0)
        share = length(pressed, freed)
        left = float((force + share * pressed) @ (slack + share * freed)) / float(product.sum())
        moved, pressed, freed = towards(left**3 * product.mean() - pressed * freed)
        share = length(pressed, freed)
        return x + share * moved, force + share * pressed, slack + share * freed

    def _penalty(self, x: Floats) -> float:
        """Return the cost of the deficits."""
        lacking, count = np.maximum(self.lower - self._constrained(x), 0.0), self.rows.lower.size
        return float(self.rows.penalties(x).sum() + PRICE * (lacking[count:] ** 2).sum())

    def _given(self, force: Floats) -> Floats:
        """G z."""
        given, links = self.give * force, self.rows.links
        own = self._rows(given)
        own += links * (links * self._rows(force)).sum(axis=1, keepdims=True) / self.rows.shared
        return given

    def _weighted(self, stiff: Floats, pull: Floats) -> Floats:
        """W y, by the formula of Sherman and Morrison for each frame."""
        found = stiff * pull
        own, shared = self._rows(found), self.rows.links * self._rows(stiff)
        whole = (self.rows.links * own).sum(axis=1, keepdims=True)
        own -= shared * whole / (self.rows.shared + shared.sum(axis=1, keepdims=True))
        return found

    def _constrained(self, x: Floats) -> Floats:
        """C x."""
        changes = x[:, self.hinges]
        changes[1:] -= x[:-1, self.hinges]
        rows = (self.rows.slope @ x[..., None])[..., 0]
        return np.concatenate([part.ravel() for part in (rows, x, -x, changes, -changes)])

    def _pulled(self, force: Floats) -> Floats:
        """Cᵀ f (T, nv)."""
        rows, above, below, slower, faster = self._split(force)
        found = (rows[:, None] @ self.rows.slope)[:, 0] + above - below
        found[:, self.hinges] += slower - faster
        found[:-1, self.hinges] -= (slower - faster)[1:]
        return found

    def _times(self, x: Floats) -> Floats:
        """H x."""
        return (self.normal @ x[..., None])[..., 0] + self.coupling @ x

    def _factor(self, system: BandedSystem, stiff: Floats) -> None:
        """Factor H + Cᵀ W C."""
        rows, above, below, slower, faster = self._split(stiff)
        weighted, shared = np.sqrt(rows)[..., None] * self.rows.slope, self.rows.links * rows
        blocks = self.normal + weighted.swapaxes(1, 2) @ weighted
        joint = (shared[:, None] @ self.rows.slope) / np.sqrt(self.rows.shared + shared.sum(axis=1))[:, None, None]
        blocks -= joint.swapaxes(1, 2) @ joint
        change = np.zeros_like(self.gradient)
        change[:, self.hinges] = slower + faster
        diagonal = blocks.reshape(len(blocks), -1)[:, :: blocks.shape[1] + 1]
        diagonal += self.coupling.diagonals[0] + above + below + change
        diagonal[:-1] += change[1:]
        first, *others = [*self.coupling.diagonals[1:], np.zeros_like(change[1:])][
            : max(len(self.coupling.diagonals) - 1, 1)
        ]
        system.factor(blocks, [first - change[1:], *others])

    def _rows(self, every: Floats) -> Floats:
        """Return the view (T, R) of the values of rows."""
        return every[: self.rows.lower.size].reshape(self.rows.lower.shape)

    def _split(self, every: Floats) -> list[Floats]:
        """Return the values of rows, boxes and changes, each in its shape."""
        return [every[own].reshape(shape) for own, shape in self._parts]
