"""The candidate set: the cheapest path through poses, and what whole clips cost against streams of both directions."""

import itertools
import runpy
from dataclasses import replace

import numpy as np
import pytest
from shared_files import ROOT

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solver.candidates import DEEP, SHARES, Candidates, PoseChain, dearest
from robot_retarget.solver.clip import coarse_tracks
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.options import Search
from robot_retarget.solver.solve import problem_of
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.starts import _spread

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


def change_cost(found: Candidates, before: FrameSolution, after: FrameSolution, reach: np.ndarray) -> float:
    """Return the cost of a change by the words of the options."""
    solver, search = found.solver, found.search_options
    turned = difference(solver.robot, before.qpos, after.qpos)
    beyond = np.maximum(np.abs(turned[solver.robot.dof_index]) - reach, 0.0)
    return float(search.change * (turned**2).sum() + search.beyond_speed * (beyond**2).sum())


def way_cost(found: Candidates, before: FrameSolution, after: FrameSolution, reach: np.ndarray) -> float:
    """Return the cost of a change with MuJoCo's distances at every share of the way."""
    solver = found.solver
    turned = difference(solver.robot, before.qpos, after.qpos)
    deep = max(solver.depth(integrate(solver.robot, before.qpos, share * turned)) for share in SHARES) / solver.leg
    through = found.search_options.through * deep**2 if deep > DEEP else 0.0
    return change_cost(found, before, after, reach) + through


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


def test_a_pose_is_followed_until_a_change_to_the_cheapest_costs_less_than_its_excess() -> None:
    found = filled(3, 1)
    cheapest, start = found.poses[1][0], found.poses[0][0]
    dear = replace(cheapest, qpos=found.poses[2][0].qpos)
    change = change_cost(found, dear, cheapest, found.bounds.speed.min(axis=0) * 0.1)
    for share, goes_on in ((0.99, True), (1.01, False)):
        found.poses[1][1:] = []
        pose = replace(dear, cost=cheapest.cost + share * change)
        assert (found._longer(PoseChain(start, 0, 1), 1, pose) is not None) == goes_on


def test_a_pose_of_less_cost_is_followed_to_the_other_end_of_a_clip_past_poses_of_other_basins() -> None:
    """Four seconds of a human who stands still, where each moment knows a dearer pose."""
    motion = read_motion(SAMPLES / "wave.bvh").frames(0, 1)
    still = replace(motion, positions=np.repeat(motion.positions, 121, axis=0), rotations=None, whole=None)
    graph = describe(still, load_robot("op3"), fps=30).unbalanced()
    solver = FrameSolver(problem_of(graph))
    found = Candidates(solver, graph, targets_of(coarse_tracks(graph)), np.arange(0, 121, 3), Search())
    (cheap,) = found._reached([40])
    aside = cheap.qpos.copy()
    aside[solver.robot.qpos_index[[solver.robot.joint_names.index(f"{side}_sho_pitch") for side in "lr"]]] += 1.0
    for known in found.poses:
        known.append(replace(cheap, qpos=aside, cost=2 * cheap.cost))
    found._follow([PoseChain(cheap, 40, -1)])
    assert min(pose.cost for pose in found.poses[0]) <= 1.01 * cheap.cost


def test_bridges_between_basins_are_within_reach_of_the_joints() -> None:
    found = filled(10, 1)
    base, hinges = found.solver.robot.standing(), found.hinges
    raised = base.copy()
    raised[hinges[[found.solver.robot.joint_names.index(f"{side}_sho_pitch") for side in "lr"]]] += [1.4, -1.4]
    for k, known in enumerate(found.poses):
        known[:] = [replace(known[0], qpos=base if k < 5 else raised)]
    found.bridge()
    added = [k for k, known in enumerate(found.poses) if len(known) > 1]
    assert len(added) > 2, "1.4 rad take more than two moments"
    turns = np.abs(np.diff([known[-1].qpos[hinges] for known in found.poses], axis=0))
    kept = np.full(len(turns), found.search_options.same)  # a pose nearer than this to the paced one stays
    kept[added[0] : added[-1]] = 0.0
    assert (turns <= found.bounds.speed.min(axis=0) * 0.1 + kept[:, None] + 1e-9).all()


def test_starts_take_draws_of_a_limb_that_lie_apart_first() -> None:
    draws = np.random.default_rng(5).uniform(-3.0, 3.0, (80, 3))
    spread = _spread(draws, 2.0)
    assert (spread[0] == draws[0]).all() and np.array_equal(np.unique(spread, axis=0), np.unique(draws, axis=0))
    first = next(k for k in range(1, 80) if np.abs(spread[:k] - spread[k]).max(axis=1).min() <= 2.0)
    assert first > 4, "several basins of an arm"
    assert all(np.abs(spread[:first] - own).max(axis=1).min() <= 2.0 for own in draws)


@pytest.mark.parametrize("clip", ["walk", "wave"])
def test_a_whole_clip_costs_no_more_than_passes_from_a_stream_of_either_direction(clip: str) -> None:
    _, found = STARTS["costs"](SAMPLES / f"{clip}.bvh", load_robot("op3"))
    assert found[0] <= STARTS["ROUNDING"] * min(found[1:])


@pytest.mark.parametrize("most", [0, 1, 3, 20])
def test_the_dearest_moments_are_the_largest_costs_that_have_no_larger_neighbour_chosen(most: int) -> None:
    cost = np.random.default_rng(most).permutation(12).astype(float)
    chosen = dearest(cost.tolist(), most)
    assert chosen[0] == cost.argmax() and len(chosen) <= max(most, 1) and np.diff(sorted(chosen)).min(initial=2) > 1
    left = set(range(12)) - {near for k in chosen for near in (k - 1, k, k + 1)}
    assert len(chosen) == max(most, 1) or not left
    for k in left:
        assert cost[k] < min(cost[chosen])
