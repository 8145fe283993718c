"""Which clips stay upright: `python scripts/bench/bench_upright.py --robots op3 … --clips FILE … --legs auto stand`.

Every clip is brought into balance, simulated free with three seconds of settling before and after, and judged like `run` judges it, against
the human too. `--draws 20` adds as many drawn simulations of what stays upright (`judge/worlds.py`).
Clips are classified by the human's feet. Set OMP_NUM_THREADS=1 to keep to one core.
"""

import argparse
import json
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path

import robot_retarget as rr
from robot_retarget.base.choices import Legs
from robot_retarget.base.errors import BalanceError, MatchError
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import MOST_FPS
from robot_retarget.human.features import features_of
from robot_retarget.judge.playback import Playback

SETTLE = Playback(settle_before=3.0, settle_after=3.0)


@dataclass(frozen=True)
class Row:
    """One clip on one robot."""

    robot: str
    clip: str
    kind: str
    legs: str
    verdict: str
    mode: str = ""
    slowdown: float | None = None
    stride: float | None = None
    slip_cm: float | None = None
    hits_mm: float | None = None
    """Deepest overlap of the robot with itself on its servos."""
    upright: float | None = None
    """Share of the drawn simulations in which it stays upright."""
    reasons: str = ""
    """Reasons against it, differences from the human, and why both feet stay in place."""


def judged(clip: Path, robot: rr.Robot, legs: Legs, count: int, feedback: bool | None = None) -> Row:
    """Balance, play and judge a clip, in `count` drawn simulations too; `feedback` as in `simulate`."""
    motion = rr.read_motion(clip)
    motion = motion.resample(min(motion.fps, MOST_FPS))
    head = robot.name, clip.stem, features_of(motion, rr.match(motion, robot)).activity.kind, legs
    try:
        result = rr.solve(rr.describe(motion, robot), legs=legs, balance="auto" if robot.servo_map else "static")
    except (BalanceError, MatchError) as error:
        return Row(*head, "refused", reasons=str(error).split(":")[0])
    assert result.balance is not None
    report = rr.simulate(result.trajectory, robot, mode="free", playback=SETTLE, draws=count, feedback=feedback)
    figures, why = report.figures, (result.balance.instead,) if result.balance.instead else ()
    return Row(
        *head,
        report.badge.text,
        result.balance.mode,
        round(result.balance.slowdown, 2),
        round(result.balance.stride, 2),
        round(100 * (figures["foot_slip_m"] or 0.0), 1),
        round(1000 * figures["tracked_self_contact_depth_m"], 1),
        1 - figures["fallen_share"] if "fallen_share" in figures else None,
        "; ".join((*report.reasons, *report.unlike, *why)),
    )


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
    parser.add_argument("--no-feedback", action="store_true", help="judge open-loop playback")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    for name in given.robots:
        robot = rr.load_robot(name)
        for clip in given.clips:
            for legs in given.legs:
                rows.append(judged(clip, robot, legs, given.draws, False if given.no_feedback else None))
                print(table(rows[-1:]).splitlines()[-1], flush=True)
    print("\n" + table(rows))
    if given.json is not None:
        given.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))


if __name__ == "__main__":
    main()
