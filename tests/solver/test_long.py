"""Clips of any length, piece by piece."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import swing
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.robot.kinematics import difference
from robot_retarget.solver import solve
from robot_retarget.solver.options import Smoothing, Windows

SHORT = Smoothing(windows=Windows(length=1.2, kept=0.3, foreseen=0.3))


@pytest.fixture(scope="module")
def walk() -> rr.Motion:
    return rr.read_motion(ROOT / "samples/walk.bvh").resample(30).frames(0, 110)


def test_a_clip_of_one_piece_is_solved_as_a_whole() -> None:
    """With its bodies, figures and notes."""
    scenes, robot = ROOT / "samples/scenes", rr.load_robot("op3")
    clip = rr.read_motion(scenes / "box.bvh").resample(30).frames(0, 40)
    result = rr.retarget(clip, robot, smoothing=SHORT, balance="off", scene=scenes / "box.toml")
    piece, notes = solve.solve_long(clip, robot, smoothing=SHORT, scene=scenes / "box.toml")
    whole = result.trajectory
    np.testing.assert_array_equal(piece.qpos, whole.qpos)
    np.testing.assert_array_equal(piece.source_time, whole.source_time)
    assert piece.source_sha256 == whole.source_sha256 == clip.source_sha256 != ""
    assert piece.likeness == whole.likeness and notes == result.notes
    assert piece.scene is not None and whole.scene is not None and piece.scene.names == whole.scene.names
    np.testing.assert_allclose(piece.scene.poses(40), whole.scene.poses(40), atol=1e-12)


def test_pieces_join_without_a_seam_and_stay_near_the_whole(
    walk: rr.Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A head that follows a file does so in the time of the clip."""
    monkeypatch.setattr(solve, "PIECE", 2)
    robot = rr.load_robot("op3")
    turning = swing(robot, "head_pan", 0.4, 0.25, 5.0)
    turning.save(tmp_path / "turn.npz")
    robot = rr.freeze(robot, [f"head_pan={tmp_path / 'turn.npz'}"])
    pieces, whole = (
        solve.solve_long(walk, robot, smoothing=SHORT)[0].qpos,
        rr.retarget(walk, robot, smoothing=SHORT, balance="off").trajectory.qpos,
    )
    assert pieces.shape == whole.shape
    pan = robot.qpos_index[robot.joint_names.index("head_pan")]
    at = np.interp(np.arange(len(pieces)) / 30, np.arange(len(turning)) / turning.fps, turning.qpos[:, pan])
    np.testing.assert_allclose(pieces[:, pan], at, atol=1e-9)
    steps = [np.abs([difference(robot, a, b) for a, b in pairwise(q)]).max() for q in (pieces, whole)]
    assert steps[0] < 1.1 * steps[1]
    assert np.abs(pieces - whole).max() < 0.12, "within what a foothold that is placed anew moves a leg"
    assert np.sqrt(((pieces - whole) ** 2).mean()) < 0.02
