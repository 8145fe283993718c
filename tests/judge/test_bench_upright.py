"""The measure of uprightness on clips whose answer is known."""

from pathlib import Path

import numpy as np
from bench_upright import judged, table

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES


def test_a_squat_over_standing_feet_is_upright_in_its_row_and_in_drawn_worlds(tmp_path: Path) -> None:
    rr.write_bvh(rr.read_motion(SAMPLES / "squat.bvh").frames(0, 100).resample(15), tmp_path / "squat.bvh")
    row = judged(tmp_path / "squat.bvh", rr.load_robot("op3"), "stand", 2)
    assert row.verdict.startswith("pass (free, with feedback, margin") and row.upright == 1.0 and row.reasons == ""
    assert row.slowdown is not None and row.slowdown <= 2 and row.slip_cm is not None and row.slip_cm < 1
    assert f"| op3 | squat | in place | stand | {row.verdict} |" in table([row])


def test_a_jump_has_a_row_that_says_why_not(tmp_path: Path) -> None:
    motion = rr.read_motion(SAMPLES / "squat.bvh")
    path, lifted = tmp_path / "jump.npz", motion.positions.copy()
    time = np.linspace(0, 1, len(lifted))
    lifted[:, :, 2] += 0.5 * np.clip(1 - ((time - 0.5) / 0.04) ** 2, 0, None)[:, None]
    skeleton = motion.skeleton
    np.savez(path, positions=lifted, fps=motion.fps, names=np.array(skeleton.names), parents=skeleton.parents)
    row = judged(path, rr.load_robot("op3"), "follow", 0)
    assert row.verdict == "refused" and "the human leaves the floor, longest from" in row.reasons
