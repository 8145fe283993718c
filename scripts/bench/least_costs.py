"""The least cost known per clip and robot, and how near a whole clip comes to it.

    python scripts/bench/least_costs.py --robots op3.xml g1.xml --clips FILES              # compare with the table
    python scripts/bench/least_costs.py --robots … --clips … --paths DIR … --drawn --record  # look for less, and lower the table

A clip is solved as `solve` does. With `--record` it is solved from more starts too: from its own result, from the paths
`DIR/ROBOT.CLIP.npz` (`qpos`) of other searches, and with `--drawn` from drawn limbs at every moment. The costs hold for the default weights: `least_costs.csv` names them, and a
change of the weights begins a new table.
"""

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.graph.weights import Weights
from robot_retarget.solver.options import Search
from robot_retarget.solver.solve import problem_of, solve_graph

TABLE = Path(__file__).with_suffix(".csv")
NEAR = 1.02
"""A clip is near the least cost known below this ratio [-]."""
MANY = Search(dear=1.0, starts=16, finished=8)
"""Drawn limbs at every moment, in twice as many starts."""


def known() -> dict[tuple[str, str], tuple[str, float]]:
    """Return the table: robot and clip → the weights' name and the least cost."""
    if not TABLE.exists():
        return {}
    with TABLE.open(encoding="utf-8") as file:
        return {(row["robot"], row["clip"]): (row["weights"], float(row["cost"])) for row in csv.DictReader(file)}


def weights_name() -> str:
    """Return what names the default weights: their numbers."""
    return " ".join(f"{value:g}" for value in vars(Weights()).values() if isinstance(value, float))


def starts(paths: list[Path], robot: str, clip: str, frames: int) -> Iterator[Floats]:
    """Yield the paths (T, nq) that folders hold of a clip."""
    for folder in paths:
        file = folder / f"{robot}.{clip}.npz"
        if file.exists():
            with np.load(file, allow_pickle=False) as held:
                if len(held["qpos"]) == frames:
                    yield held["qpos"]


def costs(clip: Path, robot: rr.Robot, paths: list[Path], more: bool, drawn: bool) -> list[float]:
    """Return the cost of a whole clip, and with `more` those from other starts."""
    graph = rr.describe(rr.read_motion(clip), robot).unbalanced()
    problem = problem_of(graph)
    found = [solve_graph(graph, problem=problem)]
    if more:
        begun = [found[0].trajectory.qpos, *starts(paths, robot.name, clip.stem, len(graph))]
        begun += [solve_graph(graph, problem=problem, search=MANY).trajectory.qpos] if drawn else []
        found += [solve_graph(graph, problem=problem, start=path) for path in begun]
    return [float(solution.cost.sum()) for solution in found]


def main() -> None:
    """Print a line per clip and robot: cost, least cost known, ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="+", required=True)
    parser.add_argument("--clips", nargs="+", type=Path, required=True)
    parser.add_argument("--paths", nargs="*", type=Path, default=[])
    parser.add_argument("--drawn", action="store_true")
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    table, weights, near = known(), weights_name(), 0
    for name in given.robots:
        robot = rr.load_robot(name)
        for clip in given.clips:
            own, *others = costs(clip, robot, given.paths, given.record, given.drawn)
            held = table.get((robot.name, clip.stem), ("", float("inf")))
            least: float = min([own, *others, *([held[1]] if held[0] == weights else [])])
            table[robot.name, clip.stem] = weights, round(least, 2)
            near += own <= NEAR * least
            print(f"{robot.name:14} {clip.stem:22} {own:9.1f} {least:9.1f} {own / least:6.3f}", flush=True)
            if given.record:
                with TABLE.open("w", newline="", encoding="utf-8") as file:
                    rows = sorted((*key, *value) for key, value in table.items())
                    csv.writer(file).writerows([("robot", "clip", "weights", "cost"), *rows])
    print(f"{near} of {len(given.robots) * len(given.clips)} within {NEAR:g} of the least cost known")


if __name__ == "__main__":
    main()
