"""An emulator process for tests, with its faults and what it has seen; it is gone when the block is left."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from shared_files import ROOT

from robot_retarget.actuators.map import Limits, Servo, ServoMap, Stop, dump_map

QUICK = Limits(approach_time=0.12, approach_speed=3.0)
ARM = ServoMap(
    "arm",
    tuple(
        Servo(f"j{k}", k, "XM430-W350", sign=1 if k % 2 else -1, zero=2048 + 40 * k, lower=-1.5, upper=1.5)
        for k in range(1, 5)
    ),
    1_000_000,
    QUICK,
    Stop({"j1": 0.0, "j2": 0.1}),
)
"""Four servos with signs and zeros of their own, and little patience."""

PATIENCE = 15.0
"""A window on a busy machine takes seconds to go; what is not gone by then hangs [s]."""


class Emulated:
    """A running `servos emulate`."""

    def __init__(self, process: subprocess.Popen[str], port: str) -> None:
        self.process, self.port = process, port

    def do(self, sentence: str) -> dict[str, Any]:
        """A fault, or `state`."""
        assert self.process.stdin and self.process.stdout
        self.process.stdin.write(sentence + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        assert "error" not in answer, answer
        return answer

    def servos(self) -> dict[int, dict[str, int]]:
        return {int(k): v for k, v in self.do("state")["servos"].items()}

    def spread(self, servo_map: ServoMap, radians: Sequence[float]) -> None:
        """Put every joint by hand."""
        for servo, angle in zip(servo_map.servos, radians, strict=True):
            self.do(f"place {servo.id} {servo.ticks(angle)}")


@contextmanager
def emulated(folder: Path, servo_map: ServoMap | str = ARM, *options: str) -> Iterator[Emulated]:
    name = str(servo_map)
    if isinstance(servo_map, ServoMap):
        path = folder / "servos.toml"
        path.write_text(dump_map(servo_map), encoding="utf-8")
        name = str(path)
    command = [sys.executable, "-m", "robot_retarget", "servos", "emulate", "--map", name, "--control"]
    process = subprocess.Popen(
        [*command, "--link", str(folder / "tty"), *options],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        assert process.stdout
        line = process.stdout.readline()
        assert line.startswith("ready "), line
        yield Emulated(process, line.split()[1])
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        assert process.stdin and process.stdout
        process.stdin.close()
        process.stdout.close()


def until(condition: Any, seconds: float = 2.0) -> float:
    """Wait for something to become true; how long it took [s]."""
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < seconds, "it never became true"
        time.sleep(0.005)
    return time.monotonic() - began
