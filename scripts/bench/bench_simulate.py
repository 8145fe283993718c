"""How long a rollout takes beside a bare `mj_step` loop of the same steps, and many rollouts at once.

    python scripts/bench/bench_simulate.py            # the shipped clips on op3

Prints a table. Both run in turns, and their CPU times are compared by the fastest turn of each: other work on the machine
only makes a turn slower.
"""

import argparse
import os
import time
from collections.abc import Callable

import mujoco
import numpy as np

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.plant import Mode, Plant
from robot_retarget.judge.playback import plain_goals, roll_out
from robot_retarget.judge.rollout import plant_of, rollouts
from robot_retarget.judge.worlds import draws
from robot_retarget.trajectory import Trajectory

MODES: tuple[Mode, ...] = ("pinned", "free")


def bare_loop(plant: Plant, trajectory: Trajectory) -> Callable[[], None]:
    """The same physics steps with the same controls and nothing else: what cannot be saved."""
    goals = plain_goals(plant, trajectory)
    held = round(1 / (goals.rate * plant.model.opt.timestep))
    controls = np.repeat(plant.controls(goals.angles), held, axis=0)

    def loop() -> None:
        data = mujoco.MjData(plant.model)
        data.qpos[:] = trajectory.qpos[0]
        for control in controls:
            data.ctrl[:] = control
            mujoco.mj_step(plant.model, data)

    return loop


def in_turns(first: Callable[[], object], second: Callable[[], object], rounds: int) -> tuple[float, float, float]:
    """The CPU time of the fastest turn of each [s], and second / first."""
    times = np.empty((rounds, 2))
    for turn in times:
        for k, run in enumerate((first, second)):
            began = time.process_time()
            run()
            turn[k] = time.process_time() - began
    bare, ours = times.min(axis=0)
    return float(bare), float(ours), float(ours / bare)


def report(trajectory: Trajectory, name: str, rounds: int, worlds: int) -> list[float]:
    """Print the rows of a clip; the overheads of both modes."""
    robot, ratios = rr.load_robot("op3"), []
    for mode in MODES:
        plant = plant_of(robot, mode)
        bare, ours, ratio = in_turns(
            bare_loop(plant, trajectory), lambda p=plant, m=mode: roll_out(p, trajectory, m), rounds
        )
        began = time.perf_counter()
        command = compensated(plant, trajectory, mode)
        planned = time.perf_counter() - began
        began = time.perf_counter()
        many = rollouts(plant, trajectory, draws(worlds), mode=mode, command=command)
        spent = time.perf_counter() - began
        frames = worlds * len(trajectory) / spent
        steps = round(roll_out(plant, trajectory, mode).steps_per_second)
        ratios.append(ratio)
        print(
            f"| {name} | {mode} | {1000 * bare:.0f} | {1000 * ours:.0f} | {ratio:.2f} | {steps} "
            f"| {1000 * planned:.0f} | {len(many)} in {spent:.2f} s | {frames:.0f} |",
            flush=True,
        )
    return ratios


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--rounds", type=int, default=7)
    ap.add_argument("--worlds", type=int, default=20)
    arg = ap.parse_args()
    print(f"MuJoCo {mujoco.__version__}, {os.cpu_count()} processors")
    print(
        "| clip | mode | bare loop ms | rollout ms | ratio | steps/s | compensation ms | worlds | frames/s in worlds |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    robot = rr.load_robot("op3")
    ratios = []
    for clip in sorted(SAMPLES.glob("*.bvh")):
        trajectory = rr.retarget(rr.read_motion(clip), robot, balance="off").trajectory
        ratios += report(trajectory, clip.stem, arg.rounds, arg.worlds)
    print(f"\nworst ratio {max(ratios):.2f}, mean {np.mean(ratios):.2f}")


if __name__ == "__main__":
    main()
