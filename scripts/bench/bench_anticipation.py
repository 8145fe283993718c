"""What interaction edges change in the solver, against separation alone: `python scripts/bench/bench_anticipation.py` prints a table.

    python scripts/bench/bench_anticipation.py --robot FILE.xml --clips FILES [--weights 3 10] [--plot FILE.png]

Every clip is carried over without separation first: that says where links would collide. From there on back in time,
avoidance has begun as long as the pair stays more than `APART` further apart than without separation.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from retarget_figures import Figures, figures, mean

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.collision.warn import warnings_of
from robot_retarget.graph.weights import Weights
from robot_retarget.robot.distances import LinkDistances

APART = 0.003
"""[m]."""
FAR = 0.08
"""Distances are told apart up to here [m]."""
GAP = 4
"""Contacts of a pair that part for less frames are one."""


@dataclass(frozen=True, eq=False)
class Run:
    """One clip, solved one way."""

    figures: Figures
    distance: Floats
    """(T, P) between the links' geoms [m]."""
    fps: float
    alarms: int
    """Warnings that it raises; where nothing touches, all of them are false."""
    stress: float
    """What was minimised, summed over the frames."""


def solved(motion: rr.Motion, robot: rr.Robot, links: LinkDistances, fps: float, weight: float | None) -> Run:
    """Retarget a clip with interaction edges of a weight, or without separation, and measure the result."""
    graph = rr.describe(motion, robot, fps=fps, weights=Weights(interaction=weight or 0.0))
    result = rr.solve(graph.without("separation") if weight is None else graph, balance="off")
    qpos = result.trajectory.qpos
    human = result.match.human_positions(result.motion)
    distance = links.along(qpos)
    alarms, stress = len(warnings_of(result.trajectory, robot).events), float(result.solution.cost.sum())
    return Run(figures(robot, result.match, human, qpos, fps), distance, fps, alarms, stress)


def collisions(free: Run) -> list[tuple[int, int]]:
    """Pair and first frame of every collision without separation, but for those under way at the outset."""
    found = []
    for pair in np.flatnonzero((free.distance <= 0).any(axis=0)).tolist():
        frames = np.flatnonzero(free.distance[:, pair] <= 0)
        starts = frames[np.diff(frames, prepend=-GAP - 1) > GAP]
        found += [(pair, int(start)) for start in starts if start >= 3]
    return found


def starts(free: Run, run: Run) -> list[float]:
    """How long before each collision avoidance begins [s]."""
    found = []
    for pair, start in collisions(free):
        away, first = run.distance[:, pair] - free.distance[:, pair] > APART, start
        while first > 0 and away[first - 1]:
            first -= 1
        found.append((start - first) / run.fps)
    return found


def plot(free: Run, runs: dict[str, Run], names: Sequence[tuple[str, str]], path: Path) -> None:
    """The distance of the pair that collides first, each way."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    pair, start = min(collisions(free), key=lambda one: one[1])
    window = slice(max(start - 30, 0), start + 30)
    times = np.arange(len(free.distance))[window] / free.fps
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for label, run in {"without separation": free, **runs}.items():
        axes.plot(times, 100 * run.distance[window, pair], label=label)
    axes.axhline(0, color="black", linewidth=0.5)
    axes.set(xlabel="time [s]", ylabel="distance [cm]", title=" – ".join(names[pair]))
    axes.legend(fontsize="small")
    figure.savefig(path, dpi=110)


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--robot", nargs="+", default=["op3"], help="names or MJCF files")
    ask.add_argument("--clips", type=Path, nargs="+", default=sorted(SAMPLES.glob("*.bvh")), help="BVH files")
    ask.add_argument("--weights", type=float, nargs="+", default=[1.0, 3.0, 10.0], help="π of interaction edges")
    ask.add_argument("--fps", type=float, default=30.0)
    ask.add_argument("--plot", type=Path, help="draw the first collision of the last clip with one")
    given = ask.parse_args()
    ways = {
        "separation alone": 0.0,
        **{f"edges, {w:g}": w for w in given.weights},
    }
    print(
        "| robot | solved with | collisions avoided | begins [s] | alarms | stress | limbs [°] | jerk [rad/s³] | overlap [%] | deepest [cm] |"
    )
    print("|---" * 10 + "|", flush=True)
    for name in given.robot:
        robot = rr.load_robot(name)
        links = LinkDistances(robot, FAR)
        motions = [rr.read_motion(path) for path in given.clips]
        free = [solved(motion, robot, links, given.fps, None) for motion in motions]
        runs = {way: [solved(m, robot, links, given.fps, weight) for m in motions] for way, weight in ways.items()}
        for way, found in runs.items():
            times = [t for one, run in zip(free, found, strict=True) for t in starts(one, run)]
            f = mean([run.figures for run in found])
            begins = f"{np.mean(times):.3f}" if times else "–"
            print(
                f"| {robot.name} | {way} | {len(times)} | {begins} "
                f"| {sum(r.alarms for r in found)} | {sum(r.stress for r in found):.0f} | {f.limb_deg:.2f} | {f.jerk:.0f} "
                f"| {f.overlap_pct:.2f} | {f.depth_cm:.2f} |",
                flush=True,
            )
        hit = [k for k, one in enumerate(free) if collisions(one)]
        if given.plot and hit:
            plot(free[hit[-1]], {way: found[hit[-1]] for way, found in runs.items()}, links.names, given.plot)


if __name__ == "__main__":
    main()
