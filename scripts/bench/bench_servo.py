"""Measure the servo side against the emulated bus: rates by baud rate, jitter, load of the player.

    python scripts/bench/bench_servo.py [--seconds 5] [--even 60]

Every line is measured here and now, the emulator in a process of its own; the load of the machine is printed first.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.map import ServoMap, load_map
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.check import check
from robot_retarget.servo.emulator.server import TURNAROUND
from robot_retarget.servo.host import real_time, without_sleep_states
from robot_retarget.servo.link import Link
from robot_retarget.servo.outcome import PlaybackOptions
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import play

BAUDS = (1_000_000, 2_000_000, 3_000_000, 4_000_000)


def bus_limit(servos: int, baud: int, size: int, fast: bool) -> float:
    """Cycles of sync write (4 bytes) and sync read (`size` bytes) that fit on the wire in a second."""
    request = 14 + servos
    answers = 8 + servos * (4 + size) if fast else servos * (11 + size)
    turns = 1 if fast else servos
    return 1 / ((14 + 5 * servos + request + answers) * 10 / baud + turns * TURNAROUND)


def cycles(port: str, servo_map: ServoMap, fast: bool, seconds: float) -> tuple[float, float]:
    """Exchanges a second, one after the other: on the average, and by the median exchange."""
    with Bus(port, servo_map.baud) as bus, real_time(), without_sleep_states():
        conditions, _ = check(bus, servo_map)
        link = Link(bus, servo_map, conditions)
        link.fast = fast
        goal, ends, began = link.present.copy(), [time.perf_counter()], time.perf_counter()
        while ends[-1] - began < seconds:
            link.exchange(link.goals(goal))
            link.listen(0.02)
            if not link.missed.any():
                ends.append(time.perf_counter())
        return (len(ends) - 1) / (ends[-1] - began), float(1 / np.median(np.diff(ends)))


def play_evenly(
    port: str, servo_map: ServoMap, rate: float, seconds: float, log: Path, fast: bool = True
) -> dict[str, Any]:
    """Play gentle waves; rate (by the median tick, too), jitter and this process' part of a core."""
    times = np.arange(0, seconds, 0.02)[:, None]
    waves = 0.1 * np.sin(2 * np.pi * 0.5 * times) * np.ones(len(servo_map.servos))
    before, began = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    outcome = play(
        ServoPlan(waves, 50.0).resampled(rate), servo_map, port, PlaybackOptions(end_pose=False, fast=fast), log
    )
    used, took = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter() - began
    busy = (used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime) / took
    with np.load(log) as rows:
        ticks = np.diff(rows["time"][rows["phase"] == list(rows["phases"]).index("play")])
    median = {"median_rate_hz": round(float(1 / np.median(ticks)), 2)}
    names = ("rate_hz", "jitter_p99_ms", "late_p99_ms", "lost_replies", "skipped_ticks", "played_ticks")
    return (
        {"ended": outcome.reason} | {name: outcome.figures[name] for name in names} | median | {"cpu": round(busy, 3)}
    )


@contextmanager
def emulate(servo_map: ServoMap, folder: Path, *options: str) -> Iterator[str]:
    """The port of an emulator in a process of its own."""
    command = [sys.executable, "-m", "robot_retarget", "servos", "emulate", "--map", servo_map.robot]
    process = subprocess.Popen([*command, "--link", str(folder / "tty"), *options], stdout=subprocess.PIPE, text=True)
    assert process.stdout
    try:
        yield process.stdout.readline().split()[1]
    finally:
        process.terminate()
        process.wait()


def reading_size(robot: ServoMap) -> int:
    """Return the bytes of a servo's reading."""
    return robot.servos[0].type.layout.reading[1]


def bare_rates(robot: ServoMap, folder: Path, seconds: float) -> None:
    """One exchange after the other, without a player: immediate, and paced by each baud rate."""
    for baud in (None, *BAUDS):
        with emulate(robot, folder, *([] if baud is None else ["--baud", str(baud)])) as port:
            for fast in (False, True):
                rate, middle = cycles(port, replace(robot, baud=baud or robot.baud), fast, seconds)
                limit = bus_limit(len(robot.servos), baud, reading_size(robot), fast) if baud else float("nan")
                print(
                    f"{baud or 'unpaced':>8} {'fast' if fast else 'sync'}: {rate:7.1f} Hz, limit {limit:7.1f}, "
                    f"{rate / limit:6.1%}; median {middle:7.1f} Hz, {middle / limit:6.1%}",
                    flush=True,
                )


def played_rates(robot: ServoMap, folder: Path, seconds: float) -> None:
    """The whole player at 2 Mbps, asked for nearly all, and for all that fits on the wire."""
    with emulate(robot, folder, "--baud", "2000000") as port:
        for fast in (False, True):
            limit = bus_limit(len(robot.servos), 2_000_000, reading_size(robot), fast)
            for share in (0.96, 1.0):
                found = play_evenly(port, robot, share * limit, seconds, folder / "play.npz", fast)
                kept = found["rate_hz"] / limit, found["median_rate_hz"] / limit
                print(f"2 Mbps, asked for {share:.0%} of {limit:.1f} Hz: mean {kept[0]:.1%}, median {kept[1]:.1%}")
                print("   ", json.dumps(found), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each measurement of a rate; 0 for none")
    parser.add_argument("--even", type=float, default=60.0, help="seconds of playing at 200 Hz; 0 for none")
    arguments = parser.parse_args()
    robot = load_map("op3")
    print(
        f"load {os.getloadavg()}, {os.cpu_count()} cores, {len(robot.servos)} servos, read {reading_size(robot)} bytes"
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.seconds:
            played_rates(robot, folder, arguments.seconds)
            bare_rates(robot, folder, arguments.seconds)
        if arguments.even:
            with emulate(robot, folder) as port:
                found = play_evenly(port, robot, 200.0, arguments.even, folder / "play.npz")
                print("200 Hz:", json.dumps(found))


if __name__ == "__main__":
    main()
