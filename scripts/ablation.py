"""Which edge kind buys what: `python scripts/ablation.py --robots op3 … --clips FILE …` prints a Markdown table.

Every row is the solver with one kind left out, every figure a mean over the clips (`depth_cm` and `step_rad` are the
largest), the weights stand over the tables. One table a robot. Definitions: `scripts/retarget_figures.py`.
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, field, fields
from pathlib import Path

from retarget_figures import Figures, figures, mean

import robot_retarget as rr
from robot_retarget.describe.edges import Weights
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.clip import Smoothing
from robot_retarget.solve.frame import Options


@dataclass(frozen=True)
class Variant:
    """The solver with something left out."""

    weights: Weights = field(default_factory=Weights)
    options: Options = field(default_factory=Options)
    smoothing: Smoothing = field(default_factory=Smoothing)


VARIANTS: dict[str, Variant] = {
    "everything": Variant(),
    "no posture": Variant(Weights(posture=0.0)),
    "no touch": Variant(Weights(touch=0.0)),
    "no compass": Variant(Weights(compass=0.0)),
    "no girdle": Variant(Weights(girdle=0.0)),
    "no marker": Variant(Weights(marker=0.0)),
    "no path": Variant(Weights(path=0.0)),
    "no rest": Variant(Weights(rest=0.0)),
    "distances by squares": Variant(Weights(posture=10.0, give=1e6)),
    "distances only": Variant(Weights(compass=0.0, girdle=0.0, marker=0.0)),
    "directions only": Variant(Weights(posture=0.0, touch=0.0)),
    "no footholds": Variant(options=Options(footholds=False)),
    "no separation": Variant(options=Options(separation=False)),
    "no second differences": Variant(smoothing=Smoothing(stiffness=0.0)),
    "frame by frame": Variant(smoothing=Smoothing(passes=0)),
}
"""Without second differences the clip still starts from a sketch; frame by frame it does not."""
DECIMALS = (1, 3, 2, 1, 2, 2, 2, 0, 2)
"""Of the columns, in the order of `Figures`."""


def measure(motion: rr.Motion, robot: rr.Robot, variant: Variant, fps: float | None = None) -> Figures:
    """Retarget one clip and judge the result."""
    result = rr.retarget(
        motion,
        robot,
        fps=fps,
        weights=variant.weights,
        options=variant.options,
        smoothing=variant.smoothing,
    )
    human = result.match.human_positions(result.motion)
    return figures(robot, result.match, human, result.trajectory.qpos, result.trajectory.fps)


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
    ask.add_argument("--only", nargs="+", choices=VARIANTS, default=list(VARIANTS))
    given = ask.parse_args()
    motions = [rr.read_motion(path) for path in given.clips]
    print(", ".join(f"{kind} {weight:g}" for kind, weight in asdict(Weights()).items()))
    for name in given.robots:
        robot = rr.load_robot(name)
        print(f"\n{robot.name}: {', '.join(path.stem for path in given.clips)}\n")
        print("| left out | " + " | ".join(f.name for f in fields(Figures)) + " |")
        print("|---" * (1 + len(fields(Figures))) + "|", flush=True)
        for variant in given.only:
            print(*rows(motions, robot, [variant], given.fps), flush=True)


if __name__ == "__main__":
    main()
