"""Measure whole clips and streams on the G1 against GMR and placo, in turns: frames per second of processor time, medians.

    OMP_NUM_THREADS=1 python scripts/bench/bench_peers.py --gmr CLONE --python VENV/bin/python --cases walk.bvh:0:240 dance.bvh:700:1000

CLONE is GMR with its G1, VENV has mink, daqp, placo, rich and mujoco, and a case is a BVH of LAFAN1 with its first and last frame. GMR runs as it is:
`retarget()` of every frame, reading excluded. placo is given GMR's targets and weights and takes 2 steps of the first table and 4 of the
second; it has neither self-collision, footholds, floor nor speeds. Ours is `rr.retarget(…, balance="off")` and `Stream.push` on GMR's model.
"""

import argparse
import importlib.metadata
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

STEPS = (2, 4)
"""placo's steps a frame, by GMR's two tables of tasks."""


def peers(clone: Path, clip: str, first: int, last: int) -> dict[str, float]:
    """Return frames per second of GMR and of placo; runs in their environment."""
    frames, gmr = gmr_of(clone, clip)
    frames, targets, took = frames[first:last], [], 0.0
    gmr.retarget(frames[0])
    for frame in frames:
        began = time.process_time()
        gmr.retarget(frame)
        took += time.process_time() - began
        targets.append(
            [[task.transform_target_to_world.as_matrix() for task in tasks] for tasks in (gmr.tasks1, gmr.tasks2)]
        )
    return {"GMR": len(frames) / took, "placo": with_placo(clone, gmr, targets)}


def gmr_of(clone: Path, clip: str) -> tuple[list[Any], Any]:
    """Return GMR's frames of a clip, and its solver for the human's height."""
    package = ModuleType("general_motion_retargeting")  # its own __init__ imports viewers and torch
    package.__path__ = [str(clone / "general_motion_retargeting")]
    sys.modules["general_motion_retargeting"] = package
    from general_motion_retargeting.motion_retarget import GeneralMotionRetargeting  # pyright: ignore
    from general_motion_retargeting.utils.lafan1 import load_bvh_file  # pyright: ignore

    frames, height = load_bvh_file(clip)
    gmr = GeneralMotionRetargeting("bvh_lafan1", "unitree_g1", height, verbose=False)
    return frames, gmr


def write_gmr(clone: Path, clip: str, first: int, last: int) -> None:
    """Write GMR's configurations of frames beside their clip (`.npy`), the first frame solved 30 times; runs in its environment."""
    frames, gmr = gmr_of(clone, clip)
    for frame in [frames[first]] * 30:
        gmr.retarget(frame)
    np.save(Path(clip).with_suffix(".npy"), [gmr.retarget(frame).copy() for frame in frames[first:last]])


def with_placo(clone: Path, gmr: Any, targets: list[Any]) -> float:
    """Return placo's frames per second on GMR's targets."""
    import placo  # pyright: ignore

    urdf = clone / "assets/unitree_g1/g1_custom_collision_29dof.urdf"
    robot = placo.RobotWrapper(str(urdf), placo.Flags.ignore_collisions)
    robot.set_T_world_frame("pelvis", targets[0][1][0])
    solvers: list[Any] = []
    for given, aims in zip((gmr.tasks1, gmr.tasks2), targets[0], strict=True):
        solver = placo.KinematicsSolver(robot)
        solver.enable_joint_limits(True)
        tasks = [solver.add_frame_task(task.frame_name, aim) for task, aim in zip(given, aims, strict=True)]
        for task, theirs in zip(tasks, given, strict=True):
            task.configure(
                theirs.frame_name, "soft", *(float(cost[0] ** 2) for cost in (theirs.cost[:3], theirs.cost[3:]))
            )
        solver.add_regularization_task(1e-4)
        solvers.append((solver, tasks))

    def solve(aims: Any) -> None:
        for (solver, tasks), own, steps in zip(solvers, aims, STEPS, strict=True):
            for task, aim in zip(tasks, own, strict=True):
                task.T_world_frame = aim
            for _ in range(steps):
                solver.solve(True)
                robot.update_kinematics()

    for _ in range(20):
        solve(targets[0])
    began = time.process_time()
    for aims in targets:
        solve(aims)
    return len(targets) / (time.process_time() - began)


def ours(clone: Path, clip: str, first: int, last: int) -> dict[str, Callable[[], float]]:
    """Return runs that measure our frames per second."""
    from bench_stream import streamed

    import robot_retarget as rr

    robot = rr.load_robot(clone / "assets/unitree_g1/g1_mocap_29dof.xml")
    motion = rr.read_motion(clip).frames(first, last)
    rr.retarget(motion, robot, balance="off")  # compiled functions are cached

    def whole() -> float:
        began = time.process_time()
        rr.retarget(motion, robot, balance="off")
        return len(motion) / (time.process_time() - began)

    return {
        "whole clip": whole,
        "stream": lambda: float(len(motion) / streamed(robot, motion, 0, True)[1].sum()),
    }


def main() -> None:
    """Print a table, or what the peers took as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gmr", type=Path, required=True, help="clone of GMR")
    parser.add_argument("--python", type=Path, help="of the environment with mink, daqp and placo")
    parser.add_argument("--cases", nargs="+", required=True, metavar="FILE:FIRST:LAST")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--peers", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--write", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    cases = [(clip, int(first), int(last)) for clip, first, last in (case.rsplit(":", 2) for case in given.cases)]
    if given.write:
        return write_gmr(given.gmr, *cases[0])
    if given.peers:
        return print("\n" + json.dumps(peers(given.gmr, *cases[0])))
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores, mujoco {importlib.metadata.version('mujoco')}\n")
    print("| case | frames | solver | frames/s | × GMR |\n|---|---|---|---|---|")
    for case, words in zip(cases, given.cases, strict=True):
        command = [given.python, __file__, "--gmr", given.gmr, "--cases", words, "--peers"]
        runs, rates = ours(given.gmr, *case), dict[str, list[float]]()
        for _ in range(given.repeats):
            theirs = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1]
            for name, rate in {**{name: run() for name, run in runs.items()}, **json.loads(theirs)}.items():
                rates.setdefault(name, []).append(rate)
        median = {name: float(np.median(found)) for name, found in rates.items()}
        for name, rate in median.items():
            frames = case[2] - case[1]
            print(f"| {Path(case[0]).stem} | {frames} | {name} | {rate:.0f} | {rate / median['GMR']:.2f} |", flush=True)


if __name__ == "__main__":
    main()
