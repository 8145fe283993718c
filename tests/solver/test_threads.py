"""Threads share the frames of a clip: the result is that of one thread, bit by bit."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.distances import LEAST_ROWS, in_parts
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.pipeline import solve


def test_threads_change_no_bit_of_a_clip() -> None:
    graph = describe(read_motion(SAMPLES / "wave.bvh").frames(0, 3 * LEAST_ROWS), load_robot("op3")).unbalanced()
    alone, *shared = (solve(graph, options=SolveOptions(threads=n)).trajectory.qpos for n in (1, 2, 3))
    for qpos in shared:
        np.testing.assert_array_equal(alone, qpos)


def test_threads_of_linear_algebra_change_no_bit_of_a_clip() -> None:
    graph = describe(read_motion(SAMPLES / "clap.bvh").frames(0, 20), load_robot("op3")).unbalanced()
    found, libraries = [], ThreadpoolController()
    for threads in (1, 2):
        with libraries.limit(limits=threads, user_api="blas"):
            found.append(solve(graph).trajectory.qpos)
    np.testing.assert_array_equal(*found)


def test_clips_that_are_solved_at_once_have_every_bit_of_each_alone() -> None:
    robot, motion = load_robot("op3"), read_motion(SAMPLES / "clap.bvh")
    graphs = [describe(motion.frames(first, 20), robot).unbalanced() for first in (8, 0, 4)]
    with ThreadpoolController().limit(limits=2, user_api="blas"):
        alone = [solve(graph).trajectory.qpos for graph in graphs]
        with ThreadPoolExecutor(len(graphs)) as pool:
            at_once = [solution.trajectory.qpos for solution in pool.map(solve, graphs)]
    for one, other in zip(alone, at_once, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("count", "threads"), [(0, 2), (1, 2), (LEAST_ROWS, 3), (5 * LEAST_ROWS, 2), (5 * LEAST_ROWS + 1, 4)]
)
def test_parts_cover_every_row_once_in_order(count: int, threads: int) -> None:
    rows = in_parts(lambda _, part: list(range(count)[part]), count, threads)
    assert [row for part in rows for row in part] == list(range(count))
    assert len(rows) <= threads


def test_no_two_parts_share_a_number() -> None:
    numbers = in_parts(lambda number, _: number, 100 * LEAST_ROWS, 4)
    assert numbers == [0, 1, 2, 3]
