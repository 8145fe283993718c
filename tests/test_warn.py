"""Warnings: what is exact, what changes nothing, and that they come before the contact."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold, robot_of, wander
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.collision import PLANNED, State, Warner, Warnings, WarnOptions, warnings_of, write_csv
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.contacts import replay_contacts
from robot_retarget.robot.distances import LinkDistances
from robot_retarget.robot.kinematics import parts_between
from robot_retarget.trajectory import Trajectory

CARTS = """<mujoco><worldbody><body name="base"><geom size=".01" contype="0" conaffinity="0"/>
<body name="left" pos="-1 0 0"><joint name="l" type="slide" axis="1 0 0"/><geom size=".1"/></body>
<body name="right" pos="1 0 0"><joint name="r" type="slide" axis="1 0 0"/><geom size=".1"/></body>
<body name="arm" pos="0 0 9"><joint name="swing" axis="0 1 0"/><geom size=".1"/></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def links(op3: Robot) -> LinkDistances:
    return LinkDistances(op3)


@pytest.fixture(scope="module")
def waving(op3: Robot, links: LinkDistances) -> tuple[Trajectory, Warnings]:
    """A motion of all joints that collides, and its warnings as in a stream."""
    trajectory = wander(op3, 90, 30.0)
    return trajectory, warnings_of(trajectory, op3, links=links, planned=False)


def carts(tmp_path: Path, speed: float, fps: float = 30.0, seconds: float = 3.0) -> tuple[Trajectory, Robot]:
    """Two balls of radius 0.1 on a rail, 2 m apart, one going towards the other."""
    robot = robot_of(CARTS, tmp_path / "carts.xml")
    times = np.arange(round(seconds * fps) + 1) / fps
    qpos = np.zeros((len(times), 3))
    qpos[:, 0] = speed * times
    return Trajectory(qpos, fps, robot.joint_names, robot.name), robot


@pytest.mark.parametrize("fps", [24.0, 30.0, 60.0, 120.0])
def test_a_steady_approach_is_timed_exactly(tmp_path: Path, fps: float) -> None:
    trajectory, robot = carts(tmp_path, 0.8, fps)
    found = warnings_of(trajectory, robot, WarnOptions(horizon=0.5))
    pair = found.pairs.index(("left", "right"))
    times = np.arange(len(found)) / fps
    wait = 1.8 / 0.8 - times
    foreseen = (times > 0.1) & (wait > 0) & (wait < 0.46)
    assert found.time_to_contact[foreseen, pair] == pytest.approx(wait[foreseen], abs=1e-6)
    (event,) = found.events
    assert event.contact is not None and 0 <= event.contact / fps - 1.8 / 0.8 < 0.05
    assert event.predicted_contact == pytest.approx(1.8 / 0.8 * fps, abs=1)
    assert 0.3 < event.lead_s < 0.51


def test_what_passes_within_the_margin_is_timed_where_it_is_nearest(tmp_path: Path) -> None:
    mjcf = CARTS.replace('name="right" pos="1 0 0"', 'name="right" pos="1 0 .205"')
    robot, times = robot_of(mjcf, tmp_path / "passing.xml"), np.arange(91) / 30
    qpos = np.zeros((91, 3))
    qpos[:, 0] = 0.9 * times  # above the other, 5 mm away, after 2 / 0.9 s
    found = warnings_of(Trajectory(qpos, 30.0, robot.joint_names, robot.name), robot, WarnOptions(horizon=0.5))
    wait, foreseen = 2 / 0.9 - times, found.time_to_contact[:, found.pairs.index(("left", "right"))]
    soon = (wait > 0.1) & (wait < 0.33)
    assert np.abs(foreseen[soon] - wait[soon]).max() < 1 / 30  # half the way between two instants
    assert found.events and all(event.contact is None for event in found.events)
    assert warnings_of(Trajectory(qpos, 30.0, robot.joint_names, robot.name), robot, WarnOptions(margin=0)).events == []


def test_what_recedes_or_rests_is_not_flagged(tmp_path: Path) -> None:
    for speed in (0.0, -0.8):
        found = warnings_of(*carts(tmp_path, speed))
        assert not found.state.any() and found.events == []


def test_every_contact_is_warned_of_before_it_happens(
    op3: Robot, links: LinkDistances, waving: tuple[Trajectory, Warnings]
) -> None:
    trajectory, found = waving
    contacts = replay_contacts(op3, trajectory.qpos)
    index = {tuple(pair): k for k, pair in enumerate(links.links.tolist())}
    seen = 0
    for pair in contacts.pairs() & index.keys():
        first = int(contacts.of((contacts.bodies == pair).all(1)).frame.min())
        if first >= 3:
            seen += 1
            assert found.flagged[first - 1, index[pair]], pair
    assert seen >= 5


