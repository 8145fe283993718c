"""A served page follows live poses, in a browser."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from browser import needs_browser, tab

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.live.frame import Fault, FaultCounter
from robot_retarget.live.loop import Loop
from robot_retarget.live.sources import Replay
from robot_retarget.robot import load_robot
from robot_retarget.tools.studio.studio import Studio
from robot_retarget.tools.view.web.live import LiveRobot, PageSink
from robot_retarget.trajectory import load_trajectory


def test_only_the_latest_pose_is_sent() -> None:
    live = LiveRobot(robot := load_robot("op3"))
    assert live.next(0, 0.01) is None
    for height in (0.3, 0.4, 0.5):
        qpos = robot.standing()
        qpos[2] = height
        live.show(qpos)
    count, pose = live.next(0, 1.0) or (0, b"")
    assert count == 3 and b"0.5" in pose
    assert live.next(count, 0.01) is None


@needs_browser
def test_the_robot_on_the_page_stands_where_the_latest_pose_has_it(tmp_path: Path) -> None:
    live = LiveRobot(robot := load_robot("op3"))
    served = Studio(tmp_path, live).served(0)
    thread = threading.Thread(target=served.forever, daemon=True)
    thread.start()
    try:
        with tab() as browser:
            browser.open(served.address)
            browser.until("return Boolean(viewer.studio.live)")
            before = browser.picture().astype(int)
            qpos = robot.standing()
            qpos[robot.qpos_index[robot.joint_names.index("l_sho_roll")]] -= 1.2
            qpos[0] += 0.7
            for _ in range(5):
                live.show(qpos)
                time.sleep(0.05)
            browser.until("return viewer.studio.live.poses > 0")
            assert abs(browser.run("return viewer.takes[0].poses.values[0]") - qpos[0]) < 1e-3
            after = browser.picture().astype(int)
            assert (np.abs(after - before).max(axis=2) > 20).mean() > 0.005  # an arm is 0.9 % of the picture
            assert not browser.complaints()
    finally:
        served.close()
        thread.join(5)


@needs_browser
def test_a_page_shows_state_address_rate_faults_and_performer_and_records_a_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robot, wave = load_robot("op3"), read_motion(SAMPLES / "wave.bvh")
    there_and_back = np.concatenate([wave.positions, wave.positions[::-1]])
    motion = Motion(wave.skeleton, np.concatenate([there_and_back] * 30), None, wave.fps)
    sink = PageSink(robot, source="UDP 127.0.0.1:39539")
    served = Studio(tmp_path / "studio", sink.robot).served(0)
    source = Replay(motion, FaultCounter())
    loop = Loop(source, lambda skeleton: rr.Stream(robot, skeleton), sink)
    pages, frames = (threading.Thread(target=run, daemon=True) for run in (served.forever, loop.run))
    pages.start()
    cell = "document.querySelectorAll('#live dd')[{}].textContent"
    try:
        with tab() as browser:
            browser.open(served.address)
            browser.until(f"return Boolean(viewer.studio.live) && {cell.format(0)} === 'waiting for a performer'")
            assert browser.run(f"return {cell.format(1)}") == "UDP 127.0.0.1:39539"
            sink.follow(loop)
            frames.start()
            browser.until(f"return {cell.format(0)} === 'following' && parseFloat({cell.format(2)}) > 0")
            browser.until("return viewer.studio.live.sticks?.rods.count > 10 && viewer.studio.live.poses > 10")
            assert "ms" in browser.run(f"return {cell.format(3)}") and browser.run(f"return {cell.format(4)}") == "none"
            browser.run("document.getElementById('record').click()")
            browser.until(f"return parseFloat({cell.format(5)}) > 0.6")
            source.faults.note(Fault.SILENCE, "of a test")
            browser.until(f"return {cell.format(4)}.includes('× 1')")
            if picture := os.environ.get("PICTURE"):
                browser.driver.save_screenshot(picture)
            browser.run("document.getElementById('record').click()")
            browser.until("return location.hash.includes('take_1.bvh') && viewer.takes[0]?.human")
            assert not browser.complaints()
    finally:
        loop.stop.set()
        served.close()
    take = load_trajectory(tmp_path / "take_1.npz")
    assert take.robot == robot.name and len(take) > 2 and 5 < take.fps < 240
    assert np.ptp(take.qpos[:, robot.qpos_index], axis=0).max() > 0.001
    performed = read_motion(tmp_path / "take_1.bvh")
    assert (
        performed.duration == pytest.approx(take.duration, abs=0.3)
        and len(performed.skeleton) >= len(wave.skeleton) - 6
    )


@pytest.mark.parametrize("late", [-0.02, 0.0, 0.02, 0.045])
def test_a_take_of_poses_at_uneven_times_is_as_long_as_they_took(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, late: float
) -> None:
    robot, times = load_robot("op3"), np.arange(48) / 30 + np.where(np.arange(48) > 40, late, 0.0)
    clock = iter(times)
    monkeypatch.setattr("robot_retarget.tools.view.web.live.monotonic", lambda: next(clock))
    live = LiveRobot(robot, takes=tmp_path)
    live.record()
    for _ in times:
        live.show(robot.standing())
    live.record()
    assert load_trajectory(tmp_path / "take_1.npz").duration == pytest.approx(times[-1], abs=1 / 30)


STREAM = """
import sys, time
from pathlib import Path
from robot_retarget.robot import load_robot
from robot_retarget.tools.view.web.live import LiveRobot
robot = load_robot("op3")
live = LiveRobot(robot, takes=Path(sys.argv[1]))
live.record()
for frame in range(10_000):
    qpos = robot.standing()
    qpos[0] = frame / 50
    live.show(qpos)
    print(frame, flush=True)
    time.sleep(0.02)
"""


def test_a_take_survives_a_kill_but_for_its_last_second(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", STREAM, str(tmp_path)], stdout=subprocess.PIPE, text=True) as stream:
        assert stream.stdout is not None
        shown, end = 0, None
        for line in stream.stdout:
            shown = int(line)
            if end is None and (tmp_path / "take_1.npz").exists():
                end = shown + 25  # half a second after the file is there
            if end is not None and shown >= end:
                break
        stream.kill()
    take = load_trajectory(tmp_path / "take_1.npz")
    assert take.robot == "op3" and 50 * take.qpos[-1, 0] > shown - 75, "at most a second and its writing are lost"
    assert [path.name for path in tmp_path.iterdir() if not path.name.startswith(".")] == ["take_1.npz"]


def test_a_take_is_written_where_the_stream_ends_before_it_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robot = load_robot("op3")
    live = PageSink(robot).robot
    live.record()
    for _ in range(3):
        live.show(robot.standing())
        time.sleep(0.02)
    assert live.end()["wrote"] == "take_1.npz" and len(load_trajectory(tmp_path / "take_1.npz")) >= 2
    assert live.end() == {}
