"""The table of robots in `benchmarks/retargeting.md`: `python scripts/bench/tested_robots.py --robots MJCF … --clips FILE …`.

Every clip is solved without balance and scored against its motion; a row has the means over the clips.
"""

import argparse
from pathlib import Path

import numpy as np

import robot_retarget as rr

COLUMNS = {
    "limbs": ("limb_deg_mean", 2), "twist": ("twist_deg_mean", 2), "largest twist": ("twist_deg_max", 1), "distances": ("distance_err_mean", 3),
    "recall": ("contact_recall", 2), "skate": ("skate_cm_s", 2), "jerk": ("jerk_rms", 0),
}  # fmt: skip
"""Columns of the table, the figures of scores that they show, and their digits."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="+", type=Path, required=True)
    parser.add_argument("--clips", nargs="+", type=Path, required=True)
    given = parser.parse_args()
    print("| robot |", " | ".join(COLUMNS), "|\n|", " | ".join(["---"] * (1 + len(COLUMNS))), "|")
    for name in given.robots:
        robot, found = rr.load_robot(str(name)), []
        for motion in map(rr.read_motion, given.clips):
            solved = rr.retarget(motion, robot, balance="off").trajectory
            found.append(rr.score(solved, robot, motion).figures)
        means = [np.mean([f[key] for f in found if f[key] is not None]) for key, _ in COLUMNS.values()]
        cells = [f"{mean:.{digits}f}" for mean, (_, digits) in zip(means, COLUMNS.values(), strict=True)]
        print("|", " | ".join([name.stem, *cells]), "|", flush=True)


if __name__ == "__main__":
    main()
