"""Clips of any length, piece by piece."""

from itertools import pairwise

import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.robot.kinematics import difference
from robot_retarget.solver import solve
from robot_retarget.solver.options import Smoothing, Windows

SHORT = Smoothing(windows=Windows(length=1.2, kept=0.3, foreseen=0.3))


@pytest.fixture(scope="module")
def walk() -> rr.Motion:
    return rr.read_motion(ROOT / "samples/walk.bvh").resample(30).frames(0, 110)


def test_a_clip_of_one_piece_is_solved_as_a_whole(walk: rr.Motion) -> None:
    robot, clip = rr.load_robot("op3"), walk.frames(0, 40)
    whole = rr.retarget(clip, robot, smoothing=SHORT, balance="off").trajectory
    piece = solve.solve_long(clip, robot, smoothing=SHORT)
    np.testing.assert_array_equal(piece.qpos, whole.qpos)
    np.testing.assert_array_equal(piece.source_time, whole.source_time)
    assert piece.source_sha256 == whole.source_sha256 == walk.source_sha256 != ""


def test_pieces_join_without_a_seam_and_stay_near_the_whole(walk: rr.Motion, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solve, "PIECE", 2)
    robot = rr.load_robot("op3")
    pieces, whole = (
        solve.solve_long(walk, robot, smoothing=SHORT).qpos,
        rr.retarget(walk, robot, smoothing=SHORT, balance="off").trajectory.qpos,
    )
    assert pieces.shape == whole.shape
    steps = [np.abs([difference(robot, a, b) for a, b in pairwise(q)]).max() for q in (pieces, whole)]
    assert steps[0] < 1.1 * steps[1]
    assert np.abs(pieces - whole).max() < 0.12, "within what a foothold that is placed anew moves a leg"
    assert np.sqrt(((pieces - whole) ** 2).mean()) < 0.02
