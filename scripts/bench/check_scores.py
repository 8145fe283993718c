#!/usr/bin/env python3
"""Compare `rr.score` with an independent judge, to the digits that it prints, on clips × robots.

    python scripts/bench/check_scores.py --shared ../shared --frames 90

Every clip is retargeted, judged and scored by the keypoints of the judge's own maps. Prints a line for each clip and robot and ends with
exit code 1 where a figure differs.
"""

import argparse
import importlib.util
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import mujoco

import robot_retarget as rr

CLIPS = (
    ("cmu_cgspeed_motionbuilder/02_01_walk.bvh", "cmu", 0.0),
    ("cmu_cgspeed_motionbuilder/05_06_dance.bvh", "cmu", 0.0),
    ("cmu_cgspeed_motionbuilder/npybvh_example_run.bvh", "cmu", 0.0),
    ("cmu_cgspeed_motionbuilder/walk_01_mixed_eol.bvh", "cmu", 0.0),
    ("cmu_hahne_3dsmax/jumping_jacks.bvh", "cmu_hahne", 0.0),
    ("fair1_zup/dab.bvh", "fair1", 0.0),
    ("fair1_zup/jumping.bvh", "fair1", 0.0),
    ("fair1_zup/wave_hello.bvh", "fair1", 0.0),
    ("lafan1_procedural/backflip_procedural.bvh", "lafan1", 0.0),
    ("lafan1_procedural/fall_getup_procedural.bvh", "lafan1", 0.0),
    ("lafan1_procedural/walk_procedural.bvh", "lafan1", 0.0),
    ("lafan1_procedural/wave_procedural.bvh", "lafan1", 0.0),
    ("perception_neuron/jesse_dance_rokoko_dir.bvh", "perception_neuron", 0.0),
    ("soma30_derived/soma30_pick_up_from_ground.bvh", "soma", 0.0),
    ("soma30_derived/soma30_walk_then_sneak.bvh", "soma", 0.0),
    ("xsens_mvn/BVH2SMPL_Sit54.bvh", "xsens", 0.0),
    ("xsens_mvn/bvh_test2.bvh", "xsens", 0.0),
    ("captury_like_mixed_orders/bvh_example_zup.bvh", "captury", 0.0),
    ("cmu_cgspeed_motionbuilder/05_06_dance.bvh", "cmu", 3.0),
    ("soma30_derived/soma30_walk_then_sneak.bvh", "soma", 3.0),
)
"""File, skeleton map of the judge, and where the window begins [s]."""
ROBOTS = ("unitree_g1", "robotis_op3", "booster_t1")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--shared", type=Path, default=Path("../shared"), help="folder with judge/, motions/ and robots/"
    )
    parser.add_argument("--frames", type=int, default=90, help="of every clip, from its first on")
    parser.add_argument("--robots", nargs="*", default=ROBOTS, choices=ROBOTS)
    given = parser.parse_args()
    judge, differing, count = load_judge(given.shared), 0, 0
    for name in given.robots:
        robot = rr.load_robot(str(given.shared / f"robots/{name}/{name}.xml"))
        for clip, skeleton, start in CLIPS:
            try:
                differences = compare(judge, given.shared, robot, name, clip, skeleton, start, given.frames)
            except (rr.RobotRetargetError, ValueError, KeyError) as error:
                print(f"{name:12} {clip:48} {start:3.0f} s not compared: {str(error).splitlines()[0]}")
                continue
            count, differing = count + 1, differing + bool(differences)
            print(f"{name:12} {clip:48} {start:3.0f} s {differences or 'equal'}", flush=True)
    print(f"{count - differing} of {count} equal")
    return int(differing > 0)


def compare(
    judge: Any, shared: Path, robot: rr.Robot, name: str, clip: str, skeleton: str, start: float, frames: int
) -> dict[str, tuple[Any, Any]]:
    """The figures that differ: the judge's and ours."""
    path, joints = shared / "motions/bvh" / clip, json.loads((shared / f"judge/skeletons/{skeleton}.json").read_text())
    spots = json.loads((shared / f"judge/robots/{name}.json").read_text())
    motion = rr.read_motion(path, repair=False)
    first = round(start * motion.fps)
    last = min(len(motion), first + round(frames * motion.fps / 30))
    part = motion.frames(first, last)
    trajectory = rr.retarget(part, robot, balance="off").trajectory
    human, dt = judge.human_keypoints(path, joints)
    human = human[len(human) - len(motion) :][first:last]  # reading drops calibration frames at the start
    model = mujoco.MjModel.from_xml_path(str(robot.path))
    theirs = judge.judge(human, dt, model, spots, trajectory.qpos, trajectory.fps)
    ours = rr.score(trajectory, robot, part, overrides=map_file(joints["joints"], spots["points"])).figures
    return {key: (value, ours[key]) for key, value in theirs.items() if key != "frames" and value != ours[key]}


def map_file(joints: dict[str, Any], points: dict[str, Any]) -> Path:
    """The judge's maps as a map file."""
    lines = ["[human]", *(f"{k} = {json.dumps(v)}" for k, v in joints.items())]
    lines += ["[robot]", *(f"{k} = {json.dumps(v)}" for k, v in points.items())]
    path = Path(tempfile.gettempdir()) / "judge_map.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def load_judge(shared: Path) -> Any:
    spec = importlib.util.spec_from_file_location("judge", shared / "judge/judge.py")
    if spec is None or spec.loader is None:
        raise SystemExit(f"no judge in {shared}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    sys.exit(main())
