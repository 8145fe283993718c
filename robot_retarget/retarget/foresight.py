"""Where a robot's joints go from here, and what MuJoCo says of its surfaces on the way.

The joints stand k steps ahead at q + g(k) v + h(k) a, brought within their ranges, with their last step v and its
change a and the gains of `pace`.
The root is left where it is: it moves no surface against another.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.retarget.pace import STEP
from robot_retarget.robot import Robot
from robot_retarget.robot.collidable import Clearance, Pairs
from robot_retarget.robot.model import FREE

REACH = 0.2
"""Surfaces farther apart than this count as this far [m]."""
FOLLOWED = 0.1
"""On the way, surfaces farther apart than this count as this far [m]."""
CLOSING = 5e-4
"""A pair that comes no nearer than this within the horizon stays where it is [m]."""
INSTANTS = (1, 2, 3, 4, 5, 6, 8, 10, 12)
"""Steps ahead that are looked at; past those every third."""
MAIN = 3
"""Every so many instants, and the last, are looked at to tell whether the others are worth it."""


@dataclass(frozen=True)
class Outlook:
    """What is foreseen of N pairs, each at one frame."""

    distance: Floats
    """(N,) between the geoms now [m], negative inside; at most `REACH`."""
    next: Floats
    """(N,) the same one step ahead, where the pair closes."""
    contact: Floats
    """(N,) time to contact [s], 0 in contact, infinite where none is foreseen within the horizon."""
    depth: Floats
    """(N,) how deep the surfaces would come to overlap within the horizon [m]."""
    sure: Floats
    """(N,) by how much the foreseen overlap exceeds what is asked for at its instant, at best [m]; −∞ unless closing."""


class Joints:
    """The single joints of a robot in qpos: all but a free root."""

    def __init__(self, robot: Robot):
        model = robot.model
        single = np.flatnonzero(model.jnt_type != FREE)
        self.columns = np.asarray(model.jnt_qposadr[single], dtype=np.int64)
        self.rest = np.array(model.qpos0)
        self.lower, self.upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
        self.lower[robot.qpos_index], self.upper[robot.qpos_index] = robot.lower, robot.upper

    def pinned(self, qpos: Floats) -> Floats:
        """Configurations (…, nq) with a free root put where `qpos0` has it."""
        still = np.empty_like(qpos)
        still[:] = self.rest
        still[..., self.columns] = qpos[..., self.columns]
        return still

    def path(self, qpos: Floats, step: Floats, change: Floats, gains: Floats) -> Floats:
        """(K, nq) from one configuration, its step and its change of step (nq,), by gains (2, K)."""
        ahead = qpos + gains.T @ np.stack([step, change])
        return np.clip(ahead, np.minimum(self.lower, qpos), np.maximum(self.upper, qpos))


class Foresight:
    """Distances of chosen pairs along the path of the joints."""

    def __init__(
        self, robot: Robot, pairs: Pairs, horizon: float, step: float, margin: float, doubt: float, slack: float
    ):
        """Look `horizon` [s] ahead in steps of `step` [s]; `sure` is measured against margin − ½ doubt t²."""
        self.joints, self.clearance, self.slack = Joints(robot), Clearance(robot, pairs), slack
        self.worth = 1.5 * margin
        steps = horizon / step
        self.k = np.array([k for k in (*INSTANTS, *range(15, int(steps) + 1, 3)) if k < steps] + [steps])
        self.main = np.union1d(range(0, len(self.k), MAIN), len(self.k) - 1)
        self.other = np.setdiff1d(np.arange(len(self.k)), self.main)
        self.times = np.concatenate([[0.0], self.k]) * step
        self.asked = margin - 0.5 * doubt * self.times[1:] ** 2

    def look(self, qpos: Floats, step: Floats, change: Floats, gains: Floats, pairs: Ints, drop: Floats) -> Floats:
        """Distances (1 + K, N) of pairs (N,) now and at every instant [m]; `REACH` where it is not worth measuring.

        A pair is followed where its distance now, less `drop` (N,) by how much its capsules will approach, is within
        `slack`, and it does not touch already: at the main instants, and at all where those bring it near enough, and
        nearer than it is.
        """
        found = np.full((1 + len(self.k), len(pairs)), REACH)
        found[0] = self.clearance.along(qpos[None], pairs, np.minimum(self.slack + drop + CLOSING, REACH))[0]
        follow = np.flatnonzero((found[0] > 0) & (found[0] - drop <= self.slack))
        if follow.size:
            path = self.joints.path(qpos, step, change, gains)
            for instants in (self.main, self.other):
                reach = np.full(len(follow), FOLLOWED)
                found[1 + instants[:, None], follow] = self.clearance.along(path[instants], pairs[follow], reach)
                least = found[1:, follow].min(axis=0)
                follow = follow[(least <= self.worth) & (least < found[0, follow] - CLOSING)]
        return found

    def outlook(self, distances: Floats) -> Outlook:
        """What distances (1 + K, N) tell."""
        now, ahead = distances[0], distances[1:]
        times = self.times
        inside = distances <= 0
        hit = inside.any(0)
        after = np.where(hit, inside.argmax(0), 1)
        before = np.maximum(after - 1, 0)
        columns = np.arange(len(now))
        outer, inner = distances[before, columns], distances[after, columns]
        share = np.where(outer > inner, outer / np.where(outer > inner, outer - inner, 1.0), 0.0)
        contact = np.where(hit, times[before] + share * (times[after] - times[before]), np.inf)
        contact = np.where(now <= 0, 0.0, contact)
        depth = np.maximum(0.0, -distances.min(0))
        closing = ahead.min(0) < now - CLOSING
        sure = np.where(closing, (self.asked[:, None] - ahead).max(0), -np.inf)
        return Outlook(now, np.where(closing, ahead[0], REACH), contact, depth, sure)


def span_of(fps: float) -> int:
    """The frames of one step."""
    return max(1, round(STEP * fps))


def strides(values: Floats, span: int) -> Floats:
    """How far values (T, …) went over the last `span` frames; near the start over those there are, in proportion."""
    frames = np.arange(len(values))
    before = np.maximum(frames - span, 0)
    share = span / np.maximum(frames - before, 1)
    return (values - values[before]) * share.reshape(-1, *[1] * (values.ndim - 1))


def changes(steps: Floats, span: int) -> Floats:
    """By how much steps (T, …) differ from those before; 0 where there is no step before."""
    before = np.arange(len(steps)) - span
    changed = steps - steps[np.maximum(before, 0)]
    changed[before <= 0] = 0.0
    return changed
