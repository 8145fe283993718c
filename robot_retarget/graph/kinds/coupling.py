"""Coupling: geared joints and closed chains, the equality constraints of the model."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.kinds.kind import FRAME, ContactRows, MeasureRows, Past, RetargetContext, Role
from robot_retarget.graph.track import Track, exact
from robot_retarget.robot import Robot
from robot_retarget.robot.coupling import Coupling as Constraints


@dataclass(frozen=True)
class CouplingKind:
    """Violation of every constraint [m or rad], 0; closed by Newton steps at the end of a descent."""

    name: str = "coupling"
    role: Role = Role.COST
    stencil: tuple[int, ...] = FRAME
    priority: float = 30.0
    """π over the squared leg: descents bend chains a little, and close them at the end [-]."""

    def targets(self, context: RetargetContext) -> Track | None:
        """0; none of a robot without constraints."""
        constraints = Constraints(context.robot)
        if not constraints.present:
            return None
        count = len(constraints(context.robot.neutral())[0])
        ends = [(f"constraint {k}", "closed") for k in range(count)]
        return exact(self, ends, np.zeros((len(context.human), count)), self.priority, context.leg)

    def evaluator(self, track: Track, robot: Robot) -> "Closure":
        """MuJoCo's constraints."""
        return Closure(Constraints(robot))


class Closure:
    """Violations and their Jacobian, and Newton's method on them."""

    def __init__(self, constraints: Constraints):
        self._constraints = constraints

    def __call__(self, qpos: Floats, past: Past | None, contacts: ContactRows | None) -> MeasureRows:
        """All constraints."""
        values, slope = self._constraints(qpos)
        return MeasureRows(values, slope, range(len(values)))

    def projected(self, qpos: Floats) -> Floats:
        """The nearby configuration (nq,) that closes the chains."""
        return self._constraints.close_chains(qpos)
