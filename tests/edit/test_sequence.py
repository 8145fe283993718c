"""Sequences: clips stay themselves outside their seams, feet stand through them, and what does not fit is refused with reasons."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold, lifted, swing
from typer.testing import CliRunner

import robot_retarget as rr
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.edit.seam import Seam, found_seam
from robot_retarget.edit.sequence import joined, retimed, spliced
from robot_retarget.human.robot_performer import performed
from robot_retarget.robot import recognise, world_points
from robot_retarget.tools.cli import app

OP3 = rr.load_robot("op3")
FPS = 30.0
SWING = swing(OP3, "l_sho_pitch", 0.4, 0.5, 2.0, fps=FPS)
NOD = swing(OP3, "r_sho_pitch", 0.3, 1.0, 2.0, fps=FPS)


def turned(trajectory: rr.Trajectory, yaw: float, x: float) -> rr.Trajectory:
    """Elsewhere, facing elsewhere."""
    qpos = trajectory.qpos.copy()
    qpos[:, :2] = np.array([x, -x])
    qpos[:, 3:7] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    return replace(trajectory, qpos=qpos)


def astride(trajectory: rr.Trajectory, angle: float) -> rr.Trajectory:
    """The feet further apart, flat on the floor."""
    qpos = trajectory.qpos.copy()
    for joint, sign in (("l_hip_roll", -1), ("l_ank_roll", -1), ("r_hip_roll", 1), ("r_ank_roll", 1)):
        qpos[:, OP3.qpos_index[OP3.joint_names.index(joint)]] += sign * angle
    return replace(trajectory, qpos=qpos)


def sole(trajectory: rr.Trajectory, side: str) -> np.ndarray:
    """(T, 2) the middle of a sole on the floor."""
    return world_points(OP3, recognise(OP3).treads[side], trajectory.qpos).mean(axis=1)[:, :2]


def test_a_clip_continues_at_the_place_and_heading_of_the_one_before() -> None:
    first, second = performed(SWING, OP3), performed(turned(NOD, 2.0, 0.7), OP3)
    whole = joined([first, second], [Seam(60, 0, 12)])
    assert len(whole) == len(first) + len(second) - 13
    np.testing.assert_allclose(whole.positions[: 60 - 12], first.positions[: 60 - 12], atol=1e-9)
    ankles = [whole.skeleton.names.index(f"{side}_ankle") for side in "lr"]
    assert np.ptp(whole.positions[:, ankles], axis=0).max() < 1e-6
    assert whole.contacts is not None and whole.contacts.stands.all()


def test_bones_keep_their_lengths_through_a_seam() -> None:
    first, second = performed(SWING, OP3), performed(NOD, OP3)
    whole, parents = joined([first, second], [Seam(20, 35, 12)]), first.skeleton.parents
    bones = np.flatnonzero(parents >= 0)
    made, *own = (
        np.linalg.norm(m.positions[:, bones] - m.positions[:, parents[bones]], axis=2) for m in (whole, first, second)
    )
    rigid = np.ptp(np.concatenate(own), axis=0) < 1e-9
    assert rigid.sum() > 10
    assert np.abs(made - own[0][0])[:, rigid].max() < 1e-9


def test_a_solved_sequence_is_its_clips_outside_the_seams() -> None:
    made = rr.sequence([SWING, turned(NOD, -1.0, 0.3)], OP3, balance="off", fade=0.4).trajectory
    hinges, tail = made.qpos[:, OP3.qpos_index], len(NOD) - 13
    np.testing.assert_allclose(hinges[:48], SWING.qpos[:48, OP3.qpos_index], atol=3e-3)
    np.testing.assert_allclose(hinges[-tail:], NOD.qpos[-tail:, OP3.qpos_index], atol=3e-3)
    assert (np.abs(np.diff(hinges, axis=0)) * FPS <= OP3.max_speed + 1e-6).all()
    for side in "lr":
        assert np.ptp(sole(made, side), axis=0).max() < 1e-3


def test_the_arms_of_a_splice_are_those_of_the_second_beside_the_chest() -> None:
    legs, arms = performed(astride(SWING, 0.2), OP3), performed(turned(NOD, 1.0, 0.2), OP3)
    both = spliced(legs, arms)
    names = both.skeleton.names
    for name in names:
        k, chest = names.index(name), names.index("chest")
        source = arms if name.endswith(("_shoulder", "_elbow", "_hand")) else legs
        apart = (np.linalg.norm(m.positions[:, k] - m.positions[:, chest], axis=1) for m in (both, source))
        np.testing.assert_allclose(*apart, atol=1e-9)
    assert both.contacts is legs.contacts


def test_twice_the_speed_takes_half_the_time() -> None:
    motion = performed(SWING, OP3)
    quick = retimed(motion, 2.0)
    assert quick.duration == motion.duration / 2
    np.testing.assert_allclose(quick.positions, motion.positions[::2], atol=1e-12)


def test_half_the_speed_takes_a_quarter_of_the_accelerations() -> None:
    slow = rr.sequence([SWING], OP3, speed=0.5, balance="off").trajectory
    own, found = (np.diff(t.qpos[:, OP3.qpos_index], 2, axis=0) * FPS**2 for t in (SWING, slow))
    assert np.abs(found).max() == pytest.approx(np.abs(own).max() / 4, rel=0.1)


def test_feet_apart_are_refused_without_balance_and_step_with_it() -> None:
    here, wide = performed(SWING, OP3), performed(astride(NOD, 0.25), OP3)
    apart = float(np.linalg.norm(sole(astride(NOD, 0.25), "l")[0] - sole(astride(NOD, 0.25), "r")[0]))
    gap = 100 * (apart - float(np.linalg.norm(sole(SWING, "l")[0] - sole(SWING, "r")[0])))
    with pytest.raises(TrajectoryError, match=f"feet {gap:.0f} cm apart"):
        found_seam(here, wide, 60, 0, 12, balanced=False)
    seam = found_seam(here, wide, 60, 0, 12, balanced=True)
    contacts = joined([here, wide], [seam]).contacts
    assert contacts is not None
    down = contacts.planted
    assert down[:, 0].all() and not down[48:61, 1].any() and down[:48, 1].all() and down[61:, 1].all()


def test_a_jump_is_refused_and_the_proposed_frames_are_accepted() -> None:
    """It is in the air from 0.8 to 1.2 s and at its beginning; within a second of the asked frames both stand."""
    times = np.arange(61) / FPS
    jump = lifted(SWING, np.where((times > 1.5) | (times < 0.3), 0.1, 0.0))
    motion = performed(jump, OP3)
    with pytest.raises(TrajectoryError, match="both feet are in the air") as refusal:
        found_seam(motion, motion, 60, 0, 6, balanced=False)
    leave, enter = (round(float(t) * FPS) for t in str(refusal.value).split("--at ")[1].split(":"))
    assert 30 <= leave <= 60 and 0 <= enter <= 30
    assert found_seam(motion, motion, leave, enter, 6, balanced=False) == Seam(leave, enter, 6)
    assert found_seam(motion, motion, 60, 0, 6, balanced=False, best=True) == Seam(leave, enter, 6)


def test_the_best_frames_of_a_shifted_clip_are_the_same_pose() -> None:
    """The second clip is the first a third of a second later: the seam that changes nothing is found."""
    motion = performed(SWING, OP3)
    seam = found_seam(motion, motion.frames(10), 30, 10, 12, balanced=False, best=True)
    assert seam.enter + 10 == seam.leave - seam.frames


def test_a_body_that_stops_within_a_seam_needs_a_longer_one() -> None:
    still, moving = hold(OP3, 2.0, FPS), hold(OP3, 2.0, FPS)
    qpos = moving.qpos.copy()
    qpos[:, 0] += np.arange(len(qpos)) / FPS  # slides at 1 m/s
    bodiless = [replace(performed(t, OP3), contacts=None) for t in (still, replace(moving, qpos=qpos))]
    with pytest.raises(TrajectoryError, match=r"speeds 1\.00 m/s apart: the seam must last 0\.55 s"):
        found_seam(bodiless[1], bodiless[0], 60, 0, 12, balanced=False)
    assert found_seam(bodiless[1], bodiless[0], 60, 0, 17, balanced=False).frames == 17


def test_nothing_and_seams_outside_their_clips_are_refused() -> None:
    with pytest.raises(UsageError, match="needs a clip"):
        rr.sequence([], OP3)
    with pytest.raises(UsageError, match="speed must be positive"):
        rr.sequence([SWING], OP3, speed=0.0)
    with pytest.raises(UsageError, match="2 clips have 1"):
        rr.sequence([SWING, NOD], OP3, at=[None, None])
    with pytest.raises(UsageError, match=r"9\.00:0\.00 s is no seam"):
        rr.sequence([SWING, NOD], OP3, at=[(9.0, 0.0)], balance="off")


def test_the_command_names_the_frames_that_fit(tmp_path: Path) -> None:
    for name, clip in (("a", SWING), ("b", lifted(NOD, np.where(np.arange(61) < 15, 0.1, 0.0)))):
        clip.save(tmp_path / f"{name}.npz")
    files = [str(tmp_path / f"{name}.npz") for name in "ab"]
    done = CliRunner().invoke(
        app, ["edit", "join", *files, "-r", "op3", "-o", str(tmp_path / "c.npz"), "--balance", "off"]
    )
    assert isinstance(done.exception, TrajectoryError) and "--at" in str(done.exception)
    assert not (tmp_path / "c.npz").exists()
    done = CliRunner().invoke(app, ["edit", "splice", "--legs", files[0], "--arms", files[0], "-r", "op3", "--balance", "off",
                                    "-o", str(tmp_path / "c.npz")])  # fmt: skip
    assert done.exit_code == 0, done.output
    off = rr.load_trajectory(tmp_path / "c.npz", OP3).qpos[:, 7:] - SWING.qpos[:, 7:]
    assert np.abs(off).max() < 3e-3
