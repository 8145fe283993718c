"""Near links of many configurations at once: against each configuration alone, and against MuJoCo's own constraints."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.robot import load_robot
from robot_retarget.robot.distances import Separation

REACH = 0.03
OP3 = load_robot("op3")
SEPARATION = Separation(OP3, REACH, feet=frozenset())


def drawn(seed: int, count: int) -> np.ndarray:
    """(count, nq) configurations with the root low over the floor and turned, and all hinges within their ranges."""
    draw = np.random.default_rng(seed)
    qpos = np.repeat(OP3.standing()[None], count, axis=0)
    root = OP3.root_address
    qpos[:, root + 2] = draw.uniform(0.0, 0.3, count)
    turn = draw.normal(size=(count, 4))
    qpos[:, root + 3 : root + 7] = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    qpos[:, OP3.qpos_index] = draw.uniform(OP3.lower, OP3.upper, (count, len(OP3.lower)))
    return qpos


@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
@settings(max_examples=15, deadline=None)
def test_configurations_measured_together_are_near_as_each_alone(seed: int, count: int) -> None:
    qpos = drawn(seed, count)
    together, slopes = SEPARATION.along(qpos)
    assert (np.diff(together.frame) >= 0).all()
    for frame, q in enumerate(qpos):
        found, slope = SEPARATION.along(q[None])
        distance, geoms = found.distance, found.geoms
        own = together.frame == frame
        np.testing.assert_array_equal(together.geoms[own], geoms)
        np.testing.assert_allclose(together.distance[own], distance, atol=1e-12)
        np.testing.assert_allclose(slopes[own], slope, atol=1e-12)


def test_slopes_are_the_rows_of_mujocos_constraints() -> None:
    """The engine has one row per contact along its normal; pairs of boxes are not compared, they have places of their own."""
    robot = replace(OP3, model=copy.copy(OP3.model))  # a robot of its own, whose model may change
    separation = Separation(robot, REACH, feet=frozenset())
    model, compared = separation.model, 0
    model.geom_condim[:] = 1
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_EQUALITY | off.mjDSBL_FRICTIONLOSS | off.mjDSBL_LIMIT
    for q in drawn(0, 20):
        found, slope = separation.along(q[None])
        geoms = found.geoms
        data = separation.places[0].data
        mujoco.mj_makeConstraint(model, data)
        rows = data.efc_J.reshape(-1, model.nv)
        for contact in data.contact:
            if separation.seen[tuple(contact.geom)]:
                same = slope[(geoms == contact.geom).all(axis=1)]
                assert np.abs(same - rows[contact.efc_address]).max(axis=1).min() < 1e-9
                compared += 1
    assert compared > 20
