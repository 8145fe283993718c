"""How far whole clips stay from the cheapest basin of every frame: `python scripts/bench/basins.py --robots op3 FILE.xml --clips FILES`.

At some frames the cost of the frame's edges (no smoothness, which is between frames) is compared with the least that
`STARTS` descents find from poses drawn over the joints' ranges. *As it is* takes the pose of the clip, which gives way to
its neighbours; *basin* first lets it descend by itself, so that what remains is the choice of basin alone. Excess in per
cent of the least, median and largest over the frames.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.options import Search
from robot_retarget.solver.solve import problem_of, solve_graph
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.starts import multistart

STARTS = 12
"""Per frame: the reference and the standing pose, the others drawn."""
EXACT = Search(starts=STARTS - 2, tolerance=2e-6)
"""Descents go on until they gain a fifty-thousandth."""


@dataclass(frozen=True)
class Excess:
    """Of F frames, over the least cost that was found."""

    frames: np.ndarray
    as_it_is: Floats
    basin: Floats
    """(F,) shares of the least [-]."""


def excess(graph: rr.RobotGraph, every: int, search: Search | None = None) -> Excess:
    """Solve a graph as a whole clip and look at one of `every` frames."""
    problem = problem_of(graph)
    solution = solve_graph(graph, problem=problem, search=search)
    solver, asked = FrameSolver(problem), targets_of(solution.graph.tracks)
    frames = np.arange(every // 2, len(graph), every)
    table = []
    for t in frames.tolist():
        q, targets = solution.trajectory.qpos[t], asked.at(t)
        own, alone = (
            solver.costs.cost(q, targets),
            solver.solve_frame(q, targets, iterations=2 * solver.options.iterations),
        )
        ends = multistart(solver, solution.graph, asked, [t], EXACT)[0]
        least = min(solver.costs.cost(end.qpos, targets) for end in ends)
        table.append((own / least, solver.costs.cost(alone.qpos, targets) / least))
    as_it_is, basin = np.maximum(np.array(table) - 1.0, 0.0).T
    return Excess(frames, as_it_is, basin)


def row(robot: str, clip: str, found: Excess) -> str:
    """A line of the table."""
    cells = (f"{100 * of(part):.1f}" for part in (found.as_it_is, found.basin) for of in (np.median, np.max))
    return f"| {robot} | {clip} | {len(found.frames)} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--robots", nargs="+", default=["op3"], help="names or MJCF files")
    ask.add_argument("--clips", nargs="+", type=Path, default=sorted(SAMPLES.glob("*.bvh")))
    ask.add_argument("--every", type=int, default=5, help="look at one of so many frames")
    ask.add_argument("--verbose", action="store_true", help="print the frames over 5 %%")
    given = ask.parse_args()
    print("| robot | clip | frames | as it is: median | most | basin: median | most |\n|---|---|---|---|---|---|---|")
    for name in given.robots:
        robot = rr.load_robot(name)
        for clip in given.clips:
            found = excess(rr.describe(rr.read_motion(clip), robot), given.every)
            print(row(robot.name, clip.stem, found), flush=True)
            if given.verbose:
                print([(int(t), round(100 * b)) for t, b in zip(found.frames, found.basin, strict=True) if b > 0.05])


if __name__ == "__main__":
    main()
