"""Trajectories of `bench_scene.py --out` as files for OmniRetarget's own `evaluation/eval_retargeting.py`.

    python scripts/bench/omniretarget_files.py FOLDER TRAJECTORY… --out RESULTS

FOLDER is holosoma_retargeting of the unpacked wheel; a trajectory has the name of its clip. The file's world is that of the capture, scaled: blocks that
stand at its origin show how far the robot's world is from it, and their size shows the scale. OmniRetarget scales a climber of 1.78 m to a robot of
1.32 m; this package scales by the leg. The printed option gives the evaluator the same scale. Run it with MuJoCo 3.12 or newer: older versions
measure wrong distances. Its contact of climbs is that of the last frame, since it does not set the pose.
"""

import argparse
from pathlib import Path

import numpy as np

import robot_retarget as rr

CLIMBER = 1.78
"""Height of the climbers, by OmniRetarget [m]."""


def converted(trajectory: rr.Trajectory) -> np.ndarray:
    """Return qpos with the pose of the moving body behind it, in the world of the blocks at rest."""
    scene = trajectory.scene
    assert scene is not None
    qpos, poses = np.array(trajectory.qpos), scene.poses(len(trajectory))
    moving = [k for k, body in enumerate(scene.bodies) if not body.fixed]
    if not moving:
        qpos[:, :2] -= poses[0, 0, :2]
    return np.concatenate([qpos, *(poses[:, k] for k in moving)], axis=1)


def scale_of(trajectory: rr.Trajectory, folder: Path) -> float:
    """Return the size of the first block over its captured size [-]."""
    scene, file = trajectory.scene, folder / "box_models/box1.obj"
    assert scene is not None
    captured = np.array([line.split()[1:4] for line in file.read_text().splitlines() if line.startswith("v ")], float)
    return float(scene.bodies[0].shape.size[0] / np.ptp(captured, axis=0)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("package", type=Path)
    parser.add_argument("trajectories", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for file in given.trajectories:
        trajectory, climb = rr.load_trajectory(file), given.package / "demo_data/climb" / file.stem
        qpos = converted(trajectory)
        if climb.is_dir():
            qpos = qpos[: len(np.load(next(climb.glob("*.npy")))[::4])]
            height = CLIMBER * scale_of(trajectory, climb)
            print(f"{file.stem}: --data_type robot_terrain --robot-config.robot-height {height:.6f}")
        else:
            print(f"{file.stem}: --data_type robot_object")
        np.savez(given.out / f"{file.stem}_original.npz", qpos=qpos, cost=0.0)


if __name__ == "__main__":
    main()
