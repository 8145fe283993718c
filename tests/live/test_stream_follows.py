"""The command `stream` with the solver at work: from stdin, over UDP, from a file; to lines and to an emulated robot; Ctrl-C."""

import json
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any

import numpy as np
import pytest
from performers import HOST, clip, listening, performing
from shared_files import ROOT

from robot_retarget.actuators.map import dump_map, load_map
from robot_retarget.base.files import SAMPLES
from robot_retarget.live.loop import Loop
from robot_retarget.live.messages import line_of, skeleton_line
from robot_retarget.live.vmc import VmcDecoder
from robot_retarget.robot import load_robot
from robot_retarget.solver.stream import Stream

WAVE = str(SAMPLES / "wave.bvh")
COMMAND = [sys.executable, "-m", "robot_retarget", "stream", "--robot", "op3"]
OP3 = load_robot("op3")


def started(*words: str) -> subprocess.Popen[str]:
    return subprocess.Popen([*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def summary(said: str) -> dict[str, Any]:
    """The JSON at the end of what was said."""
    found = re.search(r"^\{\n.*^\}", said, re.S | re.M)
    assert found, said
    return json.loads(found[0])


def require_limits(rows: Sequence[dict[str, Any]]) -> None:
    """Ranges and joint speeds between poses, by their own times."""
    qpos = np.array([row["qpos"] for row in rows])[:, OP3.qpos_index]
    assert np.isfinite(qpos).all()
    assert (qpos >= OP3.lower - 1e-6).all() and (qpos <= OP3.upper + 1e-6).all()
    assert len(rows) > 10


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind((HOST, 0))
        return found.getsockname()[1]


def test_lines_in_are_lines_out_and_what_is_wrong_is_said_on_the_side() -> None:
    motion = clip(fps=30)
    lines = [skeleton_line(motion.skeleton), *(line_of(t / 30, motion.positions[t]) for t in range(30))]
    lines[10:10] = [b"nonsense\n", b'{"time": 0.1, "positions": [[1, 2, 3]]}\n']
    process = subprocess.Popen(
        [*COMMAND, "--from", "json", "--json"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=ROOT,
    )
    assert process.stdin and process.stdout
    process.stdin.write(lines[0])
    process.stdin.flush()
    for line in lines[1:]:
        time.sleep(1 / 30)
        process.stdin.write(line)
        process.stdin.flush()
    time.sleep(3.0)  # the solver is built while the first frames come; what it missed is dropped, not queued
    out, err = process.communicate(b"".join(line_of(8 + t / 30, motion.positions[t]) for t in range(3)), timeout=60)
    rows = [json.loads(row) for row in out.decode().splitlines()]
    figures = summary(err.decode())
    assert process.returncode == 0 and rows and figures["frames"] + figures["dropped"] >= 31
    assert 1 <= figures["faults"]["malformed packet"] <= 2  # a reader that starts late sees the latest bytes alone
    assert "malformed packet" in err.decode()
    assert set(rows[0]) == {"time", "qpos", "status", "age"} and len(rows[0]["qpos"]) == OP3.model.nq


def test_frames_over_udp_at_60_hz_are_answered_in_order_and_within_limits() -> None:
    port = free_port()
    receiver = started("--host", HOST, "--port", str(port), "--seconds", "3", "--json")
    sender = subprocess.Popen(
        [sys.executable, "scripts/bench/perform.py", str(SAMPLES / "walk.bvh"), f"vmc://{HOST}:{port}",
         "--fps", "60", "--seconds", "60"], cwd=ROOT, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        out, err = receiver.communicate(timeout=90)
    finally:
        sender.terminate()
        sender.wait()
    rows, figures = [json.loads(row) for row in out.splitlines()], summary(err)
    assert receiver.returncode == 0 and figures["frames"] > 0
    require_limits(rows)
    times = np.array([row["time"] for row in rows if row["status"] != "held"])
    assert (np.diff(times) >= 0).all()


def test_ctrl_c_ends_a_stream_with_its_summary() -> None:
    process = started("--from", WAVE)
    assert process.stdout
    process.stdout.readline()
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 0 and "frames solved" in err and "Traceback" not in err


def require_played(process: subprocess.Popen[str]) -> None:
    """Wait for twice the time of the last approach and half a second, however long the solver takes to begin."""
    lines, approach = Queue[str](), None
    Thread(target=lambda: [lines.put(line) for line in process.stderr or ()], daemon=True).start()
    while True:
        try:
            line = lines.get(timeout=60 if approach is None else 2 * approach + 0.5)
        except Empty:
            assert approach is not None
            return
        found = re.search(r"approaching a pose .* in ([\d.]+) s", line)
        approach = approach if found is None else float(found[1])


def test_the_emulated_op3_follows_a_performer_within_every_limit(tmp_path: Path) -> None:
    log, own, servo_map = tmp_path / "play.npz", tmp_path / "servos.toml", load_map("op3")
    patient = replace(servo_map.limits, watchdog=2.0, silence=1.0)  # a busy machine pauses for tenths of a second
    own.write_text(dump_map(replace(servo_map, limits=patient)), encoding="utf-8")
    emulated = "--to", "servos", "--servos", str(own), "--serial", "emulated", "--log", str(log)
    process = started("--from", WAVE, "--speed", "0.2", *emulated)
    require_played(process)
    process.send_signal(signal.SIGINT)
    process.wait(60)
    with np.load(log) as found:
        goal, present = found["goal"], found["present"]
        assert "play" in found["phases"][found["phase"]]
    low, high = np.array([servo.reach for servo in servo_map.servos]).T
    assert (goal >= low - 1e-9).all() and (goal <= high + 1e-9).all()
    assert np.abs(np.diff(goal, axis=0)).max() <= servo_map.limits.speed / 125 + 1e-9
    assert np.abs(goal[1:] - present[:-1]).max() <= servo_map.limits.jump + 1e-9


class Shown:
    """Keeps the poses that it is shown, and when."""

    def __init__(self) -> None:
        self.poses: list[Any] = []

    def show(self, pose: Any) -> None:
        self.poses.append(pose)


@pytest.mark.parametrize("silence", [0.1, 1.0])
def test_neither_silence_nor_another_performer_makes_the_robot_jump(silence: float) -> None:
    shown, wave, walk = Shown(), clip("wave"), clip("walk")
    with listening(VmcDecoder) as receiver:
        loop = Loop(receiver, lambda skeleton: Stream(OP3, skeleton), shown)
        with performing(receiver, wave):
            loop.run(2.5)
        loop.run(silence + 0.1)
        with performing(receiver, walk):
            loop.run(max(1.2 - silence, 0.0) + 1.5)
    assert receiver.faults.counts["silence"] >= 1 and loop.stats.held > 0
    qpos = np.array([pose.qpos[OP3.qpos_index] for pose in shown.poses])
    since = np.diff([pose.time for pose in shown.poses])
    assert np.isfinite(qpos).all() and (qpos >= OP3.lower - 1e-6).all() and (qpos <= OP3.upper + 1e-6).all()
    reach = OP3.max_speed * np.maximum(since, 0.0)[:, None]
    assert (np.abs(np.diff(qpos, axis=0)) <= reach + 1e-4).all(), "faster than its joints turn"
    assert {str(pose.status.name) for pose in shown.poses} >= {"HELD", "CALIBRATING"}
