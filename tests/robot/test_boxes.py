"""Boxes near each other: against MuJoCo's distance of geoms, and against themselves in a mirror."""

import mujoco
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robot_retarget.robot import load_robot
from robot_retarget.robot.distances import Separation
from robot_retarget.robot.geoms import ON_SURFACE, Boxes, GeomDistances, Placed, allowed

REACH = 0.05
EXACT = 2e-6
"""Twice MuJoCo's own tolerance for convex shapes: either answer may be off by it [m]."""
SIZES = ((0.02, 0.03, 0.05), (0.04, 0.01, 0.02))


def two_boxes(sizes: tuple[tuple[float, float, float], ...] = SIZES) -> tuple[mujoco.MjModel, mujoco.MjData]:
    bodies = "".join(f'<body><freejoint/><geom type="box" size="{a} {b} {c}" mass="1"/></body>' for a, b, c in sizes)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    return model, mujoco.MjData(model)


def near_at(offset: np.ndarray, turn: Rotation, reach: float = REACH) -> tuple[GeomDistances, float]:
    """Places found, and the distance by MuJoCo, with the second box at an offset [m] and turned."""
    model, data = two_boxes()
    data.qpos[7:10], data.qpos[10:] = offset, turn.as_quat(scalar_first=True)
    mujoco.mj_kinematics(model, data)
    found = Boxes(model, np.array([[0, 1]]), reach).near(Placed.of(data))
    return found, mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)


placements = st.tuples(
    # MuJoCo tells no depth of boxes with one centre.
    st.tuples(*[st.floats(-0.1, 0.1)] * 3).map(np.array).filter(lambda offset: np.linalg.norm(offset) > 0.01),
    st.tuples(*[st.floats(-3, 3)] * 3).map(lambda turn: Rotation.from_rotvec(turn)),
)


@given(placements)
@settings(max_examples=200, deadline=None)
def test_the_nearest_place_is_as_far_as_mujoco_says(placement: tuple[np.ndarray, Rotation]) -> None:
    found, distance = near_at(*placement)
    if distance < REACH - 1e-6 and abs(distance) > ON_SURFACE:  # boxes that just touch have no direction between them
        assert abs(found.distance.min() - distance) < 1e-5
        assert (found.distance >= distance - 1e-5).all()


@given(placements)
@settings(max_examples=100, deadline=None)
def test_moved_apart_along_a_normal_they_are_farther_by_as_much(placement: tuple[np.ndarray, Rotation]) -> None:
    found, distance = near_at(*placement)
    if not 1e-3 < distance < REACH - 1e-3:
        return
    nearest = int(found.distance.argmin())
    first = int(found.geoms[nearest, 0])
    step = 1e-5 * found.normal[nearest] * (1 if first == 0 else -1)
    assert abs(near_at(placement[0] + step, placement[1])[1] - distance - 1e-5) < 2e-7


@given(placements)
@settings(max_examples=100, deadline=None)
def test_in_a_mirror_they_are_near_at_the_same_places(placement: tuple[np.ndarray, Rotation]) -> None:
    offset, turn = placement
    x, y, z = turn.as_rotvec()
    seen = [near_at(offset, turn), near_at(offset * [1, -1, 1], Rotation.from_rotvec([-x, y, -z]))]
    here, there = (np.sort(found.distance[found.distance < REACH - 1e-6]) for found, _ in seen)
    assert np.allclose(here, there, rtol=0, atol=EXACT)


def test_a_face_on_a_face_is_held_by_all_its_corners() -> None:
    found, distance = near_at(np.array([0.0, 0.0, 0.095]), Rotation.from_euler("y", 90, degrees=True))
    assert abs(distance - 0.005) < 1e-9
    assert (np.abs(found.distance - 0.005) < 1e-6).sum() >= 4
    assert np.allclose(np.abs(found.normal[found.distance < 0.006]), [0, 0, 1], atol=1e-6)


def test_nothing_that_is_near_goes_unseen() -> None:
    robot, reach = load_robot("op3"), 0.02
    separation, draw = Separation(robot, reach), np.random.default_rng(0)
    pairs = [pair for geoms in allowed(robot).values() for pair in geoms if separation.counts[pair]]
    qpos, compared = robot.neutral(), 0
    for _ in range(20):
        qpos[robot.qpos_index] = draw.uniform(robot.lower, robot.upper)
        found = separation.along(qpos[None])[0]
        gaps, geoms = found.distance, found.geoms
        least = dict.fromkeys(pairs, np.inf)
        for pair, gap in zip(map(tuple, np.sort(geoms, axis=1).tolist()), gaps, strict=True):
            least[pair] = min(least[pair], gap)
        for (a, b), gap in least.items():
            distance = mujoco.mj_geomDistance(separation.model, separation.places[0].data, a, b, reach, None)
            if distance < reach - 1e-4:
                assert abs(gap - distance) < 5e-4, (robot.model.geom(a), robot.model.geom(b))
                compared += 1
    assert compared > 300


MIRRORED_FEET = (
    (
        (-0.006211353295485018, 0.03911637498456881, 0.004070985601147298),
        (
            0.9999208236056195,
            0.012583288391375501,
            8.586687001100846e-05,
            -0.012583283138938884,
            0.9999208254711015,
            -6.143806856251477e-05,
            -8.663316447695856e-05,
            6.0352716980165296e-05,
            0.9999999944261223,
        ),
    ),
    (
        (-0.006211353295490475, -0.03911637498465989, 0.004070985601169426),
        (
            0.9999208236056141,
            -0.012583288391776835,
            8.586687009566535e-05,
            0.012583283139340169,
            0.9999208254710961,
            6.14380690941296e-05,
            -8.663316456832244e-05,
            -6.035271751063801e-05,
            0.999999994426122,
        ),
    ),
)
"""Centre [m] and rotation of two soles that overlap by 1.196 mm: `mj_geomDistance` gives 0 for them, to the last digits."""


def test_boxes_that_overlap_are_seen_also_where_mujoco_gives_no_distance() -> None:
    model, data = two_boxes(((0.057, 0.039, 0.004),) * 2)
    for geom, (place, turn) in enumerate(MIRRORED_FEET):
        data.geom_xpos[geom], data.geom_xmat[geom] = place, turn
    found = Boxes(model, np.array([[0, 1]]), REACH).near(Placed.of(data))
    assert abs(found.distance.min() + 0.001196) < 1e-6
