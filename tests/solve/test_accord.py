"""Footholds in accord: what a robot can keep stays, what it cannot keep at once gives way until it can."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import Edges, build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.accord import KEPT, KNOWN, TOGETHER, Pair, given_way, in_accord
from robot_retarget.solve.footing import Foothold, footholds, held_corners, lengths
from robot_retarget.solve.frame import FrameSolver, Options
from robot_retarget.solve.problem import build_problem, frame_parameters
from robot_retarget.solve.sketch import sketch


@dataclass(frozen=True)
class Standing:
    """The first half second of a squat, sketched: both feet stand throughout."""

    solver: FrameSolver
    edges: Edges
    held: np.ndarray
    draft: list[Floats]
    footholds: list[Foothold]

    def agreed(self, asked: list[Foothold]) -> list[Foothold]:
        return in_accord(self.solver, self.edges, self.held, self.draft, asked)

    def missed(self, asked: list[Foothold]) -> float:
        """How far the robot's soles stay from footholds that it is sent to, over the leg length."""
        places = np.stack([hold.corners for hold in asked])
        wished = (*frame_parameters(self.edges, 4), *self.solver.grip.lead(self.held[4], places, np.zeros(2)))
        pose = self.solver.descend(self.draft[4], wished, iterations=40)
        off = np.linalg.norm((self.solver.corners(pose.qpos) - places)[..., :2], axis=-1)
        return float(off.max()) / self.solver.leg


@pytest.fixture(scope="module")
def standing() -> Standing:
    motion, robot = read_motion(SAMPLES / "squat.bvh").resample(15).frames(0, 8), load_robot("op3")
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    solver = FrameSolver(build_problem(robot, matched, edges), Options())
    held = held_corners(edges.stances, solver.problem.feet, len(edges))
    draft = sketch(solver, edges, held, 15).qpos
    return Standing(solver, edges, held, draft, footholds(held, np.array([solver.corners(q) for q in draft])))


def moved(hold: Foothold, turn: float = 0.0, shift: Floats | None = None) -> Foothold:
    """A foothold turned about its middle and shifted along the floor."""
    middle, (c, s) = hold.corners.mean(axis=0), (np.cos(turn), np.sin(turn))
    turned = (hold.corners - middle) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + middle
    return replace(hold, corners=turned if shift is None else turned + shift)


def test_footholds_that_a_pose_keeps_stay_as_they_are(standing: Standing) -> None:
    wider = [standing.footholds[0], moved(standing.footholds[1], turn=0.2)]
    assert standing.agreed(standing.footholds) == standing.footholds and standing.agreed(wider) == wider


@pytest.mark.parametrize(("turn", "nearer"), [(0.0, 0.8), (-2.5, 0.0), (0.8, 1.0)])
def test_footholds_that_no_pose_keeps_give_way_until_one_does(standing: Standing, turn: float, nearer: float) -> None:
    left, right = standing.footholds
    across = nearer * (left.corners.mean(axis=0) - right.corners.mean(axis=0))
    asked = [left, moved(right, turn, across)]
    assert standing.missed(asked) > 2 * KEPT
    assert standing.missed(standing.agreed(asked)) < KEPT


@pytest.mark.parametrize("turn", [-1.2, 1.2])
def test_footholds_that_stand_too_near_for_how_they_are_turned_keep_their_turn(standing: Standing, turn: float) -> None:
    left, right = standing.footholds
    asked = [left, moved(right, turn)]
    agreed = standing.agreed(asked)
    ahead, turned = (lengths(np.array([hold.corners for hold in holds])) @ [1.0, 1.0j] for holds in (asked, agreed))
    assert standing.missed(asked) > KEPT
    assert np.abs(np.angle((turned[1] / turned[0]) / (ahead[1] / ahead[0]))) < 0.02


def test_a_foothold_that_is_known_does_not_give_way(standing: Standing) -> None:
    left, right = standing.footholds
    across = 0.8 * (left.corners.mean(axis=0) - right.corners.mean(axis=0))
    known = replace(moved(right, shift=across), known=True)
    agreed = standing.agreed([left, known])
    assert np.abs(agreed[1].corners - known.corners).max() < 1e-5
    assert np.abs(agreed[0].corners - left.corners).max() > 0.01


@pytest.mark.parametrize("seed", range(3))
def test_what_gives_way_is_the_least_in_all(seed: int) -> None:
    draw = np.random.default_rng(seed)
    spans = np.sort(draw.integers(0, 50, (6, 2)), axis=1)
    holds = [Foothold(k % 2, int(a), int(b) + 1, np.zeros((4, 3)), known=k == 0) for k, (a, b) in enumerate(spans)]
    linked, nowhere = [(0, 1), (1, 2), (3, 4), (2, 5)], np.zeros((2, 4, 3))
    pairs = [Pair(a, b, int(draw.integers(1, 9)), False, nowhere, nowhere[..., 0] == 0) for a, b in linked]
    missing = draw.normal(size=4) + 1j * draw.normal(size=4)

    def cost(x: np.ndarray) -> float:
        firm = [KNOWN if hold.known else hold.stop - hold.start for hold in holds]
        between = [p.frames * abs(x[p.other] - x[p.one] - m) ** 2 for p, m in zip(pairs, missing, strict=True)]
        return float(firm @ np.abs(x) ** 2 + TOGETHER * sum(between))

    found = given_way(holds, pairs, missing)
    nudges = 1e-3 * (draw.normal(size=(50, 6)) + 1j * draw.normal(size=(50, 6)))
    assert all(cost(found + nudge) > cost(found) for nudge in nudges)
