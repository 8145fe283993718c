"""How fast and how well a live stream follows, next to a differential inverse kinematics; and where its time goes.

Frames per second of processor time at the source's rate, all constraints kept, the human described frame by frame as well;
the peer is given its description. Set OMP_NUM_THREADS=1 to keep to one core.
"""

import argparse
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import bench_solve
import numpy as np
from bench_solve import G1, PEER, WALK, clocked, has_mink, inverse_kinematics, prepare
from retarget_figures import figures

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import CausalTargets, at_rate
from robot_retarget.human.causal import CausalFeatures
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.stream import Stream

RATES = (30.0, 60.0, 120.0)
PARTS = {
    "describing the human": [(CausalFeatures, "step"), (CausalTargets, "at")],
    "looking for links inside each other, lifting": [
        (FrameSolver, "backtrack_to_clearance"),
        (FrameSolver, "raise_above_floor"),
    ],
    "Python of the steps": [(FrameSolver, "real_time_step")],
    **{name: places for name, places in bench_solve.PARTS.items() if name != "Python of the descent"},
}
HEAD = "| case | solver | code | frames/s | × mink | p50 [ms] | p99 [ms] | limb_deg | skate_cm_s | jerk |"
SHARE_HEAD = "| case | part | calls a frame | µs a frame | share [%] |"


def streamed(robot: Robot, motion: Motion, lag: int, native: bool) -> tuple[Floats, Floats]:
    """(T, nq) configurations and (T,) seconds of processor time that each took."""
    stream, turns = Stream(robot, motion.skeleton, calibration=motion, lag=lag, native=native), motion.rotations
    stream.wait()
    qpos, took = [], np.empty(len(motion))
    for t, positions in enumerate(motion.positions):
        began = time.process_time()
        pose = stream.push(positions, None if turns is None else turns[t], time=t / motion.fps)
        took[t] = time.process_time() - began
        qpos.append(pose.qpos.copy())
    return np.array(qpos), took


def rows(robot: Robot, clip: Motion, fps: float, repeats: int, peer: bool) -> list[str]:
    """Of one case: the stream with and without machine code, with a lag, and the peer, in interleaved runs."""
    motion = at_rate(clip, fps)
    graph = prepare(motion, robot, fps)
    cases = {("stream", "machine"): (0, True), ("stream", "CasADi"): (0, False), ("lag of 3", "machine"): (3, True)}
    rounds, rates = [], []
    for _ in range(repeats):
        rounds.append({case: streamed(robot, motion, *how) for case, how in cases.items()})
        if peer:
            rates.append(inverse_kinematics(graph).rate)
    found, name = [], f"{robot.name}, {Path(motion.source).stem} at {fps:g}/s"
    for case in cases:
        took = np.array([one[case][1][1:] for one in rounds])
        rate = float(np.median(1 / took.mean(axis=1)))
        lag = cases[case][0]
        judged = figures(
            robot, graph.match, graph.match.human_positions(motion)[: len(motion) - lag], rounds[0][case][0][lag:], fps
        )
        cells = [
            f"{rate:.0f}",
            f"{rate / np.median(rates):.1f}" if rates else "",
            f"{1e3 * np.quantile(took, 0.5):.2f}",
            f"{1e3 * np.quantile(took, 0.99):.2f}",
            f"{judged.limb_deg:.1f}",
            f"{judged.skate_cm_s:.1f}",
            f"{judged.jerk:.0f}",
        ]
        found.append(f"| {name} | " + " | ".join([*case, *cells]) + " |")
    return [*found, *([f"| {name} | {PEER} | | {np.median(rates):.0f} | 1.0 | | | | | |"] if rates else [])]


def shares(robot: Robot, clip: Motion, fps: float) -> list[str]:
    """Where the time of a frame goes."""
    motion, found = at_rate(clip, fps), []
    with clocked(PARTS) as parts:
        took = streamed(robot, motion, 0, True)[1]
    name = f"{robot.name}, {Path(motion.source).stem} at {fps:g}/s"
    whole = 1e6 * float(took.sum()) / len(motion)
    for part, spent in parts.items():
        if spent.calls:
            each = 1e6 * spent.seconds / len(motion)
            found.append(
                f"| {name} | {part} | {spent.calls / len(motion):.1f} | {each:.0f} | {100 * each / whole:.0f} |"
            )
    rest = whole - sum(1e6 * spent.seconds / len(motion) for spent in parts.values())
    return [*found, f"| {name} | everything else | | {rest:.0f} | {100 * rest / whole:.0f} |"]


def main() -> None:
    """Print both tables."""
    there = G1.is_file() and WALK.is_file()
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--robots", nargs="+", default=[str(G1), "op3"] if there else ["op3"], help="names or MJCF files")
    ask.add_argument("--clips", nargs="+", type=Path, default=[WALK] if there else [SAMPLES / "walk.bvh"])
    ask.add_argument("--fps", nargs="+", type=float, default=RATES, help="of the source")
    ask.add_argument("--repeats", type=int, default=5, help="runs of which the median counts")
    given, peer = ask.parse_args(), has_mink()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores" + ("" if peer else "; mink is not installed"))
    cases = [
        (rr.load_robot(robot), rr.read_motion(clip), fps)
        for robot in given.robots
        for clip in given.clips
        for fps in given.fps
    ]
    tables: list[tuple[str, Callable[..., list[str]]]] = [
        (HEAD, partial(rows, repeats=given.repeats, peer=peer)),
        (SHARE_HEAD, shares),
    ]
    for head, made in tables:
        print(f"\n{head}\n" + "|---" * (head.count("|") - 1) + "|")
        for case in cases:
            print(*made(*case), sep="\n", flush=True)


if __name__ == "__main__":
    main()
