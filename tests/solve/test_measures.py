"""What edges measure on a robot: by plain arithmetic on MuJoCo's frames; its Jacobian by central differences."""

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.describe.edges import Edges, build_edges
from robot_retarget.describe.match import Match, match
from robot_retarget.motion import read_motion
from robot_retarget.robot import Robot, load_robot, world_points
from robot_retarget.robot.kinematics import body_frames, integrate
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.measures import Measures, build_measures

MODELS = sorted(SHARED.glob("robots/*/*.xml"))


def measured(name: str) -> tuple[Robot, Match, Edges, Measures]:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 3), load_robot(name)
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    return robot, matched, edges, build_measures(robot, matched, edges)


def somewhere(robot: Robot) -> np.ndarray:
    return integrate(robot, robot.standing(), np.random.default_rng(5).normal(scale=0.4, size=robot.model.nv))


def check_slopes(name: str) -> None:
    robot, _, _, measures = measured(name)
    q, step = somewhere(robot), 1e-6
    _, slopes, _, height_slopes = measures.slopes(q)
    for column, direction in enumerate(np.eye(robot.model.nv)):
        ahead, behind = (measures.slopes(integrate(robot, q, sign * step * direction)) for sign in (1, -1))
        for k, slope in ((0, slopes), (2, height_slopes)):
            expected = (ahead[k] - behind[k]).full().ravel() / (2 * step)
            assert np.allclose(slope.full()[:, column], expected, atol=1e-7)


def test_slopes_agree_with_central_differences() -> None:
    check_slopes("op3")


@needs_shared
@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_robots_slopes_agree_with_central_differences(path) -> None:
    check_slopes(path)


def test_measures_are_lengths_directions_places_and_angles() -> None:
    robot, matched, edges, measures = measured("op3")
    q = somewhere(robot)
    x = world_points(robot, matched.points, q[None])[0]
    x[matched.index("pelvis")] = (x[matched.index("l_hip")] + x[matched.index("r_hip")]) / 2
    apart, lines = (x[both[:, 0]] - x[both[:, 1]] for both in (edges.pairs, edges.lines))
    turns = body_frames(robot, q[None])[1][0]
    frames = [matched.anatomy.frames[segment] for segment in edges.segments]
    markers = [(turns[body] @ axes)[:, [0, 2]].T for body, axes in frames]
    expected = [
        np.linalg.norm(apart, axis=1),
        (lines / np.linalg.norm(lines, axis=1, keepdims=True)).ravel(),
        np.array(markers).ravel(),
        x[matched.index("pelvis")],
        q[robot.qpos_index],
        measures.corners(q).full().ravel(),
    ]
    for found in (measures.values(q), measures.slopes(q)[0]):
        assert np.allclose(found.full().ravel(), np.concatenate(expected), atol=1e-9)


def test_a_dof_that_carries_both_ends_leaves_a_length_alone() -> None:
    robot, _, edges, measures = measured("op3")
    slopes = measures.slopes(somewhere(robot))[1].full()[: len(edges.pairs)]
    assert (slopes[:, :6] == 0).all()
    assert 0 < (slopes != 0).mean() < 0.5
