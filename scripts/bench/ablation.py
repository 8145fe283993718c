"""Which edge kind and which mechanism buys what: `python scripts/bench/ablation.py --robots op3 … --clips FILE … [--mechanisms]`.

Every row is the solver with one kind left out, every figure a mean over the clips (`depth_cm` and `step_rad` are the
largest), the weights stand over the tables. One table a robot. Definitions: `scripts/bench/retarget_figures.py`.
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, field, fields
from pathlib import Path

from retarget_figures import Figures, figures, mean

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.weights import Weights
from robot_retarget.solver.options import Search, Smoothing, SolveOptions
from robot_retarget.solver.solve import solve_graph


@dataclass(frozen=True)
class Variant:
    """The solver with something left out."""

    weights: Weights = field(default_factory=Weights)
    options: SolveOptions = field(default_factory=SolveOptions)
    smoothing: Smoothing = field(default_factory=Smoothing)
    search: Search = field(default_factory=Search)
    without: str = ""
    """A kind of edge."""


KINDS: dict[str, Variant] = {
    "everything": Variant(),
    **{
        f"no {kind}": Variant(without=kind)
        for kind in ("posture", "touch", "compass", "orientation", "path", "foothold")
    },
    "no hip and shoulder lines": Variant(Weights(hips=0.0, shoulders=0.0)),
    "distances by squares": Variant(Weights(huber_delta=1e6)),
    "no separation": Variant(without="separation"),
    "no second differences": Variant(Weights(smooth=1e-3)),
}
MECHANISMS: dict[str, Variant] = {
    "everything": Variant(),
    "no drawn starts": Variant(search=Search(starts=0)),
    "links measured at every step": Variant(options=SolveOptions(distance_cache_radius=0.0)),
    "four steps": Variant(smoothing=Smoothing(steps=4)),
}
"""Ablation of the solver: the figures without each of its mechanisms."""
VARIANTS = KINDS | MECHANISMS
DECIMALS = (1, 3, 2, 1, 2, 2, 2, 0, 2)
"""Of the columns, in the order of `Figures`."""


def measure(motion: rr.Motion, robot: rr.Robot, variant: Variant, fps: float | None = None) -> Figures:
    """Retarget one clip and judge the result."""
    graph = rr.describe(motion, robot, fps=fps, weights=variant.weights)
    graph = graph.without(variant.without) if variant.without else graph
    solution = solve_graph(graph, options=variant.options, smoothing=variant.smoothing, search=variant.search)
    human = graph.match.human_positions(graph.motion)
    return figures(robot, graph.match, human, solution.trajectory.qpos, graph.fps)


def rows(motions: Sequence[rr.Motion], robot: rr.Robot, names: Sequence[str], fps: float | None = None) -> list[str]:
    """The lines of one robot's table under its head."""
    lines = []
    for name in names:
        found = mean([measure(motion, robot, VARIANTS[name], fps) for motion in motions])
        lines.append(f"| {name} | " + " | ".join(_cells(found)) + " |")
    return lines


def _cells(found: Figures) -> list[str]:
    return [f"{value:.{places}f}" for value, places in zip(astuple(found), DECIMALS, strict=True)]


def main() -> None:
    """Print one table a robot."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--robots", nargs="+", default=["op3"], help="shipped names or MJCF files")
    ask.add_argument("--clips", nargs="+", type=Path, default=sorted(SAMPLES.glob("*.bvh")))
    ask.add_argument("--fps", type=float, default=None, help="frames per second of the trajectories")
    ask.add_argument("--mechanisms", action="store_true", help="leave out mechanisms of the solver, not kinds of edges")
    ask.add_argument("--only", nargs="+", choices=VARIANTS)
    given = ask.parse_args()
    chosen = given.only or list(MECHANISMS if given.mechanisms else KINDS)
    motions = [rr.read_motion(path) for path in given.clips]
    print(", ".join(f"{kind} {weight}" for kind, weight in asdict(Weights()).items()))
    for name in given.robots:
        robot = rr.load_robot(name)
        print(f"\n{robot.name}: {', '.join(path.stem for path in given.clips)}\n")
        print("| left out | " + " | ".join(f.name for f in fields(Figures)) + " |")
        print("|---" * (1 + len(fields(Figures))) + "|", flush=True)
        for variant in chosen:
            print(*rows(motions, robot, [variant], given.fps), flush=True)


if __name__ == "__main__":
    main()
