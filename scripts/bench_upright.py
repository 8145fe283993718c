"""Which clips stay upright: `python scripts/bench_upright.py --robots op3 … --clips FILE … --legs auto stand`.

Every clip is brought into balance, played standing free on the robot's own actuators with three seconds of settling
before and after, and judged by the simulation. `--draws 20` plays what stays upright in as many drawn worlds too (`simulate/domain.py`).
Clips are classified by the human's feet. Set OMP_NUM_THREADS=1 to keep to one core.
"""

import argparse
import json
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path

import numpy as np

import robot_retarget as rr
from robot_retarget.describe.graph import MOST_FPS
from robot_retarget.errors import BalanceError
from robot_retarget.human.activity import activity_of
from robot_retarget.shipped import SAMPLES
from robot_retarget.simulate.compensate import compensated
from robot_retarget.simulate.domain import draws
from robot_retarget.simulate.figures import fall_figures
from robot_retarget.simulate.rollout import plant_of, rollouts
from robot_retarget.simulate.stepping import Playback

SETTLE = Playback(settle_before=3.0, settle_after=3.0)


@dataclass(frozen=True)
class Row:
    """One clip on one robot."""

    robot: str
    clip: str
    kind: str
    legs: str
    upright: bool
    slowdown: float | None = None
    stride: float | None = None
    slip_cm: float | None = None
    hits_mm: float | None = None
    """Deepest overlap of the robot with itself on its servos."""
    drawn: float | None = None
    """Share of the drawn worlds in which it stays upright."""
    off_deg: str = ""
    """How much further arms, trunk and legs are off the human's than without balance, on the mean."""
    reason: str = ""


def judged(clip: Path, robot: rr.Robot, legs: str, count: int) -> Row:
    """Balance, play, judge; in `count` drawn worlds too."""
    motion = rr.read_motion(clip)
    motion = motion.resample(min(motion.fps, MOST_FPS))
    head = robot.name, clip.stem, activity_of(motion, rr.match(motion, robot)).kind, legs
    try:
        graph = rr.describe(motion, robot)
        result, plain = rr.solve(graph, legs=legs, balance="static"), rr.solve(graph)
    except BalanceError as error:
        return Row(*head, False, reason=str(error).split(":")[0])
    report = rr.simulate(result.trajectory, robot, mode="free", playback=SETTLE)
    plant = plant_of(robot, "free")
    command = compensated(plant, result.trajectory, "free", SETTLE)
    upright = [
        world.unstable is None and fall_figures(world, robot, result.trajectory)["fall_s"] is None
        for world in rollouts(plant, result.trajectory, draws(count), playback=SETTLE, command=command)
    ]
    fell = report.figures["fall_s"] is not None or report.figures["unstable_s"] is not None
    assert result.balance is not None
    return Row(
        *head,
        not fell,
        round(result.balance.slowdown, 2),
        round(result.balance.stride, 2),
        round(100 * report.figures["foot_slip_m"], 1),
        round(1000 * report.figures["tracked_self_contact_depth_m"], 1),
        float(np.mean(upright)) if upright and not fell else None,
        _further(result, plain),
        result.balance.instead or "; ".join(report.reasons[:2]),
    )


def _further(result: rr.Result, plain: rr.Result) -> str:
    """Arms, trunk and legs, [deg] over those of the solution without balance."""
    parts = ((result.likeness.part(name), plain.likeness.part(name)) for name in ("arms", "trunk", "legs"))
    return " ".join("–" if one is None or other is None else f"{np.degrees(one - other):+.1f}" for one, other in parts)


def table(rows: list[Row]) -> str:
    """Markdown."""
    names = [field.name for field in fields(Row)]
    cells = [["" if value is None else _cell(value) for value in astuple(row)] for row in rows]
    lines = [names, ["---"] * len(names), *cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(value: object) -> str:
    return {True: "yes", False: "**no**"}[value] if isinstance(value, bool) else str(value)


def main() -> None:
    """Measure and print a Markdown table; `--json` keeps every row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="+", default=["op3"])
    parser.add_argument("--clips", nargs="+", type=Path, default=sorted(SAMPLES.glob("*.bvh")))
    parser.add_argument("--legs", nargs="+", default=["auto", "stand"], choices=["auto", "follow", "stand"])
    parser.add_argument("--draws", type=int, default=0)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    for name in given.robots:
        robot = rr.load_robot(name)
        for clip in given.clips:
            for legs in given.legs:
                rows.append(judged(clip, robot, legs, given.draws))
                print(table(rows[-1:]).splitlines()[-1], flush=True)
    print("\n" + table(rows))
    if given.json is not None:
        given.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))


if __name__ == "__main__":
    main()
