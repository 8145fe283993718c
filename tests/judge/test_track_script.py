"""The script that runs frozen trackers: a window is a clip of its own, a reference begins on the floor, and pairs are counted."""

import runpy
import subprocess
from pathlib import Path

import numpy as np
from shared_files import ROOT

import robot_retarget as rr

TRACK = runpy.run_path(str(ROOT / "scripts/bench/track.py"), run_name="track")


def test_a_window_of_a_file_in_a_clone_is_a_bvh_with_its_frames(tmp_path: Path) -> None:
    clone, name = tmp_path / "owner+name", "wave.bvh"
    clone.mkdir()
    (clone / name).write_bytes((ROOT / "samples" / name).read_bytes())
    for words in (("init", "-q"), ("add", name), ("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-qm", "a")):
        subprocess.run(["git", *words], cwd=clone, check=True)
    line = {"repo": "owner/name", "commit": "HEAD", "path": name, "first": "20", "last": "50"}
    window, whole = rr.read_motion(TRACK["cut"](line, tmp_path, tmp_path / "cut.bvh")), rr.read_motion(clone / name)
    assert len(window) == 30 and window.fps == whole.fps
    spans = [np.ptp(motion.positions, axis=0) for motion in (window, whole.frames(20, 50))]
    np.testing.assert_allclose(*spans, atol=1e-6)


def test_a_reference_begins_at_its_first_frame_with_a_sole_on_the_floor() -> None:
    robot = rr.load_robot("op3")
    qpos = np.tile(robot.standing(), (10, 1))
    qpos[:4, 2] += 0.1
    hop = rr.Trajectory(qpos, 30.0, robot.joint_names, robot.name)
    assert len(TRACK["begun_on_the_floor"](hop, robot)) == 6


def test_pairs_in_which_one_alone_falls_have_the_p_of_a_sign_test() -> None:
    """Six of six: 2/2⁶. Three windows of two runs each: 2/2³."""
    found = {(f"w{k}", maker): [maker == "GMR"] * 2 for k in range(3) for maker in ("ours", "GMR")}
    runs, windows = TRACK["table"](found).splitlines()[-2:]
    assert runs.endswith("ours 0, GMR 6, p = 0.031") and windows.endswith("ours 0, GMR 3, p = 0.250")
