"""Coupling: geared joints and closed chains, the equality constraints of the model."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.kind import Form, Kind, MeasureRows, RetargetContext, RowState, Track, exact
from robot_retarget.robot.coupling import Coupling as Constraints


@dataclass(frozen=True)
class CouplingKind(Kind):
    """Violation of every constraint [m or rad], 0; closed by Newton steps at the end of a descent."""

    name: str = "coupling"
    form = Form.NUMERIC
    follows_human = False
    priority: float = 30.0
    """π over the squared leg: descents bend chains a little, and close them at the end [-]."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Return 0; no edges for a robot without constraints."""
        constraints = Constraints(context.robot)
        if not constraints.present:
            return None
        count = len(constraints(context.robot.neutral())[0])
        ends = [(f"constraint {k}", "closed") for k in range(count)]
        return exact(self, ends, np.zeros((len(context.human), count)), self.priority, context.leg)

    def rows(self, track: Track, state: RowState) -> MeasureRows:
        """Return all constraints, by MuJoCo."""
        values, slope = _constraints(state)(state.qpos)
        return MeasureRows(values, slope, np.arange(len(values)))

    def projected(self, track: Track, state: RowState) -> Floats:
        """Return the nearby configuration (nq,) that closes the chains."""
        return _constraints(state).close_chains(state.qpos)


def _constraints(state: RowState) -> Constraints:
    if "constraints" not in state.memory:
        state.memory["constraints"] = Constraints(state.robot)
    return state.memory["constraints"]
