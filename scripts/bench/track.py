#!/usr/bin/env python3
"""Run frozen tracking policies on references of ours and of GMR, and print the falls, in pairs of the same window, policy and seed.

    python scripts/bench/track.py --policies twist2_1017_20k.onnx=g1_sim2sim_29dof.xml --repos CLONES --gmr CLONE --python VENV/bin/python

A policy is any that `simulate --policy` reads, followed by the model of its deployment; TWIST2's are `assets/ckpts` and `assets/g1` of
amazon-far/TWIST2. Windows are those of `track_clips.csv`: each is a BVH of its own frames. CLONES holds `owner+name` of each repository,
`--gmr` is a work tree of GMR, and VENV has mink, daqp, rich and mujoco. Our references have the defaults and no balance, on GMR's G1; GMR
solves its first frame 30 times (`bench_peers.write_gmr`). A policy begins at the reference's first frame on the floor, with its velocities and a disturbance by seed,
and no ways into and out of a stand. `--worlds N` runs references with such ways too, in the nominal world and N drawn ones. Needs onnxruntime.
"""

import argparse
import csv
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.stats import binomtest

import robot_retarget as rr
from robot_retarget.edit.stands import between_stands
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.playback import Rollout, plain_goals, roll_out
from robot_retarget.judge.policy import Policy, under_policy
from robot_retarget.judge.policy_files import read_policy
from robot_retarget.judge.rollout import IN_MOTION, followed, plant_of
from robot_retarget.robot import recognise, world_points

CLIPS = Path(__file__).with_name("track_clips.csv")
SEEDS = (1, 2)
JOINTS, SPEEDS, ROOT = 0.02, 0.1, 0.05
"""Standard deviations of the first pose and velocity: of the joints [rad], [rad/s], and of the root [m/s]; the protocol of issue 66."""
LOW = 0.4
"""A pelvis this far off the reference's height has fallen [m]; the same protocol."""
FLOOR = 0.01
"""A sole no higher is on the floor [m]; a sole that stands is within a millimetre of it."""
STAND = 0.6
"""Ways from and into the stand of the second table [s], as before 2026-11-29."""


