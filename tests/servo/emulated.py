"""An emulator process for tests, with its faults and what it has seen; it is gone when the block is left."""

import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
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


FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(["robot_retarget.tools.cli", "robot_retarget.servo.emulator", "robot_retarget.servo.twin"])
"""Emulators are forked from one process that has loaded the libraries."""


class Emulated:
    """A running `servos emulate`."""

    def __init__(self, words: Sequence[str]) -> None:
        (orders, to_child), (from_child, said) = FORKS.Pipe(duplex=False), FORKS.Pipe(duplex=False)
        self.process = FORKS.Process(target=_perform, args=(orders, said, list(words), dict(os.environ)))
        self.process.start()
        orders.close()
        said.close()
        self._orders, self._said = (
            os.fdopen(os.dup(end.fileno()), mode) for end, mode in ((to_child, "w"), (from_child, "r"))
        )
        to_child.close()
        from_child.close()
        line = self._said.readline()
        assert line.startswith("ready "), line
        self.port = line.split()[1]

    def do(self, sentence: str) -> dict[str, Any]:
        """A fault, or `state`."""
        self._orders.write(sentence + "\n")
        self._orders.flush()
        answer = json.loads(self._said.readline())
        assert "error" not in answer, answer
        return answer

    def end(self) -> None:
        """Stop it as a user does, and by force if it hangs."""
        self.process.terminate()
        self.process.join(PATIENCE)
        self.process.kill()
        self.process.join()
        self._orders.close()
        self._said.close()

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
    emulator = Emulated([name, "--control", "--link", str(folder / "tty"), *options])
    try:
        yield emulator
    finally:
        emulator.end()


def _perform(orders: Connection, said: Connection, words: list[str], environment: dict[str, str]) -> None:
    """Run the command in this process."""
    from robot_retarget.__main__ import main

    for end, number in ((orders, 0), (said, 1)):
        os.dup2(end.fileno(), number)
        end.close()
    sys.stdin, sys.stdout = open(0, closefd=False), open(1, "w", closefd=False)  # noqa: SIM115
    os.environ.update(environment)
    os.chdir(ROOT)
    sys.argv = ["robot-retarget", "servos", "emulate", "--map", *words]
    main()


def until(condition: Any, seconds: float = 2.0) -> float:
    """Wait for something to become true; how long it took [s]."""
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < seconds, "it never became true"
        time.sleep(0.005)
    return time.monotonic() - began
