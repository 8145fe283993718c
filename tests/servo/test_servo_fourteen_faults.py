"""Fourteen faults during a playback, under both protocols: exit code and reason are those of the table in `docs/reference/servo-map.md`.

Every playback is against an emulator process over a pseudo terminal, whose time goes by ticks.
"""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from emulated import ARM, Emulated, emulated
from shared_files import ROOT
from test_servo_play import OPTIONS, PLAN, RATE, START
from test_servo_protocol1 import BENCH

from robot_retarget.base.errors import ServoError
from robot_retarget.servo.play import play

MAPS = {"Protocol 2": ARM, "Protocol 1": BENCH}
PAGE = ROOT / "docs" / "reference" / "servo-map.md"
TABLE = PAGE.read_text(encoding="utf-8").split("## Faults\n")[1].split("\n## ")[0]
ROWS = [[cell.strip() for cell in row.split("|")[1:-1]] for row in TABLE.splitlines() if row.startswith("| ")][1:]
SIGNALS = {"Ctrl-C": signal.SIGINT, "SIGTERM": signal.SIGTERM}
KILLED = (
    "import sys; sys.path[:0] = ['tests/servo', 'tests']\n"
    "from test_servo_fourteen_faults import *\nfrom robot_retarget.servo.outcome import Record\n"
    "add = Record.add\n"
    "def watched(self, **row):\n"
    "    add(self, **row)\n"
    "    if list(self.column('phase')).count(1) == 9: os.kill(os.getpid(), signal.SIGKILL)\n"
    "Record.add = watched\n"
    "play(PLAN, MAPS[{!r}], {!r}, OPTIONS, {!r})"
)


@pytest.fixture(scope="module", params=MAPS)
def running(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Emulated]]:
    folder = tmp_path_factory.mktemp("bus")
    with emulated(folder, MAPS[request.param], "--lockstep", f"{RATE:g}") as emulator:
        yield request.param, emulator


def ending(protocol: str, emulator: Emulated, fault: str, folder: Path) -> tuple[int, str]:
    """Exit code of `play` and its reason, with a fault as the motion begins, or before it where two servos have one id."""
    log = folder / "play.npz"
    if fault == "SIGKILL":
        return subprocess.run(
            [sys.executable, "-c", KILLED.format(protocol, emulator.port, str(log))], cwd=ROOT
        ).returncode, ""

    def say(text: str) -> None:
        if not text.startswith("playing"):
            return
        os.kill(os.getpid(), SIGNALS[fault]) if fault in SIGNALS else emulator.do(fault)

    if early := fault.startswith("duplicate"):
        emulator.do(fault)
    try:
        outcome = play(PLAN, MAPS[protocol], emulator.port, OPTIONS, log, (lambda text: None) if early else say)
    except ServoError as error:
        return 2, str(error)
    return outcome.exit_code, outcome.reason


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_each_fault_ends_with_the_code_and_the_reason_of_the_page(
    running: tuple[str, Emulated], row: list[str], tmp_path: Path
) -> None:
    protocol, emulator = running
    emulator.do("reset")
    emulator.spread(MAPS[protocol], START)
    code, reason = ending(protocol, emulator, row[1].strip("`"), tmp_path)
    if row[1] == "`unplug`":
        emulator.do("plug")
    cell = row[3] if protocol == "Protocol 1" and row[3] != "as left" else row[2]
    stated = re.fullmatch(r"(-?\d+)(?:, (.*))?", cell)
    assert stated and int(stated[1]) == code
    assert re.fullmatch(".*".join(map(re.escape, (stated[2] or "").split("…"))), reason) if stated[2] else not reason


def test_the_page_has_all_fourteen() -> None:
    assert len(ROWS) == 14
