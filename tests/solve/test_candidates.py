"""The candidate set: the cheapest path through poses, and what whole clips cost against streams of both directions."""

import itertools
import runpy

import numpy as np
import pytest
from shared_files import ROOT

from robot_retarget.graph.describe import describe
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.candidates import DEEP, PASSING, SHARES, Candidates
from robot_retarget.solve.clip import coarse_tracks
from robot_retarget.solve.descent import FrameSolution
from robot_retarget.solve.options import Search
from robot_retarget.solve.problem import targets_of
from robot_retarget.solve.solve import problem_of
from robot_retarget.solve.sqp import FrameSolver

STARTS = runpy.run_path(str(ROOT / "scripts/bench/bench_starts.py"))


def filled(moments: int, poses: int) -> Candidates:
    """Return a set with drawn arms and costs at some moments of the OP3's clap."""
    graph = describe(read_motion(SAMPLES / "clap.bvh"), load_robot("op3"), fps=30).unbalanced()
    solver, draw = FrameSolver(problem_of(graph)), np.random.default_rng(3)
    found = Candidates(solver, graph, targets_of(coarse_tracks(graph)), np.arange(0, 3 * moments, 3), Search())
    arms = [
        solver.robot.joint_names.index(f"{side}_{name}") for side in "lr" for name in ("sho_pitch", "sho_roll", "el")
    ]
    for known in found.poses:
        for cost in draw.uniform(0.0, 3.0, poses):
            qpos = solver.robot.standing()
            qpos[solver.robot.qpos_index[arms]] += draw.uniform(-1.5, 1.5, len(arms))
            known.append(FrameSolution(qpos, np.int64(0), float(cost), 0))  # pyright: ignore[reportArgumentType]
    return found


def way_cost(found: Candidates, before: FrameSolution, after: FrameSolution, reach: np.ndarray) -> float:
    """Return the cost of a change by the words of the options, with MuJoCo's distances at every share of the way."""
    solver, search = found.solver, found.search_options
    turned = difference(solver.robot, before.qpos, after.qpos)
    hinges = np.abs(turned[solver.robot.dof_index])
    deep = max(solver.depth(integrate(solver.robot, before.qpos, share * turned)) for share in SHARES) / solver.leg
    through = search.through * deep**2 if deep > DEEP and hinges.max() > PASSING else 0.0
    beyond = np.maximum(hinges - reach, 0.0)
    return float(search.change * (turned**2).sum() + search.beyond_speed * (beyond**2).sum() + through)


def test_the_cheapest_path_is_that_of_all_paths_with_the_overlaps_on_their_ways() -> None:
    found = filled(4, 3)
    reach = found.bounds.speed.min(axis=0) * 0.1
    ways = {
        pair: way_cost(found, *pair, reach)
        for one, other in itertools.pairwise(found.poses)
        for pair in itertools.product(one, other)
    }
    every = {
        path: sum(pose.cost for pose in path) + sum(ways[pair] for pair in itertools.pairwise(path))
        for path in itertools.product(*found.poses)
    }
    chosen = tuple(found.cheapest())
    assert every[chosen] == pytest.approx(min(every.values()), rel=1e-9)
    assert max(found.through.values()) > 0, "the drawn poses have links in each other's way"


@pytest.mark.parametrize("clip", ["walk", "wave"])
def test_a_whole_clip_costs_no_more_than_passes_from_a_stream_of_either_direction(clip: str) -> None:
    _, found = STARTS["costs"](SAMPLES / f"{clip}.bvh", load_robot("op3"))
    assert found[0] <= STARTS["ROUNDING"] * min(found[1:])
