"""Order, unit and axes of a BVH file change neither the motion nor the trajectory."""

import itertools
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rewritten_bvh import rewritten
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.bvh import read_bvh
from robot_retarget.human.upright import turn_to_z

pytestmark = needs_shared
FOLDER = SHARED / "motions" / "bvh"
UNITS = {"cm": 100.0, "inch": 1 / 0.0254, "m": 1.0}
ORDERS = ["".join(axes) for axes in itertools.permutations("XYZ")]
CLIPS = {
    # A clip and the axis that points up in its file.
    "cmu_cgspeed_motionbuilder/npybvh_example_run": "+y",
    "biovision_classic/mocapbank_sit": "+y",
    "captury_like_mixed_orders/bvh_example_zup": "+z",
    "lafan1_procedural/fall_getup_procedural": "+y",
    "makehuman_zup/mh_zombieWalk1": "+z",
    "soma30_derived/soma30_pick_up_from_ground": "+y",
    "xsens_mvn/bvh_test2": "+y",
}


@cache
def as_it_is(clip: str) -> tuple[Motion, float]:
    """The motion, and metres in a unit of its file."""
    path = FOLDER / f"{clip}.bvh"
    motion, capture = read_motion(path, repair=False), read_bvh(path)
    last = slice(len(capture.positions) - len(motion), None)
    sizes = [np.linalg.norm(x - x[:, :1], axis=2).max() for x in (motion.positions, capture.positions[last])]
    return motion, sizes[0] / sizes[1]


def again(clip: str, folder: Path, order: str, unit: str, up: str) -> Motion:
    """The motion of the clip as it is rewritten."""
    metres, turn = as_it_is(clip)[1], turn_to_z(CLIPS[clip])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Gimbal lock")
        text = rewritten(FOLDER / f"{clip}.bvh", order, metres * UNITS[unit], turn_to_z(up).T @ turn)
    path = folder / "again.bvh"
    path.write_text(text)
    return read_motion(path, repair=False)


PAIRWISE = [
    (clip, order, list(UNITS)[(c + k) % 3], "+y" if (c + k // 3) % 2 else "+z")
    for c, clip in enumerate(CLIPS)
    for k, order in enumerate(ORDERS)
]
"""Every two values of clip, order, unit and up axis meet in one of these."""


def test_every_two_values_meet() -> None:
    for one, other in itertools.combinations(range(4), 2):
        values = [{row[place] for row in PAIRWISE} for place in (one, other)]
        assert {(row[one], row[other]) for row in PAIRWISE} == set(itertools.product(*values))


@pytest.mark.parametrize(("clip", "order", "unit", "up"), PAIRWISE)
def test_order_unit_and_up_axis_change_nothing(clip: str, order: str, unit: str, up: str, tmp_path: Path) -> None:
    plain, other = as_it_is(clip)[0], again(clip, tmp_path, order, unit, up)
    assert other.skeleton.names == plain.skeleton.names
    assert other.positions == pytest.approx(plain.positions, abs=2e-5)
    turns = [
        Rotation.from_quat(np.reshape(np.asarray(m.rotations), (-1, 4)), scalar_first=True) for m in (plain, other)
    ]
    assert (turns[0].inv() * turns[1]).magnitude().max() < 1e-5


def test_the_trajectory_is_the_same(tmp_path: Path) -> None:
    clip, robot = "soma30_derived/soma30_pick_up_from_ground", rr.load_robot("op3")
    motions = as_it_is(clip)[0], again(clip, tmp_path, "YXZ", "inch", "+z")
    here, there = (rr.retarget(m.frames(0, 40), robot, fps=10, balance="off").trajectory.qpos for m in motions)
    assert here == pytest.approx(there, abs=5e-3)
