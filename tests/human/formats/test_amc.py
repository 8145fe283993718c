"""ASF/AMC: bones where a second kinematics, written on the text of the files, puts them."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_files import ROOT, SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.base.errors import MotionError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.capture import Capture, Request
from robot_retarget.human.pace import rate_from_gait
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers import amc, bvh
from robot_retarget.human.readers.bvh import write_bvh
from robot_retarget.human.recognition import recognise

FOLDER = SHARED / "motions" / "other" / "asfamc"
BVH = SHARED / "motions" / "bvh" / "cmu_cgspeed_motionbuilder" / "02_01_walk.bvh"
ASF = """
:version 1.10
:units
  length 0.45
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     name thigh
     direction 0 -1 0
     length 7
     axis 0 0 20 XYZ
    dof rx ry rz
  end
  begin
     name shin
     direction 0 -1 0
     length 7
     axis 0 0 20 XYZ
    dof rx
  end
:hierarchy
  begin
    root thigh
    thigh shin
  end
"""
AMC = ":FULLY-SPECIFIED\n:DEGREES\n1\nroot 0 1 2 0 0 0\nthigh 10 20 30\nshin 40\n2\nroot 0 1 2 0 0 0\nthigh 0 0 0\nshin 0\n"


def about(axis: int, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix[j, j], matrix[j, k], matrix[k, j], matrix[k, k] = c, -s, s, c
    return matrix


def second_kinematics(asf: str, amc_text: str) -> list[dict[str, np.ndarray]]:
    """The end of every bone in every frame, by matrices and regular expressions."""
    bones = {}
    for block in re.findall(r"begin(.*?)end", asf.split(":bonedata")[1].split(":hierarchy")[0], re.S):
        name, *direction = groups(r"name (\S+)\s+direction (\S+) (\S+) (\S+)", block)
        length = float(groups(r"length (\S+)", block)[0])
        x, y, z = map(float, groups(r"axis (\S+) (\S+) (\S+)", block))
        dof = re.search(r"dof (.*)", block)
        axes = about(2, z) @ about(1, y) @ about(0, x)
        bones[name] = np.array(direction, float) * length, axes, dof[1].split() if dof else []
    parent = {}
    for line in asf.split(":hierarchy")[1].splitlines():
        words = line.split()
        parent |= {child: words[0] for child in words[1:]}
    frames = []
    for frame in re.split(r"^\d+\s*$", amc_text, flags=re.M)[1:]:
        said = {line.split()[0]: list(map(float, line.split()[1:])) for line in frame.strip().splitlines()}
        root = said["root"]
        turn = {"root": about(2, root[5]) @ about(1, root[4]) @ about(0, root[3])}
        end = {"root": np.array(root[:3])}
        for name, (reach, axes, dof) in in_order(bones, parent):
            own = np.eye(3)
            for freedom, value in zip(dof, said.get(name, []), strict=True):
                own = about("xyz".index(freedom[1]), value) @ own
            turn[name] = turn[parent[name]] @ axes @ own @ axes.T
            end[name] = end[parent[name]] + turn[name] @ reach
        frames.append(end)
    return frames


def groups(pattern: str, text: str) -> tuple[str, ...]:
    found = re.search(pattern, text)
    assert found is not None, pattern
    return found.groups()


def in_order(bones: dict, parent: dict) -> list:
    done, ordered = {"root"}, []
    while len(ordered) < len(bones):
        for name, bone in bones.items():
            if name not in done and parent[name] in done:
                done.add(name)
                ordered.append((name, bone))
    return ordered


@needs_shared
@pytest.mark.parametrize("take", ["02_01", "02_03"])
def test_every_joint_stands_where_a_second_kinematics_ends_its_parent(take):
    capture = amc.read(FOLDER / f"{take}.amc", Request())
    frames = second_kinematics((FOLDER / "02.asf").read_text(), (FOLDER / f"{take}.amc").read_text())
    assert len(frames) == len(capture.positions)
    for joint, name in enumerate(capture.skeleton.names):
        parent = capture.skeleton.parents[joint]
        above = name.removesuffix("_end") if name.endswith("_end") else capture.skeleton.names[max(parent, 0)]
        assert capture.positions[:, joint] == pytest.approx(np.array([frame[above] for frame in frames]), abs=1e-9), (
            name
        )


@needs_shared
def test_a_take_of_the_library_has_all_keypoints_at_a_humans_size():
    motion = read_motion(FOLDER / "02_01.amc")
    assert motion.fps == 120 and len(motion) == 343
    recognition = recognise(motion.skeleton, motion.positions)
    assert recognition.keypoints == KEYPOINTS
    assert {motion.skeleton.names[j] for k in ("l_knee", "r_elbow") for j in recognition.marks[k].joints} == {
        "ltibia",
        "rradius",
    }
    height = recognition.place(motion.positions)[:, recognition.keypoints.index("head"), 2]
    assert 1.3 < height.mean() < 1.7


@needs_shared
def test_the_same_take_as_bvh_gives_the_same_trajectory(tmp_path):
    motion = replace(read_motion(FOLDER / "02_01.amc").frames(0, 60), whole=None)
    write_bvh(motion, tmp_path / "take.bvh")
    robot = rr.load_robot("op3")
    both = [
        rr.retarget(one, robot, fps=15, balance="off").trajectory.qpos
        for one in (motion, read_motion(tmp_path / "take.bvh"))
    ]
    assert np.abs(both[0] - both[1]).max() < 0.03


@needs_shared
def test_the_library_own_conversion_of_the_take_bends_the_elbows_alike():
    """That BVH is of another skeleton, 6 % larger: its poses are not these, but its elbows bend by the same angles."""
    ours, theirs = amc.read(FOLDER / "02_01.amc", Request()), bvh.read_bvh(BVH)
    for names, others in (
        (("lhumerus", "lradius", "lwrist"), ("LeftArm", "LeftForeArm", "LeftHand")),
        (("rhumerus", "rradius", "rwrist"), ("RightArm", "RightForeArm", "RightHand")),
    ):
        a, b = bend(ours, names), bend(theirs, others)
        assert np.abs(a - b - (a - b).mean()).max() < np.radians(1.5)


def bend(capture, names) -> np.ndarray:
    first, middle, last = (capture.positions[:, capture.skeleton.names.index(name)] for name in names)
    u, v = middle - first, last - middle
    return np.arccos((u * v).sum(1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1))


def take(tmp_path: Path, asf: str = ASF, amc_text: str = AMC) -> Path:
    (tmp_path / "s.asf").write_text(asf)
    (tmp_path / "s_01.amc").write_text(amc_text)
    return tmp_path / "s_01.amc"


def test_angles_of_zero_give_the_rest_pose(tmp_path):
    capture = amc.read(take(tmp_path), Request())
    assert capture.positions[1] == pytest.approx(np.add(capture.skeleton.rest(), [0, 1, 2]))
    assert capture.skeleton.names == ("root", "thigh", "shin", "shin_end")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("shin 40", "shin 40 50"), r"s_01\.amc:6: 'shin': expected 1 finite numbers \(rx\), found"),
        (("shin 40", "shin x"), r"s_01\.amc:6: 'shin': expected 1"),
        (("shin 40", "shin nan"), r"s_01\.amc:6: 'shin': expected 1"),
        (("shin 40", "foot 40"), r"s_01\.amc:6: the skeleton has no bone 'foot'"),
        (("shin 40", "thigh 1 2 3"), r"s_01\.amc:6: a second line for 'thigh'"),
        (("thigh 10 20 30\n", ""), r"s_01\.amc:6: frame 1 ends without 'thigh'"),
        (("\nshin 0\n", "\n"), r"s_01\.amc:9: frame 2 ends without 'shin': truncated"),
        ((AMC[26:], ""), r"expected frames, a number and then a line a bone"),
    ],
)
def test_a_broken_motion_names_its_line(tmp_path, change, message):
    with pytest.raises(MotionError, match=message):
        amc.read(take(tmp_path, amc_text=AMC.replace(*change)), Request())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("direction 0 -1 0", "direction 0 -1"), r"s\.asf:14: direction: expected 3 finite numbers"),
        (("dof rx ry rz", "dof rx rw"), r"s\.asf:17: unknown degree of freedom 'rw'; known"),
        (("axis 0 0 20 XYZ", "axis 0 0 20 XYW"), r"s\.asf:16: expected an order of axes such as XYZ, found 'XYW'"),
        (("    thigh shin", ""), r"s\.asf:19: bone 'shin' has no parent in :hierarchy"),
        (("root thigh", "root leg"), r"s\.asf:\d+: unknown bone 'leg'; known: root, thigh, shin"),
        (("name shin", "name thigh"), r"s\.asf:\d+: a second bone 'thigh'"),
        ((ASF[ASF.index(":bonedata") :], ""), r"expected :bonedata with bones"),
    ],
)
def test_a_broken_skeleton_names_its_line(tmp_path, change, message):
    with pytest.raises(MotionError, match=message):
        amc.read(take(tmp_path, asf=ASF.replace(*change)), Request())


def test_a_motion_without_its_skeleton_says_which_file_is_missing(tmp_path):
    path = take(tmp_path)
    (tmp_path / "s.asf").rename(tmp_path / "x.asf")
    assert len(amc.read(path, Request()).positions) == 2, "the only skeleton of a folder is everyone's"
    (tmp_path / "y.asf").write_text(ASF)
    with pytest.raises(
        MotionError, match=r"needs its skeleton next to it, s\.asf or s_01\.asf; there are x\.asf, y\.asf"
    ):
        amc.read(path, Request())
    with pytest.raises(MotionError, match="a skeleton without a motion"):
        read_motion(tmp_path / "x.asf")


@pytest.mark.parametrize("rate", [30, 60, 120])
def test_a_walk_tells_at_which_rate_it_was_captured(rate: int):
    """The rate itself is the oracle: a walk that was captured at 30 frames per second, seen at others."""
    walk = read_motion(ROOT / "samples" / "walk.bvh")
    seen = walk.resample(rate)
    blind = Capture(seen.skeleton, seen.positions, seen.rotations, 77.0, "walk")
    found = rate_from_gait(blind)
    assert found is not None and found[0] == rate
    assert re.search(
        rf"{rate} frames per second were taken, by its strides of 1\.\d\d m: (0\.9|1\.0) m/s at {rate}", found[1]
    )


def test_a_body_that_stays_in_place_tells_no_rate():
    wave = read_motion(ROOT / "samples" / "wave.bvh")
    assert rate_from_gait(Capture(wave.skeleton, wave.positions, wave.rotations, 77.0, "wave")) is None


@needs_shared
def test_a_rate_that_is_given_is_taken_and_one_that_is_not_is_told_by_the_gait():
    assert any("by its strides of 1.31 m: 1.2 m/s at 120" in note for note in read_motion(FOLDER / "02_01.amc").notes)
    assert read_motion(FOLDER / "02_01.amc", fps=60).fps == 60
