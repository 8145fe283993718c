"""What each repair of penetration buys: `python scripts/bench/repairs.py --robots op3 … --clips FILE …`, without balance.

Every row leaves out one repair of a clip or of a stream. Cost and jerk are means over the clips, over those of the whole solver; overlaps of links at
frames and between them, and depths under the floor, are the largest, with the frames in which they exceed what the solver accepts.
"""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.minimum import ClipMinimum
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.solve import problem_of, solve_graph
from robot_retarget.solver.sqp import FrameSolver

PLAIN = Smoothing()
NO_LOOKS = (ClipMinimum, "keep_apart", lambda minimum: False)
BACK = (FrameSolver, "backtrack_to_clearance", lambda solver, before, pose: pose)
CLIPS: dict[str, tuple[Smoothing, tuple[tuple[Any, str, Any], ...]]] = {
    "nothing": (PLAIN, ()),
    "looks between frames": (PLAIN, (NO_LOOKS,)),
    "moving back": (PLAIN, (BACK,)),
    "raising over the floor": (PLAIN, ((FrameSolver, "raised", lambda solver, pose, depth: pose),)),
    "moving drawn starts out of links": (
        PLAIN,
        ((FrameSolver, "clear_of_links", lambda solver, before, after: after),),
    ),
}
STREAMS = {
    "nothing": (),
    "moving back": (BACK,),
    "raising over the floor": ((FrameSolver, "raise_above_floor", lambda solver, pose, targets: pose),),
}


class Outcome(NamedTuple):
    """One motion of a robot."""

    cost: float
    jerk: float
    """[rad/s³]."""
    depths: tuple[Floats, Floats, Floats]
    """Overlaps at frames (T,) and between them (T − 1,), and depths under the floor (T,) [m]."""


def outcome(solver: FrameSolver, graph: RobotGraph, qpos: Floats) -> Outcome:
    """Measure configurations (T, nq)."""
    targets = targets_of(graph.tracks).at(np.arange(len(qpos)))
    links = solver.costs.overlap(qpos)
    between = solver.depths_between(qpos[:-1], qpos[1:])
    third = np.diff(qpos[:, solver.robot.qpos_index], 3, axis=0) * graph.fps**3
    cost = float(solver.problem.cost(qpos, targets).sum())
    return Outcome(cost, float(np.sqrt((third**2).mean())), (links, between, solver.depths_under_floor(qpos, targets)))


@contextmanager
def without(patches: tuple[tuple[Any, str, Any], ...]) -> Iterator[None]:
    """Replace functions for the duration of a block."""
    with ExitStack() as stack:
        for owner, name, instead in patches:
            stack.enter_context(patch.object(owner, name, instead))
        yield


def rows(graphs: list[RobotGraph]) -> list[str]:
    """The tables of one robot, of clips and of streams."""
    found: dict[str, list[Outcome]] = {}
    for graph in graphs:
        problem = problem_of(graph)
        solver = FrameSolver(problem)
        for name, (smoothing, patches) in CLIPS.items():
            with without(patches):
                solved = solve_graph(graph, problem=problem, smoothing=smoothing).trajectory.qpos
            found.setdefault(f"clip: {name}", []).append(outcome(solver, graph, solved))
        for name, patches in STREAMS.items():
            with without(patches):
                followed = np.array(list(rr.stream(graph.robot, graph.motion)))
            found.setdefault(f"stream: {name}", []).append(outcome(solver, graph, followed[: len(graph)]))
    return [_row(name, several, found[f"{name.split(':')[0]}: nothing"]) for name, several in found.items()]


def _row(name: str, found: list[Outcome], whole: list[Outcome]) -> str:
    ratios = [
        100 * (np.mean([getattr(a, n) / getattr(b, n) for a, b in zip(found, whole, strict=True)]) - 1)
        for n in ("cost", "jerk")
    ]
    limits = (5e-4, 5e-4, 1e-4)
    deep = [np.concatenate([one.depths[k] for one in found]) for k in range(3)]
    cells = [f"{1000 * d.max():.2f} in {int((d > limit).sum())}" for d, limit in zip(deep, limits, strict=True)]
    return f"| {name} | " + " | ".join([*(f"{ratio:+.1f}" for ratio in ratios), *cells]) + " |"


def main() -> None:
    """Print one table a robot."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--robots", nargs="+", default=["op3"], help="shipped names or MJCF files")
    ask.add_argument("--clips", nargs="+", type=Path, default=sorted(SAMPLES.glob("*.bvh")))
    ask.add_argument("--seconds", type=float, default=5.0, help="length of each clip that is solved")
    given = ask.parse_args()
    motions = [rr.read_motion(path) for path in given.clips]
    for name in given.robots:
        robot = rr.load_robot(name)
        graphs = [rr.describe(m.frames(0, min(len(m), round(given.seconds * m.fps))), robot, fps=30) for m in motions]
        print(f"\n{robot.name}: {', '.join(path.stem for path in given.clips)}\n")
        print(
            "| left out | cost [%] | jerk [%] | links [mm], frames | between frames [mm], steps | floor [mm], frames |\n|---|---|---|---|---|---|"
        )
        print("\n".join(rows(graphs)), flush=True)


if __name__ == "__main__":
    main()
