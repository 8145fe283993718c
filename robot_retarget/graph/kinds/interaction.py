"""Interaction: the interaction distance of approaching links stays above their margin, within a horizon.

D is the interaction distance of `graph.interaction` with its minimum over α = 1 + k. Surfaces are approximated as flat at
their nearest points: their signed distance d changes by ḋ with every step, and so

    D = min_{0 ≤ k ≤ H} d + k ḋ,    k = H if the links approach, k = 0 if they part,

with (1 + k) times the gradient of d. The deficit of d itself belongs to the separation inequality.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.graph.kind import Form, Kind, MeasureRows, RetargetContext, RowState, Track
from robot_retarget.graph.track import STEP
from robot_retarget.robot.kinematics import difference


@dataclass(frozen=True)
class InteractionKind(Kind):
    """Margin minus interaction distance, without the deficit of the distance itself [m], at most 0."""

    name: str = "interaction"
    stencil: tuple[int, ...] = STEP
    form = Form.NUMERIC
    follows_human = False
    horizon: float = 0.3
    """Prediction horizon of the interaction distance [s]."""

    def targets(self, context: RetargetContext) -> Track | None:
        """One edge for all pairs near each other, of priority `Weights.interaction`."""
        frames, priority = len(context.human), context.weights.interaction
        if priority == 0:
            return None
        lower, upper = np.full((frames, 1), -np.inf), np.zeros((frames, 1))
        ends = (("links near each other", "a frame before"),)
        return Track(self, ends, lower, upper, np.full((frames, 1), priority), np.full(1, context.leg))

    def rows(self, track: Track, state: RowState) -> MeasureRows | None:
        """Return the rows of pairs that approach and would pass the margin within the horizon."""
        past, contacts = state.past, state.contacts
        if past is None or contacts is None:
            return None
        horizon = self.horizon / past.seconds
        step = difference(state.robot, past.qpos, state.qpos)
        ahead = horizon * np.minimum(contacts.slope @ step, 0.0)  # of k = H and k = 0 the one with the smaller d + k ḋ
        value = np.where(ahead < 0, np.maximum(-ahead + np.minimum(contacts.deficit, 0.0), 0.0), 0.0)
        rows = np.flatnonzero(value)
        if not rows.size:
            return None
        alpha = horizon + (contacts.deficit[rows] < 0)
        return MeasureRows(value[rows], -alpha[:, None] * contacts.slope[rows], np.zeros(len(rows), dtype=int))
