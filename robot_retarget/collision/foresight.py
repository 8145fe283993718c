"""Where a robot's joints go from here, and what MuJoCo says of its surfaces on the way.

The joints stand k steps ahead at q + g(k) v + h(k) a, brought within their ranges, with their last step v and its
change a and the gains of `pace`. The root is left where it is: it moves no surface against another.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.collision.pace import STEP
from robot_retarget.robot import Robot
from robot_retarget.robot.clearance import Clearance
from robot_retarget.robot.model import FREE

FOLLOWED = 0.1
"""Just before an overlap, surfaces farther apart than this count as this far [m]."""
LEAP = 0.05
"""A pair whose capsules near by more than this may pass between two main instants [m]."""
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
    """(N,) between the geoms now [m], negative inside; at most `margin` and a little."""
    next: Floats
    """(N,) the same one step ahead, where the pair closes."""
    contact: Floats
    """(N,) time to contact [s]: until surfaces meet, or are nearest where they come within the margin; 0 in contact,
    infinite where nothing of this is foreseen within the horizon."""
    depth: Floats
    """(N,) how deep the surfaces would come to overlap within the horizon [m]."""
    sure: Floats
    """(N,) by how much the foreseen overlap exceeds what is asked for at its instant, at best [m]; −∞ unless closing."""


class Joints:
    """The single joints of a robot in qpos: all but a free root."""

    def __init__(self, robot: Robot):
        model = robot.model
        single = np.flatnonzero(model.jnt_type != FREE)
        columns = np.asarray(model.jnt_qposadr[single], dtype=np.int64)
        self.free, self.rest = np.setdiff1d(np.arange(model.nq), columns), np.array(model.qpos0)
        self.lower, self.upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
        self.lower[robot.qpos_index], self.upper[robot.qpos_index] = robot.lower, robot.upper

    def pinned(self, qpos: Floats) -> Floats:
        """Configurations (…, nq) with a free root put where `qpos0` has it."""
        still = qpos.copy()
        still[..., self.free] = self.rest[self.free]
        return still

    def paths(self, qpos: Floats, step: Floats, change: Floats, gains: Floats) -> Floats:
        """(L, K, nq) from L configurations, their steps and changes of step (L, nq), by gains (L, 2, K)."""
        now, ahead = qpos[:, None], gains[:, 0, :, None] * step[:, None]
        ahead += gains[:, 1, :, None] * change[:, None]
        ahead += now
        np.maximum(ahead, np.minimum(self.lower, now), out=ahead)
        return np.minimum(ahead, np.maximum(self.upper, now), out=ahead)


class Foresight:
    """Distances of chosen pairs along the paths of the joints."""

    def __init__(
        self,
        joints: Joints,
        clearance: Clearance,
        horizon: float,
        step: float,
        margin: float,
        doubt: float,
    ):
        """Look `horizon` [s] ahead in steps of `step` [s]; `sure` is measured against margin − ½ doubt t²."""
        self.joints, self.clearance, self.margin = joints, clearance, margin
        self.near = margin + CLOSING
        steps = horizon / step
        self.k = np.array([k for k in (*INSTANTS, *range(15, int(steps) + 1, 3)) if k < steps] + [steps])
        instants = np.arange(1, len(self.k) + 1)
        self.main = np.union1d(instants[::MAIN], instants[-1])
        self.other = np.setdiff1d(instants, self.main)
        self.times = np.concatenate([[0.0], self.k]) * step
        self.asked = margin - 0.5 * doubt * self.times[1:] ** 2

    def look(self, path: Floats, pairs: Ints, rough: Floats, drop: Floats) -> Floats:
        """Distances (1 + K, N) of pairs (N,) on a path (1 + K, nq), now and at every instant, at most `near` [m].

        Those now are measured where the capsules, `rough` (N,) apart, leave open what they are. A pair that does not
        touch is followed: to the main instants, and to all if it comes nearer than it is at one of those, or if its
        capsules will approach by a `drop` (N,) so large that it may pass in between. The last distance before the first
        overlap is measured as far as `FOLLOWED`, for the time to contact.
        """
        along, near = self.clearance.along, self.near
        found = np.full((len(path), len(pairs)), near)
        now, columns = found[0], (rough < near).nonzero()[0]
        now[columns] = along(path[:1], pairs[columns], near)[0]
        columns = (now > 0).nonzero()[0]
        if columns.size:
            found[self.main[:, None], columns] = along(path[self.main], pairs[columns], near)
            columns = columns[(found.min(axis=0) < now - CLOSING)[columns] | (drop[columns] > LEAP)]
        if columns.size:
            found[self.other[:, None], columns] = along(path[self.other], pairs[columns], near)
        for column in ((now > 0) & (found <= 0).any(axis=0)).nonzero()[0].tolist():
            before = int((found[:, column] <= 0).argmax()) - 1
            if found[before, column] >= near:
                found[before, column] = along(path[before, None], pairs[column, None], FOLLOWED)[0, 0]
        return found

    def outlook(self, distances: Floats) -> Outlook:
        """What distances (1 + K, N) tell."""
        now, ahead = distances[0], distances[1:]
        least = ahead.min(axis=0)
        closing = least < now - CLOSING
        contact = np.full(len(now), np.inf)
        near = (closing & (least <= self.margin)).nonzero()[0]
        if near.size:
            contact[near] = self.times[1 + ahead[:, near].argmin(axis=0)]
        hit = ((now > 0) & (least <= 0)).nonzero()[0]
        if hit.size:
            contact[hit] = self._time_to_zero(distances[:, hit])
        contact[now <= 0] = 0.0
        sure = np.where(closing, (self.asked[:, None] - ahead).max(axis=0), -np.inf)
        depth = np.maximum(0.0, -np.minimum(now, least))
        return Outlook(now, np.where(closing, ahead[0], np.inf), contact, depth, sure)

    def _time_to_zero(self, distances: Floats) -> Floats:
        """When distances (1 + K, N), positive at first, reach zero, straight between instants [s]."""
        after, columns = (distances <= 0).argmax(axis=0), np.arange(distances.shape[1])
        outer, inner = distances[after - 1, columns], distances[after, columns]
        before = self.times[after - 1]
        return before + outer / (outer - inner) * (self.times[after] - before)


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
