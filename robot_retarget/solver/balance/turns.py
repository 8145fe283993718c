"""Turns of the robot in small steps: for a human's spin on the ball of a foot, flat soles step around, with the gap of the robot's stand."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, intervals

TURN = 1.0
"""Turn of a foot per step, which hips have either way over a stance [rad]: a hip that turns by half of it meanwhile is no slower than the leg of the shortest swing. A pirouette and a
dance of four turns keep the OP3's zero moment point 11 mm inside the support with 1.0 and 1.2, 6 and 1 mm with 1.28; with 1.5 it tips."""
HANG = 0.5
"""A foot that waits for a slow turn lifts this time before it comes down [s]. With half and double the OP3 takes 2.27 and 2.24 instead of
2.23 times the human's time for a pirouette."""


def turning_steps(
    planted: np.ndarray, corners: Floats, own: Floats, turns: Floats, fps: float, most: float
) -> tuple[np.ndarray, Floats]:
    """Return planted feet and soles that step around where the body turns by more than two steps over a stance; the inner foot steps first.

    Args:
        planted: (T, 2) feet on the floor, at least one at every frame.
        corners: (T, 2, 4, 3) of the soles [m].
        own: (2, 4, 3) corners in the robot's own stand, ahead along x, around the origin [m].
        turns: (T,) heading of the body [rad].
        fps: frames per second [1/s].
        most: turn of a foot per step [rad].
    """
    steps, placed, spins = planted.copy(), corners.copy(), np.zeros(len(planted), bool)
    for foot, (start, stop) in ((k, span) for k in range(2) for span in intervals(planted[:, k])):
        headings, middle = turns[start:stop], corners[start:stop, foot].mean(axis=1)
        if np.ptp(headings) > 2 * most:
            spins[start:stop] = True
            placed[start:stop, foot] = turned_soles(own[foot] - own[foot].mean(axis=0), headings) + middle[:, None]
    for start, stop in intervals(spins):
        swings, last = list[tuple[int, int]](), start
        for t in range(start + 2, stop):
            due = most / (4 if abs(turns[t] - turns[stop - 1]) < most / 8 else 2)  # the last step ends the turn
            if t >= last + 2 and abs(turns[t] - turns[last]) >= due:
                still = last + np.flatnonzero(np.abs(turns[last:t] - turns[last]) < most / 8)[-1]
                swings.append((min(max(still + 1, t - round(HANG * fps)), t - 1), t))
                last = t
        span = slice(swings[0][0], last + 1)
        down, steps[span] = planted[span], True
        first = int(turns[last] < turns[start]) if down[0].all() else int(down[0, 0])
        for k, (lift, land) in enumerate(swings):
            steps[lift:land, (first + k) % 2] = False
        middle = np.einsum("tf,tfcj->tj", down, corners[span]) / (4 * down.sum(axis=1)[:, None])
        placed[span] = turned_soles(own, turns[span]) + middle[:, None, None]
    return steps, placed


def turned_soles(own: Floats, turns: Floats) -> Floats:
    """Return (T, …, 4, 3) soles (…, 4, 3) turned about the vertical through the origin by angles (T,) [rad]."""
    return np.einsum("tij,...j->t...i", Rotation.from_euler("z", turns[:, None]).as_matrix(), own)
