"""What other people's scripts depend on: the Python example of the contract and the one of the README, as they stand."""

import re
from pathlib import Path

import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget as rr


def test_the_python_contract_runs_as_written(tmp_path: Path) -> None:
    motion = rr.read_motion(ROOT / "samples/clap.bvh").frames(0, 10)
    robot = rr.load_robot("op3")
    result = rr.retarget(motion, robot)
    assert len(result.solution.status) == len(result.trajectory) == len(result.warnings)
    report = rr.simulate(result.trajectory, robot)
    assert report.verdict in ("pass", "fail") and report.figures
    result.trajectory.save(tmp_path / "out.npz")
    loaded = rr.load_trajectory(tmp_path / "out.npz")
    assert (loaded.qpos == result.trajectory.qpos).all() and loaded.joint_names == robot.joint_names


def test_interaction_distance_takes_leading_axes_and_upper_triangle_pairs() -> None:
    draw = np.random.default_rng(0)
    previous, current = draw.normal(size=(2, 4, 5, 3))
    distance, alpha = rr.interaction_distance(previous, current)
    assert distance.shape == alpha.shape == (4, 10)
    i, j = np.triu_indices(5, 1)
    assert (distance <= np.linalg.norm(current[:, i] - current[:, j], axis=2) + 1e-12).all()


def test_the_example_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert code is not None
    (tmp_path / "samples").symlink_to(ROOT / "samples")
    monkeypatch.chdir(tmp_path)
    exec(compile(code.group(1), "README.md", "exec"), {})
    assert (tmp_path / "wave.npz").is_file()
