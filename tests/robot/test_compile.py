"""A model from the cache is the model of its files: a changed file or a spoiled cache leads to a new compilation."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from robot_retarget.robot import load_robot, source
from robot_retarget.robot.model import robot_sha256

MODEL = """<mujoco><compiler meshdir="parts"/><include file="assets.xml"/><worldbody><body name="base"><freejoint/>
<geom type="mesh" mesh="block"/><body name="arm"><joint name="elbow" axis="0 1 0" range="-1 1"/>
<geom type="mesh" mesh="block" pos="0 0 .3"/></body></body></worldbody></mujoco>"""
ASSETS = '<mujoco><asset><mesh name="block" file="block.obj"/></asset></mujoco>'
BLOCK = "\n".join(f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1))
FACES = "f 1 2 4\nf 1 4 3\nf 5 8 6\nf 5 7 8\nf 1 6 2\nf 1 5 6\nf 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n"


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A model of two files and a mesh; meshes of any size are kept."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(source, "KEPT_FROM", 0)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/block.obj").write_text(f"{BLOCK}\n{FACES}")
    (tmp_path / "assets.xml").write_text(ASSETS)
    (tmp_path / "robot.xml").write_text(MODEL)
    return tmp_path / "robot.xml"


def kept(model: Path) -> list[Path]:
    return sorted((model.parent / "robot-retarget").glob("*.mjb"))


def test_a_model_from_the_cache_is_the_compiled_one_to_the_last_byte(model: Path) -> None:
    first = robot_sha256(load_robot(model))
    made = {file: file.stat().st_mtime_ns for file in kept(model)}
    assert made
    assert robot_sha256(load_robot(model)) == first
    assert {file: file.stat().st_mtime_ns for file in kept(model)} == made


def test_a_copy_of_a_model_in_another_folder_is_the_one_that_is_compiled_there(model: Path, tmp_path: Path) -> None:
    load_robot(model)
    shutil.copytree(tmp_path, tmp_path / "elsewhere", ignore=shutil.ignore_patterns("robot-retarget"))
    after = robot_sha256(load_robot(tmp_path / "elsewhere/robot.xml"))
    for file in kept(model):
        file.unlink()
    assert robot_sha256(load_robot(tmp_path / "elsewhere/robot.xml")) == after


CHANGES: dict[str, Callable[[Path], object]] = {
    "the file": lambda folder: (folder / "robot.xml").write_text(MODEL.replace("0 0 .3", "0 0 .4")),
    "an included file": lambda folder: (folder / "assets.xml").write_text(
        ASSETS.replace("<mesh ", '<mesh scale="2 2 2" ')
    ),
    "a mesh": lambda folder: (folder / "parts/block.obj").write_text(f"{BLOCK.replace('0.1', '0.2')}\n{FACES}"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_changed_file_is_compiled_anew(model: Path, what: str) -> None:
    before = robot_sha256(load_robot(model))
    CHANGES[what](model.parent)
    for file in model.parent.rglob("*.*"):  # MuJoCo itself knows meshes by the second in which they were written
        os.utime(file, (2e9, 2e9))
    after = robot_sha256(load_robot(model))
    for file in kept(model):
        file.unlink()
    assert robot_sha256(load_robot(model)) == after != before


def test_a_spoiled_model_is_compiled_anew(model: Path) -> None:
    first = robot_sha256(load_robot(model))
    for file in kept(model):
        os.truncate(file, 1000)
    assert robot_sha256(load_robot(model)) == first
    assert all(file.stat().st_size > 1000 for file in kept(model))


def test_the_oldest_models_make_room_for_the_newest(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_robot(model)
    known = {file: file.stat().st_size for file in kept(model)}
    most = 1.5 * max(known.values())
    monkeypatch.setattr(source, "KEPT_BYTES", most)
    model.write_text(MODEL.replace("0 0 .3", "0 0 .4"))
    load_robot(model)
    left = kept(model)
    assert left and not known.keys() & set(left)
    assert sum(file.stat().st_size for file in left) <= most
    assert len(list(left[0].parent.glob("*.sha256"))) == len(left)


def test_a_cache_that_cannot_be_written_costs_nothing_but_time(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = robot_sha256(load_robot(model))
    monkeypatch.setenv("XDG_CACHE_HOME", str(model))
    assert robot_sha256(load_robot(model)) == first
