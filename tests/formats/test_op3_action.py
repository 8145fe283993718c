"""Action pages of the OP3: by the C struct of its sources, its checksum, and its player's own cycle of 8 ms."""

from pathlib import Path

import numpy as np
import pytest
from action_structs import Page, pages_of, write_pages
from format_moves import motion_of, robot_called

from robot_retarget.actuators.map import load_map
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.formats import FormatOptions, export, import_motion
from robot_retarget.formats.action_pages import _even
from robot_retarget.trajectory import Trajectory


def played(pages: list[Page], ids: list[int]) -> np.ndarray:
    """(C, n) goals [tick] of every cycle, by the sections of actionPlayProcess with no acceleration and no pause."""
    goals, at = [], [np.nan] * len(ids)
    page = 1
    while page:
        header = pages[page].header
        for step in pages[page].step[: header.stepnum]:
            total = step.time * header.speed >> 5
            goals += [list(at)] * 2  # one cycle readies PRE, one goes from PRE to MAIN
            target = [step.position[i] for i in ids]
            start = [t if np.isnan(a) else a for a, t in zip(at, target, strict=True)]
            goals += [
                [int(s) + int((t - s) * c / total) for s, t in zip(start, target, strict=True)]
                for c in range(1, total + 1)
            ]
            goals += [list(target)]  # from MAIN to POST
            at = target
        page = header.next
    return np.array(goals)


def test_pages_add_up_to_255_and_lead_from_one_to_the_next(tmp_path: Path) -> None:
    path = export(motion_of("op3", 12.5), robot_called("op3"), "op3-action", tmp_path / "motion_4095.bin")
    pages = pages_of(path)
    assert all(sum(bytes(page)) % 256 == 255 for page in pages)
    assert [page.header.next for page in pages[:4]] == [0, 2, 0, 0]  # 14 keyframes, seven a page
    assert [page.header.stepnum for page in pages[:4]] == [0, 7, 7, 0]
    assert pages[1].header.name.startswith(b"made") and pages[1].header.schedule == 0x0A and pages[1].header.accel == 0


def test_the_player_of_the_robot_is_at_every_keyframe_in_time(tmp_path: Path) -> None:
    motion, robot, servos = motion_of("op3", 12.5), robot_called("op3"), load_map("op3")
    pages = pages_of(export(motion, robot, "op3-action", tmp_path / "a.bin"))
    joints = [joint for joint in servos.joints if joint in robot.joint_names]
    goals = played(pages, [servos[joint].id for joint in joints])
    assert len(goals) == pytest.approx(len(motion) / 12.5 / 0.008, abs=1)
    for t, q in enumerate(motion.qpos):
        ticks = [servos[j].ticks(q[robot.qpos_index[robot.joint_names.index(j)]]) for j in joints]
        assert np.abs(goals[10 * (t + 1) - 1] - ticks).max() <= 1


@pytest.mark.parametrize("left_out", [0x4000, 0x4000 | 1234])
def test_pages_of_others_with_pauses_and_servos_left_out_are_read(left_out: int, tmp_path: Path) -> None:
    """A servo is left out by a bit beside any position."""
    robot, servos = robot_called("op3"), load_map("op3")
    pages = pages_of(export(motion_of("op3", 12.5), robot, "op3-action", tmp_path / "a.bin"))
    pages[1].step[2].pause, pages[1].step[3].position[servos["head_pan"].id] = 20, left_out
    held = pages[1].step[2].position[servos["head_pan"].id]
    write_pages(pages, tmp_path / "b.bin")
    back = import_motion(tmp_path / "b.bin", robot)
    assert back.fps == pytest.approx(125) and back.duration == pytest.approx((13 * 10 + 20) * 0.008)
    pan = back.qpos[:, robot.qpos_index[robot.joint_names.index("head_pan")]]
    assert np.abs(pan[40:50] - servos["head_pan"].radians(held)).max() < 1e-9


def test_what_pages_cannot_hold_is_refused(tmp_path: Path) -> None:
    robot = robot_called("op3")
    long = Trajectory(np.tile(robot.standing(), (1800, 1)), 12.5, robot.joint_names, robot.name)
    with pytest.raises(UsageError, match=r"1800 keyframes need 258 pages of 255"):
        export(long, robot, "op3-action", tmp_path / "a.bin")
    with pytest.raises(UsageError, match=r"--fps 60 is no such number"):
        export(motion_of("op3", 50.0), robot, "op3-action", tmp_path / "a.bin", FormatOptions(fps=60))
    (tmp_path / "b.bin").write_bytes(bytes(256 * 512))
    with pytest.raises(TrajectoryError, match="page 1 has no steps"):
        import_motion(tmp_path / "b.bin", robot)


def test_keyframes_of_unequal_times_are_at_their_times_and_last_an_hour_at_most() -> None:
    angles, times = np.array([[0.0], [1.0], [3.0]]), np.array([1.0, 1.0, 2.0])
    even, fps = _even(angles, times)
    assert fps == pytest.approx(125) and len(even) == 3 * 125 + 1
    assert [even[round(t * fps), 0] for t in (0.0, 0.48, 1.0, 2.0, 3.0)] == pytest.approx([0.0, 0.48, 1.0, 2.0, 3.0])
    with pytest.raises(TrajectoryError, match="last 3601 s, more than 3600 s"):
        _even(angles, np.array([1.0, 1.0, 3600.0]))
