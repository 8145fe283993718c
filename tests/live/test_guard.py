"""Goals of a guarded stream keep links apart, and pass unchanged where they do so already."""

import time

import numpy as np
import pytest
from made_trajectories import swing, wander

from robot_retarget.live.guard import OVERLAP, SelfCollisionGuard
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.contacts import replay_contacts


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def guarded(robot: Robot, goals: np.ndarray) -> np.ndarray:
    guard, safe = SelfCollisionGuard(robot), [robot.standing()]
    for goal in goals:
        safe.append(guard.admit(safe[-1], goal))
    return np.array(safe[1:])


@pytest.mark.parametrize("seed", range(4))
def test_no_goal_of_a_guarded_stream_collides(op3: Robot, seed: int) -> None:
    goals = wander(op3, 60, 30.0, seed).qpos
    assert (replay_contacts(op3, goals).depth > 0.001).any()
    assert not (replay_contacts(op3, guarded(op3, goals)).depth > 0.001).any()


def test_goals_that_keep_links_apart_pass_unchanged(op3: Robot) -> None:
    goals = swing(op3, "head_pan", 0.6, 0.5, 2.0, 30.0).qpos
    assert np.array_equal(guarded(op3, goals), goals)


def test_joints_that_waited_reach_their_goal_once_it_is_clear(op3: Robot) -> None:
    goals = np.concatenate([swing(op3, "l_sho_roll", 1.2, 0.25, 5.0, 30.0).qpos, op3.standing()[None]])
    safe = guarded(op3, goals)
    assert not np.array_equal(safe, goals)
    assert np.array_equal(safe[-1], goals[-1])


def test_an_overlap_at_the_start_does_not_grow(op3: Robot) -> None:
    folded = swing(op3, "l_sho_roll", 1.2, 0.25, 5.0, 30.0).qpos
    guard = SelfCollisionGuard(op3)
    start = folded[int(np.argmax([guard.separation.depth(q) for q in folded]))]
    deeper = start + 0.02 * (start - op3.standing())
    assert guard.separation.depth(start) > OVERLAP
    assert guard.separation.depth(guard.admit(start, deeper)) <= guard.separation.depth(start)
    out = guard.admit(start, start + 0.5 * (op3.standing() - start))
    assert guard.separation.depth(out) < guard.separation.depth(start)


def test_the_guard_takes_a_small_part_of_a_tick(op3: Robot) -> None:
    """A tick of the servos lasts 8 ms."""
    guard, goals = SelfCollisionGuard(op3), wander(op3, 60, 125.0).qpos
    taken, safe = [], op3.standing()
    for goal in goals:
        began = time.thread_time()
        safe = guard.admit(safe, goal)
        taken.append(time.thread_time() - began)
    assert np.median(taken) < 2e-3