@pytest.fixture(scope="module")
def hasty(op3: Robot, links: LinkDistances) -> tuple[Trajectory, np.ndarray]:
    """A fast motion, and (T, P) whether MuJoCo finds an overlap on the way to each frame, in 16 configurations."""
    trajectory, parts = replace(wander(op3, 60, 7.5, seed=5), fps=30.0), 16
    times = np.arange(59 * parts + 1) / parts
    dense = np.column_stack([np.interp(times, np.arange(60), column) for column in trajectory.qpos.T])
    contacts, index = replay_contacts(op3, dense), {tuple(pair): k for k, pair in enumerate(links.links.tolist())}
    swept = np.zeros((60, len(links)), dtype=bool)
    for frame, bodies, depth in zip(contacts.frame, contacts.bodies.tolist(), contacts.depth, strict=True):
        if depth > 1e-3 and (column := index.get(tuple(sorted(bodies)))) is not None:
            swept[-(-frame // parts), column] = True
    return trajectory, swept


def test_links_that_sweep_past_each_other_between_frames_are_warned_of(
    op3: Robot, links: LinkDistances, hasty: tuple[Trajectory, np.ndarray]
) -> None:
    trajectory, swept = hasty
    found = warnings_of(trajectory, op3, links=links, planned=False)
    passed = swept[1:] & (found.distance[1:] > 0) & (found.distance[:-1] > 0)
    assert passed.sum() >= 3
    assert found.touching[1:][passed].all() and found.flagged[1:][passed].all()


def test_links_that_close_4_cm_in_a_frame_are_warned_of_before_or_then(
    op3: Robot, links: LinkDistances, hasty: tuple[Trajectory, np.ndarray]
) -> None:
    trajectory, swept = hasty
    found = warnings_of(trajectory, op3, links=links, planned=False)
    far = LinkDistances(op3, 0.05).along(trajectory.qpos)
    closed = swept[1:] & (far[:-1] > 0.04)
    closed[0] = False  # no step is known before
    assert closed.sum() >= 3
    assert found.flagged[1:][closed].all()


def test_a_stream_says_what_the_whole_says(
    op3: Robot, links: LinkDistances, waving: tuple[Trajectory, Warnings]
) -> None:
    trajectory, found = waving
    warner = Warner(op3, trajectory.fps, links=links)
    frames = [warner.update(q) for q in trajectory.qpos]
    for name in ("state", "alpha", "touching"):
        assert (np.concatenate([getattr(f, name) for f in frames]) == getattr(found, name)).all(), name
    for name in ("distance", "ahead", "time_to_contact"):
        assert np.concatenate([getattr(f, name) for f in frames]) == pytest.approx(getattr(found, name), abs=1e-9)


def test_moving_the_whole_robot_changes_nothing(
    op3: Robot, links: LinkDistances, waving: tuple[Trajectory, Warnings]
) -> None:
    trajectory, found = waving
    turn = Rotation.from_rotvec(np.linspace(0, 3, len(trajectory))[:, None] * [0.3, 0.5, 0.8])
    qpos = trajectory.qpos.copy()
    qpos[:, :3] = turn.apply(qpos[:, :3]) + np.linspace(0, 2, len(trajectory))[:, None]
    body = Rotation.from_quat(qpos[:, 3:7], scalar_first=True)
    qpos[:, 3:7] = (turn * body).as_quat(scalar_first=True)
    moved = warnings_of(replace(trajectory, qpos=qpos), op3, links=links, planned=False)
    assert moved.events == found.events


def test_the_frame_rate_changes_no_event_by_more_than_a_frame(op3: Robot, links: LinkDistances) -> None:
    fine = wander(op3, 4 * 90, 120.0)
    coarse = replace(fine, qpos=fine.qpos[::4], fps=30.0, source_time=fine.source_time[::4])
    events = [warnings_of(t, op3, links=links).events for t in (fine, coarse)]
    assert len(events[1]) > 5
    assert [e.pair for e in events[0]] == [e.pair for e in events[1]]
    for fast, slow in zip(*events, strict=True):
        assert abs(fast.first_warning / 4 - slow.first_warning) <= 1
        assert abs(fast.predicted_contact / 4 - slow.predicted_contact) <= 1
        assert (fast.contact is None) == (slow.contact is None)
        assert slow.contact is None or abs(fast.contact / 4 - slow.contact) <= 1


def test_a_longer_horizon_warns_no_later(op3: Robot, links: LinkDistances, waving: tuple[Trajectory, Warnings]) -> None:
    long = warnings_of(waving[0], op3, WarnOptions(horizon=0.2), links, planned=False)
    assert (waving[1].flagged <= long.flagged).all() and (long.flagged.sum() > waving[1].flagged.sum() > 0)


def test_the_interaction_distance_is_the_least_along_the_continued_steps(
    op3: Robot, links: LinkDistances, waving: tuple[Trajectory, Warnings]
) -> None:
    trajectory = replace(waving[0], qpos=waving[0].qpos[:30], source_time=waving[0].source_time[:30])
    found = warnings_of(trajectory, op3, WarnOptions(horizon=0.1), links, planned=False)
    for t in range(1, 30):
        step = trajectory.qpos[t] - trajectory.qpos[t - 1]
        k = np.arange(3 * (parts := int(parts_between(op3, step, 0 * step))) + 1) / parts
        ahead = links.along(np.array([_in_range(op3, trajectory.qpos[t], share * step) for share in k]))
        assert np.allclose(found.ahead[t], ahead.min(axis=0)) and np.allclose(
            found.alpha[t], 1 + k[ahead.argmin(axis=0)]
        )


def _in_range(robot: Robot, qpos: np.ndarray, step: np.ndarray) -> np.ndarray:
    moved, columns = qpos + step, robot.qpos_index
    moved[columns] = np.clip(moved[columns], robot.lower, robot.upper)
    return moved


def test_a_warning_does_not_flicker(op3: Robot, waving: tuple[Trajectory, Warnings]) -> None:
    trajectory, found = waving
    kept = round(WarnOptions().release * trajectory.fps)
    assert all(e.last - e.first_warning + 1 >= kept for e in found.events if e.last < len(trajectory) - 1)
    assert found.state.max() == State.CONTACT and (found.touching <= found.flagged).all()


def test_events_are_written_as_a_table(waving: tuple[Trajectory, Warnings], tmp_path: Path) -> None:
    lines = write_csv(waving[1].events, tmp_path / "warnings.csv").read_text().splitlines()
    assert lines[0].startswith("link_a,link_b,first_warning,predicted_contact,contact,lead_s")
    assert len(lines) == 1 + len(waving[1].events)


def test_bad_input_is_named(op3: Robot, links: LinkDistances, tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="need two frames"):
        warnings_of(hold(op3, 0.0), op3, links=links)
    with pytest.raises(TrajectoryError, match="not of 'op3'"):
        warnings_of(carts(tmp_path, 1.0)[0], op3, links=links)
    for fps in (0.0, -30.0, np.nan):
        with pytest.raises(UsageError, match="must be positive"):
            Warner(op3, fps, links=links)
    warner = Warner(op3, 30.0, links=links)
    for broken in (np.full(op3.model.nq, np.nan), np.zeros(3)):
        with pytest.raises(TrajectoryError, match="27 finite numbers"):
            warner.update(broken)
    for option in ({"horizon": 0.0}, {"horizon": np.nan}, {"release": -1.0}):
        with pytest.raises(UsageError):
            WarnOptions(**option)


def test_joints_that_keep_their_speed_do_as_planned(tmp_path: Path) -> None:
    """Two carts that roll towards each other at constant speed: the plan and the last step agree."""
    robot = robot_of(CARTS, tmp_path / "carts.xml")
    qpos = np.outer(np.arange(20) / 30, [0.9, -0.9, 0.0])
    rolling = Trajectory(qpos, 30.0, robot.joint_names, robot.name)
    for horizon in (1 / 30, 0.1):
        plan, step = (warnings_of(rolling, robot, WarnOptions(horizon=horizon), planned=p) for p in (True, False))
        np.testing.assert_allclose(plan.ahead, step.ahead, atol=1e-9)
        assert np.array_equal(plan.flagged, step.flagged)


def test_a_tenth_of_a_second_ahead_planned_warnings_come_true_and_miss_no_contact(
    op3: Robot, links: LinkDistances
) -> None:
    """Truth from the distances of the frames themselves: within 1 cm by the end of the horizon, and every touch warned of."""
    moves, ahead = wander(op3, 60, 30.0, seed=3), 3
    found = warnings_of(moves, op3, WarnOptions(horizon=PLANNED, release=0.0), links)
    least = np.array([found.swept[t : t + ahead + 1].min(axis=0) for t in range(len(moves))])
    raised = found.flagged[:-ahead] & found.closing[:-ahead]
    assert raised.sum() > 20 and (least[:-ahead][raised] < 0.01).mean() >= 0.95
    begins = np.argwhere((found.swept[1:] <= 0) & (found.swept[:-1] > 0))
    warned = [found.flagged[max(t - ahead, 0) : t + 1, pair].any() for t, pair in begins if t > 0]
    assert np.mean(warned) >= 0.95 and len(warned) > 10
