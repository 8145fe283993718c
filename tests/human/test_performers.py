"""Several people in one file are listed, and the first is read."""

import re

import numpy as np
import pytest
from shared_files import SHARED, needs_shared
from typer.testing import CliRunner

from robot_retarget.human.read import performers, read_motion
from robot_retarget.human.recognition import recognise
from robot_retarget.tools.cli import app
from robot_retarget.trajectory import load_trajectory

pytestmark = needs_shared
CLIPS = SHARED / "motions" / "bvh"
WALK = CLIPS / "lafan1_procedural" / "walk_procedural.bvh"


def parts(path) -> tuple[str, str, list[str]]:
    """Hierarchy, frame time and rows of a BVH."""
    head, motion = re.split(r"MOTION\s*\n", path.read_text())
    _, time, *rows = motion.strip().splitlines()
    return head.split("HIERARCHY", 1)[1], time, rows


def two(path, again, wrapped: bool) -> None:
    """A file of a walk, and of the same walk again 2 m aside and backwards, under two roots or one."""
    head, time, rows = parts(WALK)
    other = re.sub(r"(ROOT|JOINT) ", again, head)
    first = [row.split() for row in rows]
    second = [[str(float(row[0]) + 200), *row[1:]] for row in reversed(first)]
    both = [" ".join([*a, *b]) for a, b in zip(first, second, strict=True)]
    if wrapped:
        inner = (head + other).replace("ROOT", "JOINT")
        head, other = "\nROOT scene\n{\nOFFSET 0 0 0\nCHANNELS 0\n" + inner + "}\n", ""
    path.write_text(f"HIERARCHY{head}{other}MOTION\nFrames: {len(both)}\n{time}\n" + "\n".join(both) + "\n")


@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize("again", [r"\1 ", r"\1 B_"])
def test_of_two_people_the_first_is_read_and_both_are_named(wrapped: bool, again: str, tmp_path) -> None:
    two(tmp_path / "two.bvh", again, wrapped)
    motion, alone = read_motion(tmp_path / "two.bvh"), read_motion(WALK)
    assert len(motion.skeleton) == len(alone.skeleton)
    np.testing.assert_allclose(motion.positions, alone.positions, atol=1e-6)
    second = "B_Hips" if "B_" in again else "Hips_2"
    assert any(f"The first of 2 motions was read (Hips, {second})" in note for note in motion.notes)
    assert performers(tmp_path / "two.bvh") == ("Hips", second) and performers(WALK) == ()
    other = read_motion(f"{tmp_path / 'two.bvh'}#{second}")
    assert other.skeleton.names[0] == second and not any("of 2 motions" in note for note in other.notes)
    np.testing.assert_allclose(np.ptp(other.positions[:, 0], axis=0), np.ptp(alone.positions[:, 0], axis=0), atol=1e-6)


@pytest.mark.parametrize("clip", sorted(CLIPS.glob("*/*.bvh")), ids=lambda path: path.stem)
def test_one_person_is_one_performer(clip) -> None:
    assert performers(clip) == ()


def test_a_prop_beside_a_person_is_no_performer(tmp_path) -> None:
    head, time, rows = parts(WALK)
    prop = "ROOT ball\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n}\n"
    rows = [f"{row} 0 0 0" for row in rows]
    path = tmp_path / "prop.bvh"
    path.write_text(f"HIERARCHY{head}{prop}MOTION\nFrames: {len(rows)}\n{time}\n" + "\n".join(rows) + "\n")
    motion = read_motion(path)
    assert not any("of 2 motions" in note for note in motion.notes)
    assert recognise(motion.skeleton, motion.positions).confidence > 0.5


def test_joints_of_one_name_are_said_in_one_note(tmp_path) -> None:
    two(tmp_path / "two.bvh", r"\1 ", False)
    said = [
        note for note in read_motion(tmp_path / "two.bvh").notes if "Hips_2" in note and "ask for another" not in note
    ]
    assert len(said) == 1 and "22 joints" in said[0]


def test_all_people_of_a_file_are_retargeted_each_into_a_file_of_its_own(tmp_path) -> None:
    two(tmp_path / "two.bvh", r"\1 B_", False)
    command = ["solve", str(tmp_path / "two.bvh"), "-r", "op3", "--frames", "0:12", "--balance", "off", "-q"]

    def run(performer: str, output: str) -> int:
        return CliRunner().invoke(app, [*command, "--performer", performer, "-o", str(tmp_path / output)]).exit_code

    assert run("all", "t.npz") == 0
    first, second = (load_trajectory(tmp_path / f"t_{name}.npz") for name in ("Hips", "B_Hips"))
    assert len(first) == len(second) == 12 and not (tmp_path / "t.npz").exists()
    assert np.abs(first.qpos - second.qpos).max() > 0.01
    assert run("B_Hips", "b.npz") == 0
    np.testing.assert_array_equal(load_trajectory(tmp_path / "b.npz").qpos, second.qpos)
