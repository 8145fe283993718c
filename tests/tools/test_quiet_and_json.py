"""What every command shares: `--quiet` says nothing but errors, `--json` prints JSON and nothing else, progress stays aside."""

import json
from pathlib import Path

import pytest
from forked import run as called
from shared_files import ROOT
from typer.main import get_command

from robot_retarget.tools.cli import app

WAVE = str(ROOT / "samples/wave.bvh")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("solved") / "wave.npz"
    done = called("solve", WAVE, "-r", "op3", "--frames", "0:40", "--legs", "stand", "-o", path, "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return path


TALKS = {"emulate"}
"""Prints for a program that waits for it, no remarks."""


def test_every_command_can_be_quiet() -> None:
    group = get_command(app)
    commands = dict(group.commands)  # pyright: ignore[reportAttributeAccessIssue]
    for name in ("servos", "edit"):
        commands |= commands.pop(name).commands
    assert len(commands) > 15
    for name, command in commands.items():
        assert name in TALKS or "quiet" in {option.name for option in command.params}, name


def test_quiet_leaves_errors() -> None:
    done = called("info", "nowhere.bvh", "--quiet")
    assert done.returncode == 2 and not done.stdout and done.stderr.startswith("error: ")


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (("edit", "cut", "IN", "-r", "op3", "--trim", "0:1", "-o", "OUT.npz"), "duration_s"),
        (("export", "IN", "-r", "op3", "-f", "csv", "-o", "OUT.csv"), "format"),
        (("convert", "IN", "-r", "op3", "--to", "csv", "-o", "OUT.csv"), "frames"),
        (("view", "IN", "-r", "op3", "--static", "OUT.html"), "files"),
        (("simulate", "IN", "-r", "op3", "--mode", "free", "--draws", "1", "--no-store"), "verdict"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_json_is_all_that_is_printed(words: tuple[str, ...], key: str, solved: Path, tmp_path: Path) -> None:
    named = {"IN": str(solved), "OUT": str(tmp_path / "out")}
    done = called(*(named.get(w, w.replace("OUT", named["OUT"])) for w in words), "--json", "--quiet")
    assert done.returncode in (0, 1) and not done.stderr
    assert key in json.loads(done.stdout)
