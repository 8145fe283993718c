"""Compare the search with two other starts: `python scripts/bench/bench_starts.py --robots g1.xml op3 --clips FILE …`.

The passes over a clip start from the path that the search finds (*whole clip*), from the poses of a stream, and from those of
a stream over the reversed clip (*backward*). The table shows the cost of each; the last line counts the clips whose whole
clip costs more than both others.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.solver import clip as clip_module
from robot_retarget.solver.solve import solve_graph

ROUNDING = 1.005
"""Costs that differ by less are equal [-]: passes end when steps gain little."""


def reversed_in_time(motion: rr.Motion) -> rr.Motion:
    """Return the motion backwards."""
    turns = None if motion.rotations is None else motion.rotations[::-1].copy()
    return replace(motion, positions=motion.positions[::-1].copy(), rotations=turns)


def backward(graph: rr.RobotGraph) -> list[Floats]:
    """Return the poses of a stream over the reversed clip, in the order of the clip and on its path, which starts elsewhere."""
    robot, turned = graph.robot, rr.describe(reversed_in_time(graph.motion), graph.robot)
    qpos = np.array(list(rr.stream(robot, turned.motion)))[::-1].copy()
    away = np.mean(graph.pelvis - turned.pelvis[::-1], axis=0)[:2]
    if robot.floating:
        qpos[:, robot.root_address : robot.root_address + 2] += away
    return list(qpos)


def cost_from(graph: rr.RobotGraph, path: Sequence[Floats] | None) -> float:
    """Return the cost of a clip whose passes start from a path, or from that of the search."""
    if path is None:
        return float(solve_graph(graph).cost.sum())
    with patch.object(clip_module, "coarse_path", lambda *_: list(path)):
        return float(solve_graph(graph).cost.sum())


def costs(clip: Path, robot: rr.Robot) -> tuple[int, list[float]]:
    """Return the number of frames, and the costs from the three starts."""
    graph = rr.describe(rr.read_motion(clip), robot).unbalanced()
    motion = graph.motion
    return len(graph), [cost_from(graph, path) for path in (None, list(rr.stream(robot, motion)), backward(graph))]


def main() -> None:
    """Print the table."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--robots", nargs="+", default=["op3"], help="names or MJCF files")
    ask.add_argument("--clips", nargs="+", type=Path, default=sorted(SAMPLES.glob("*.bvh")))
    given = ask.parse_args()
    print("| robot | clip | frames | whole clip | stream | backward |\n|---|---|---|---|---|---|")
    worst = []
    for name in given.robots:
        robot = rr.load_robot(name)
        for clip in given.clips:
            frames, found = costs(clip, robot)
            worst.append(found[0] > ROUNDING * max(found[1:]))
            print(f"| {robot.name} | {clip.stem} | {frames} | {' | '.join(f'{c:.1f}' for c in found)} |", flush=True)
    print(f"\n{int(np.sum(worst))} of {len(worst)} whole clips cost more than both others")


if __name__ == "__main__":
    main()
