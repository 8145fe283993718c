"""Push a robot that walks and one that stands: falls without and with feedback, prevented and caused, as a table and a picture.

    python scripts/bench/bench_push.py walk.npz strut.npz bn_walk.npz -o push.png          # 10 N for 0.1 s, one soft world each
    python scripts/bench/bench_push.py walk.npz --worlds 5 --impulse 0.5 --gain ank_roll=0.2,0.06

A push acts on the trunk from four sides at four moments, a quarter of a step apart, from a landing in the middle of the motion; `stand` is the first pose
of the first clip, held. A robot that stays up for 3 s survives. `--gain` tries other gains of both sides: tilt and rate [s].
"""

import argparse
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_feedback import SOFT, table
from pushes import DIRECTIONS, standing, survives, worlds_at

import robot_retarget as rr
from robot_retarget.actuators.balance_tables import JointGain
from robot_retarget.actuators.goals import Goals
from robot_retarget.base.arrays import Bools
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.feedback import with_feedback
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.rollout import plant_of
from robot_retarget.judge.worlds import BACKLASH, draws
from robot_retarget.trajectory import Trajectory, load_trajectory

MOMENTS = 4
"""Pushed moments of a step."""
AFTER = 3.0
"""A robot that stays up for so long survives [s]: six steps of the sample walk."""
HELD = 6.0
"""Length of the stand [s]."""
COLOURS = ("#3a7d44", "#4f9dde", "#d9a21b", "#b3392f")
"""Of a push that is survived either way, and of a fall that feedback prevents, causes and leaves."""
MEANINGS = ("stays up", "prevented", "caused", "falls")


def moments(goals: Goals) -> list[int]:
    """Return rows of the goals a quarter of a step apart, from a landing in the middle; of a stand its middle, as often."""
    assert goals.feedback is not None
    down = goals.feedback.air.sum(axis=1) == 0
    landings = np.flatnonzero(down[1:] & ~down[:-1]) + 1
    if len(landings) < 2:
        return [len(goals) // 2] * MOMENTS
    first, second = landings[len(landings) // 2 - 1 :][:2]
    return np.linspace(first, second, MOMENTS, endpoint=False).astype(int).tolist()


def fallen(plant: Plant, motion: Trajectory, goals: Goals, rows: list[int], worlds: int, impulse: float) -> Bools:
    """Return whether the robot falls in each world, at each moment, from each side (worlds, moments, sides)."""
    starts = [start for draw in draws(worlds, spread=SOFT) for start in worlds_at(plant, motion, goals, draw, rows)]
    cases = [(start, impulse * np.array(way), AFTER) for start in starts for way in DIRECTIONS.values()]
    with ThreadPoolExecutor() as pool:
        stays = list(pool.map(lambda case: survives(*case), cases))
    return ~np.array(stays).reshape(worlds, len(rows), len(DIRECTIONS))


def with_gains(robot: rr.Robot, gains: list[str]) -> rr.Robot:
    """Return the robot with other gains, `ank_roll=0.2,0.06` for both sides."""
    assert robot.servo_map is not None and robot.servo_map.balance is not None
    joints = dict(robot.servo_map.balance.joints)
    for name, values in (gain.split("=") for gain in gains):
        tilt, rate = map(float, values.split(","))
        joints |= {f"{side}_{name}": JointGain(rate, tilt) for side in "lr"}
    balance = replace(robot.servo_map.balance, joints=joints)
    return replace(robot, servo_map=replace(robot.servo_map, balance=balance))


def draw_picture(found: dict[str, Bools], path: Path) -> None:
    """Draw every push: a row for each moment of each motion, a column for each side of each world."""
    from matplotlib import pyplot
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    figure, axes = pyplot.subplots(1, len(found), figsize=(3.2 * len(found), 3.4), squeeze=False)
    for axis, (name, cases) in zip(axes[0], found.items(), strict=True):
        worlds, rows, sides = cases.shape
        axis.imshow(
            cases.transpose(1, 2, 0).reshape(rows, sides * worlds), cmap=ListedColormap(COLOURS), vmin=0, vmax=3
        )
        axis.set_xticks([worlds * (k + 0.5) - 0.5 for k in range(sides)], list(DIRECTIONS))
        axis.set_yticks(range(rows), [f"{k}/{rows} step" for k in range(rows)])
        axis.set_title(name)
        axis.set_aspect("auto")
    figure.legend(
        handles=[Patch(color=c, label=m) for c, m in zip(COLOURS, MEANINGS, strict=True)], ncol=4, loc="lower center"
    )
    figure.tight_layout(rect=(0, 0.1, 1, 1))
    figure.savefig(path, dpi=120)


def main() -> None:
    """Print the table, and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="+", type=Path)
    parser.add_argument("--robot", default="op3")
    parser.add_argument("--worlds", type=int, default=1)
    parser.add_argument("--impulse", type=float, default=1.0, help="[N s]")
    parser.add_argument("--gain", action="append", default=[], metavar="JOINT=TILT,RATE")
    parser.add_argument("-o", "--out", type=Path)
    asked = parser.parse_args()
    plant = plant_of(with_gains(rr.load_robot(asked.robot), asked.gain), "free", backlash=BACKLASH)
    motions = {path.stem: load_trajectory(path) for path in asked.clips}
    motions["stand"] = standing(next(iter(motions.values())), HELD)
    row, found, total = (
        table("motion", "pushes", "falls without", "falls with", "prevented", "caused"),
        {},
        np.zeros(5, int),
    )
    for name, motion in motions.items():
        plain = compensated(plant, motion, "free")
        closed = with_feedback(plant, motion, plain)
        without, fed = (
            fallen(plant, motion, goals, moments(closed), asked.worlds, asked.impulse) for goals in (plain, closed)
        )
        found[name] = np.where(fed, np.where(without, 3, 2), np.where(without, 1, 0))
        counts = np.array([fed.size, without.sum(), fed.sum(), (without & ~fed).sum(), (fed & ~without).sum()])
        total += counts
        row(name, *counts)
    row("all", *total)
    if asked.out:
        draw_picture(found, asked.out)


if __name__ == "__main__":
    main()
