"""Files are written whole, through links and into devices, and never in the place of something that is no file."""

import os
import stat
import threading
from pathlib import Path

import pytest

from robot_retarget.base.errors import OutputError
from robot_retarget.base.files import replacing, require_writable


def write(path: Path, text: str = "new") -> None:
    require_writable(path)
    with replacing(path) as scratch:
        scratch.write_text(text)


def test_a_link_stays_a_link_and_its_file_is_written(tmp_path: Path) -> None:
    for name in ("there", "not yet"):
        target, link = tmp_path / "far" / name, tmp_path / f"link to {name}"
        target.parent.mkdir(exist_ok=True)
        link.symlink_to(target)
        write(link)
        assert link.is_symlink() and target.read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["far", "link to not yet", "link to there"]


def test_a_pipe_is_written_through(tmp_path: Path) -> None:
    pipe, read = tmp_path / "pipe", list[str]()
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    write(pipe)
    reader.join(10)
    assert read == ["new"] and stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_device_is_written_through() -> None:
    before = os.stat(os.devnull)
    write(Path(os.devnull))
    assert os.stat(os.devnull).st_ino == before.st_ino and stat.S_ISCHR(os.stat(os.devnull).st_mode)


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        write(tmp_path)
