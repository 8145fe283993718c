"""Footholds as they come, for a solver that goes frame by frame.

A planted human foot stands still. Carried over to the robot it is the same place whenever a stance is first seen, and
whatever the robot did before: so the feet of a stream do not depend on where it began.
"""

import numpy as np

from robot_retarget.arrays import Floats, Ints, leftward, unit
from robot_retarget.describe.contacts import intervals
from robot_retarget.describe.edges import Edges
from robot_retarget.describe.segments import heading
from robot_retarget.robot import Points, world_points
from robot_retarget.solve.footing import CORNERS, LANDING, laid, lengths, nearing, sole_corners
from robot_retarget.solve.problem import Problem


class Stepping:
    """Where feet stand: those that stand from the beginning where they are reckoned to, a foot that begins to stand where
    it just was. Before that it was led along its own way to where it is reckoned to settle.
    """

    def __init__(self, held: np.ndarray, flat: Floats, tilted: Floats, fps: float):
        """What is held (T, F, 4), and where corners are reckoned to be (T, F, 4, 3) [m], of soles laid flat and as they are
        tilted; not finite where nobody knows.
        """
        self.held, self.known = held, np.asarray(np.isfinite(flat).all(axis=(2, 3)))
        stands, lead = np.asarray(held.any(axis=2)), round(LANDING * fps)
        self.near = nearing(stands, lead)
        self.settled = np.take_along_axis(flat, settling(stands, lead)[:, :, None, None], axis=0)
        # The tilt goes at the very last: a sole that is wished flat in the air makes an ankle roll to and fro.
        self.coming = tilted + self.near[:, :, None, None] ** 2 * (self.settled - tilted)
        self.places = np.zeros(flat.shape[1:])
        self.before = np.zeros(held.shape[1:], dtype=bool)

    def at(self, frame: int, corners: Floats) -> tuple[np.ndarray, Floats, Floats]:
        """What is held at a frame, where, and how near to standing feet are, as `Grip.land` takes them.

        A foot is laid down when it begins to stand, and again, about the edge that stands already, when it comes to
        stand on the whole sole.

        Args:
            corners: (F, 4, 3) of the frame before [m].
        """
        now, known, stands = self.held[frame], self.known[frame], np.asarray(self.held[frame].any(axis=1))
        if frame == 0:
            corners = np.where(known[:, None, None], self.settled[0], corners)
        lands = stands & (~self.before.any(axis=1) | (now.all(axis=1) & ~self.before.all(axis=1)))
        if lands.any():
            self.places[lands] = laid(corners[lands], now[lands].all(axis=1))
        led = known & ~stands
        self.places[led] = self.coming[frame, led]
        self.before = now
        return now, self.places, np.where(known, self.near[frame], 0.0)


def settling(stands: np.ndarray, lead: int) -> Ints:
    """(T, F) the frame by which feet that begin to stand have settled: `lead` after, as seen from so many before."""
    settled = np.repeat(np.arange(len(stands))[:, None], stands.shape[1], axis=1)
    for foot in range(stands.shape[1]):
        for start, stop in intervals(stands[:, foot]):
            settled[max(start - lead, 0) : start + 1, foot] = min(start + lead, stop - 1)
    return settled


def reckoned_soles(problem: Problem, edges: Edges) -> tuple[Floats, Floats]:
    """(T, F, 4, 3) the corners of every sole along the floor [m], of one laid flat and of one tilted as the human's: its
    ankle where the scaled human's is, further out by as much as the robot's hips are wider; nan for feet whose ankle or
    hips either body lacks.
    """
    left = leftward(heading(edges.facing))
    outward = {"l": left, "r": -left}
    flat, tilted = (np.full((len(edges), len(problem.feet), CORNERS, 3), np.nan) for _ in range(2))
    for k, foot in enumerate(problem.feet):
        if foot in edges.tracks:
            hip, sole = _hip_and_sole(problem, foot)
            ankle, turn = edges.tracks[foot] + hip * outward[foot], _turn(edges, foot)
            for found, axes in ((flat, _level(turn)), (tilted, turn)):
                found[:, k, :, :2] = ankle[:, None] + sole @ axes[:, :2].swapaxes(1, 2)
                found[:, k, :, 2] = 0.0
    return flat, tilted


def _turn(edges: Edges, foot: str) -> Floats:
    """(T, 3, 3) how a foot is turned, as far as it is known."""
    segment = f"{foot}_foot"
    return edges.frames[:, edges.segments.index(segment)] if segment in edges.segments else edges.facing


def _level(turn: Floats) -> Floats:
    """(T, 3, 3) frames upright, with the heading they have."""
    ahead, level = heading(turn), np.zeros((len(turn), 3, 3))
    level[:, :2, 0], level[:, :2, 1], level[:, 2, 2] = ahead, leftward(ahead), 1.0
    return level


def _hip_and_sole(problem: Problem, foot: str) -> tuple[float, Floats]:
    """Half the hips' width [m], and (4, 3) the corners of a sole ahead of its ankle, to the left and up [m]; standing."""
    robot, anatomy = problem.robot, problem.match.anatomy
    spots, corners = anatomy.spots, sole_corners(anatomy, foot)
    named = [spots[k] for k in ("l_hip", "r_hip", f"{foot}_ankle")]
    points = Points(
        np.append([spot.body for spot in named], corners.bodies),
        np.vstack([*(spot.offset for spot in named), corners.offsets]),
    )
    left, right, ankle, *sole = world_points(robot, points, robot.standing()[None])[0]
    along = np.array(sole) - ankle
    ahead = unit(lengths(along))
    own = np.column_stack([along[:, :2] @ ahead, along[:, :2] @ leftward(ahead), along[:, 2]])
    return float(np.linalg.norm((left - right)[:2])) / 2, own