def main() -> None:
    """Print a line for each window, and the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policies", nargs="+", required=True, metavar="ONNX=XML")
    parser.add_argument("--repos", type=Path, required=True)
    parser.add_argument("--gmr", type=Path, required=True)
    parser.add_argument("--python", help="of GMR; without it ours run alone")
    parser.add_argument("--only", nargs="*", help="names of windows")
    parser.add_argument("--worlds", type=int, default=0)
    given = parser.parse_args()
    robot = rr.load_robot(given.gmr / "assets/unitree_g1/g1_mocap_29dof.xml")
    policies = [
        (read_policy(file), rr.load_robot(model)) for file, model in (each.split("=") for each in given.policies)
    ]
    plants = [under_policy(plant_of(model, "free", None, 0.0), policy) for policy, model in policies]
    found, ways = dict[tuple[str, str], list[bool]](), dict[str, list[int]]()
    for window, maker, reference in references(given, robot):
        falls = [
            fall_of(plant, policy, begun_on_the_floor(reference, robot), seed)
            for plant, (policy, _) in zip(plants, policies, strict=True)
            for seed in SEEDS
        ]
        found[window, maker] = [fall is not None for fall in falls]
        print(window, maker, *("up" if fall is None else f"{fall:.1f} s" for fall in falls), flush=True)
        if given.worlds:
            whole = between_stands(reference, robot, STAND)
            counts = [followed(whole, model, policy, given.worlds, window).fallen for policy, model in policies]
            ways.setdefault(maker, []).extend(counts)
    print(table(found))
    for maker, counts in ways.items():
        print(f"{maker}, with ways of {STAND} s: {sum(counts)} falls of {len(counts) * (1 + given.worlds)}")


def references(given: argparse.Namespace, robot: rr.Robot) -> Iterator[tuple[str, str, rr.Trajectory]]:
    """Yield window, maker and trajectory of every reference."""
    with TemporaryDirectory() as folder:
        for line in csv.DictReader(CLIPS.open(encoding="utf-8")):
            if given.only and line["clip"] not in given.only:
                continue
            file = cut(line, given.repos, Path(folder) / f"{line['clip']}.bvh")
            trajectory = rr.retarget(file, robot, balance="off").trajectory
            yield line["clip"], "ours", trajectory
            if given.python:
                case = f"{file}:0:{len(trajectory)}"
                gmr = [given.python, CLIPS.with_name("bench_peers.py"), "--gmr", given.gmr, "--cases", case, "--write"]
                subprocess.run(gmr, check=True, stdout=subprocess.DEVNULL)
                yield line["clip"], "GMR", trajectory.altered(qpos=np.load(file.with_suffix(".npy")))


def cut(line: dict[str, str], repos: Path, file: Path) -> Path:
    """Write the frames of a window as a BVH of their own, and return it."""
    clone = repos / line["repo"].replace("/", "+")
    clone = next(each for each in (clone / "repo/.git", clone / "repo", clone / ".git", clone) if each.is_dir())
    show = ["git", "--git-dir", str(clone), "show", f"{line['commit']}:{line['path']}"]
    lines = subprocess.run(show, check=True, capture_output=True, text=True).stdout.split("\n")
    head = next(k for k, text in enumerate(lines) if text.startswith("Frames:"))
    frames = [text for text in lines[head + 2 :] if text.strip()][int(line["first"]) : int(line["last"])]
    file.write_text(
        "\n".join([*lines[:head], f"Frames: {len(frames)}", lines[head + 1], *frames, ""]), encoding="utf-8"
    )
    return file


def begun_on_the_floor(reference: rr.Trajectory, robot: rr.Robot) -> rr.Trajectory:
    """Return the reference from its first frame with a sole on the floor on."""
    treads = recognise(robot).treads.values()
    lowest = np.min([world_points(robot, points, reference.qpos)[..., 2].min(axis=1) for points in treads], axis=0)
    first = int(np.argmax(lowest < FLOOR))
    return reference.altered(qpos=reference.qpos[first:], source_time=reference.source_time[first:])


def fall_of(plant: Plant, policy: Policy, reference: rr.Trajectory, seed: int) -> float | None:
    """Return when the robot falls [s], or None; its first pose and velocity are disturbed."""
    draw, hinges, qpos = np.random.default_rng(seed), plant.robot.qpos_index, reference.qpos.copy()
    turn, speed, travel = (
        draw.normal(0, width, n) for width, n in ((JOINTS, len(hinges)), (SPEEDS, len(hinges)), (ROOT, 3))
    )
    qpos[:2, hinges] += turn
    qpos[1, hinges] += speed / reference.fps
    qpos[1, :3] += travel / reference.fps
    playback = replace(IN_MOTION, rate=policy.contract.rate)
    goals = plain_goals(plant, reference, playback)
    return fallen_at(roll_out(plant, reference.altered(qpos=qpos), "free", playback, goals), reference)


def fallen_at(run: Rollout, reference: rr.Trajectory) -> float | None:
    """Return when the pelvis is `LOW` off the reference's height or upside down, or the simulation ends early [s]; None if never."""
    height = np.interp(run.times, np.arange(len(reference)) / reference.fps, reference.qpos[:, 2])
    upside = (run.qpos[:, 4:6] ** 2).sum(axis=1) > 0.5
    fallen = np.flatnonzero(upside | (np.abs(run.qpos[:, 2] - height) > LOW))
    return float(run.times[fallen[0]]) if fallen.size else run.unstable


def table(found: dict[tuple[str, str], list[bool]]) -> str:
    """Return the falls of each maker, and the pairs in which one alone falls, by run and by window, with p of a sign test."""
    makers = list(dict.fromkeys(maker for _, maker in found))
    lines = [f"{maker}: {sum(sum(runs) for (_, own), runs in found.items() if own == maker)} falls" for maker in makers]
    if len(makers) == 2:
        counts = np.array(
            [[found[window, maker] for maker in makers] for window in dict.fromkeys(w for w, _ in found)], int
        )
        for name, pairs in (("runs", counts.transpose(0, 2, 1).reshape(-1, 2)), ("windows", counts.sum(axis=2))):
            more = [int((pairs[:, k] > pairs[:, 1 - k]).sum()) for k in range(2)]
            p = binomtest(more[0], sum(more)).pvalue if sum(more) else 1.0
            lines.append(f"{name} in which one falls (more): {makers[0]} {more[0]}, {makers[1]} {more[1]}, p = {p:.3f}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
