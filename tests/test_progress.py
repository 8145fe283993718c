"""Progress counts up to the end, over stages that follow each other too."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st
from made_trajectories import hold
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.progress import Count, consecutive


@given(st.integers(1, 50), st.integers(1, 50), st.integers(0, 80))
def test_two_computations_count_as_one(first: int, second: int, expected: int) -> None:
    told: list[tuple[int, int]] = []
    before, after = consecutive(lambda done, total: told.append((done, total)), expected)
    for progress, steps in ((before, first), (after, second)):
        count = Count(progress, steps)
        for _ in range(steps):
            count.advance()
    assert [done for done, _ in told] == list(range(1, first + second + 1))
    assert told[first - 1] == (first, first + expected) and told[-1] == (first + second, first + second)


def test_retargeting_tells_of_draft_and_balance() -> None:
    told: list[tuple[int, int]] = []
    motion, robot = rr.read_motion(ROOT / "samples/wave.bvh").frames(0, 60), rr.load_robot("op3")
    rr.retarget(motion, robot, balance="static", progress=lambda done, total: told.append((done, total)))
    done, total = zip(*told, strict=True)
    assert list(done) == sorted(done) and all(d <= t for d, t in zip(done, total, strict=True))
    assert done[-1] > 0.5 * total[-1], "half a round more was expected at most"
    assert max(b - a for a, b in pairwise(done)) < 0.2 * total[-1], "no stage goes by in silence"


def test_a_simulation_counts_every_time_it_plays() -> None:
    told: list[tuple[int, int]] = []
    robot = rr.load_robot("op3")
    rr.simulate(hold(robot, 0.4), robot, mode="free", draws=2, progress=lambda done, total: told.append((done, total)))
    assert [done for done, _ in told] == sorted({done for done, _ in told}) and told[-1][0] == told[-1][1]
