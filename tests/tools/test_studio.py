"""The studio gives the same bytes as the shell and Python, refuses bad files with a reason, and stops when it is told to."""

import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from forked import run
from studio_page import Opened, opened_studio

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES


@pytest.fixture(scope="module")
def wave(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip of two seconds of the sample."""
    text = (SAMPLES / "wave.bvh").read_text()
    head, frames = text.split("Frame Time:", 1)
    time_line, *rows = frames.splitlines()
    short = head.rsplit("Frames:", 1)[0] + f"Frames: 40\nFrame Time:{time_line}\n" + "\n".join(rows[40:80]) + "\n"
    path = tmp_path_factory.mktemp("clip") / "my wave.bvh"
    path.write_text(short)
    return path


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    with opened_studio(tmp_path_factory.mktemp("studio")) as found:
        yield found


def shell(line: str) -> None:
    words = shlex.split(line)
    if words[0] == "mkdir":
        return
    done = run(*words[1:])
    assert done.returncode in (0, 1), done.stderr


def test_studio_shell_and_python_give_the_same_bytes(opened: Opened, wave: Path, tmp_path: Path) -> None:
    project = opened.solved(wave, "g1_class")
    opened.do(project, "judge")
    ours = {name: (project.place / name).read_bytes() for name in ("trajectory.npz", "report.pinned.json")}
    exported = opened.asked("export", project=project.key, format="mjlab")
    *_, last = lines = project.commands()
    for line in [*lines[:-1], last.replace("--format csv", "--format mjlab").replace(".csv", ".mjlab.npz")]:
        shell(line)
    assert (project.place / "trajectory.mjlab.npz").read_bytes() == exported
    mine, theirs = (json.loads(text)["figures"] for text in (ours["report.pinned.json"], (project.place / "report.pinned.json").read_bytes()))
    assert {k: v for k, v in mine.items() if v != theirs[k]} == {}, {k: theirs[k] for k, v in mine.items() if v != theirs[k]}
    assert {name: (project.place / name).read_bytes() for name in ours} == ours
    result = rr.retarget(project.motion_file, "g1_class")
    report = rr.simulate(result)
    assert report.trajectory is not None
    assert report.trajectory.save(tmp_path / "python.npz").read_bytes() == ours["trajectory.npz"]
