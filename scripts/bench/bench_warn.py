"""Measure the warnings: `python scripts/bench/bench_warn.py --robot NAME … --clips FILES` prints tables.

Truth is what MuJoCo says: frames in which geoms of two links overlap, or overlapped since the previous frame, less the
pairs that do so where the robot rests. The trajectories collide: clips retargeted without separation, and smooth random
motions of all joints, some of them four times as fast. Set
OMP_NUM_THREADS=1 to keep everything on one core.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.collision import Warner, WarnOptions, warnings_of
from robot_retarget.robot.distances import LinkDistances
from robot_retarget.trajectory import Trajectory

NEAR_MISS = 0.01
"""A warning is right when the geoms come this near [m]."""
FAR = 0.08
"""Distances are told apart up to here [m]."""
GAP = 0.15
"""Contacts of a pair that part for less than this are one [s]."""
THRESHOLDS = np.arange(0.002, 0.04, 0.001)
"""Of the alarm by distance [m]."""
REPEATS = 7
"""Runs that are timed."""
PARTS = ("accuracy", "horizons", "speed")
HORIZONS = (1 / 30, 2 / 30, 0.1, 0.2, 0.3)
"""[s]."""
BETWEEN = 8
"""Number of configurations checked from one frame to the next."""
HASTE = 4.0
"""Speed of the fast random motions, relative to the others."""
AFTER = 0.5
"""An alarm is right when a contact comes within this time of its end [s]."""


@dataclass(frozen=True, eq=False)
class Case:
    """A trajectory and the distances (T, P) of its links' geoms [m]."""

    kind: str
    trajectory: Trajectory
    distance: Floats


@dataclass
class Score:
    """How warnings compare with what happened."""

    contacts: int = 0
    foreseen: int = 0
    alarms: int = 0
    right: int = 0
    leads: list[float] = field(default_factory=list)

    @property
    def recall(self) -> float:
        return self.foreseen / max(self.contacts, 1)

    @property
    def precision(self) -> float:
        return self.right / max(self.alarms, 1)

    @property
    def lead(self) -> float:
        return float(np.median(self.leads)) if self.leads else 0.0


def random_motion(
    robot: rr.Robot, seed: int, haste: float = 1.0, seconds: float = 4.0, fps: float = 30.0
) -> Trajectory:
    """A cubic spline through poses drawn within 60 % of the ranges, one every 0.6 … 1.2 s over the haste."""
    draw = np.random.default_rng(seed)
    pace = draw.uniform(0.6, 1.2) / haste
    knots = np.arange(0, seconds + pace, pace)
    middle = robot.standing()[robot.qpos_index]
    low, high = (middle + np.clip(0.6 * (end - middle), -1.5, 1.5) for end in (robot.lower, robot.upper))
    times = np.arange(round(seconds * fps)) / fps
    qpos = np.tile(robot.standing(), (len(times), 1))
    path = CubicSpline(knots, draw.uniform(low, high, (len(knots), len(low))), bc_type="clamped")(times)
    qpos[:, robot.qpos_index] = np.clip(path, robot.lower, robot.upper)
    return Trajectory(qpos, fps, robot.joint_names, robot.name, f"random {seed}")


def clips_of(robot: rr.Robot, where: Sequence[Path]) -> Iterator[Trajectory]:
    """Clips carried over without separation."""
    paths = [path for place in where for path in (sorted(place.rglob("*.bvh")) if place.is_dir() else [place])]
    for path in paths:
        graph = rr.describe(rr.read_motion(path), robot, fps=30)
        yield rr.solve(graph.without("separation"), balance="off").trajectory


def stretches(what: np.ndarray, gap: int) -> list[tuple[int, int]]:
    """First and last frame of every stretch, those less than `gap` frames apart joined."""
    frames = np.flatnonzero(what)
    cuts = np.flatnonzero(np.diff(frames) > gap) + 1
    return [(int(part[0]), int(part[-1])) for part in np.split(frames, cuts) if part.size]


def judge(cases: Sequence[Case], alarms: Sequence[np.ndarray], horizon: float) -> Score:
    """Alarms (T, P) against contacts.

    A contact is foreseen when an alarm of its pair began before it and lasted to it, or to within the horizon of it.
    An alarm is right when its pair touches, or comes within `NEAR_MISS`, before the horizon after it is over. Those
    under way in a trajectory's first frames (no step is known) count for neither.
    """
    score = Score()
    for case, alarm in zip(cases, alarms, strict=True):
        fps, last = case.trajectory.fps, len(case.distance)
        ahead, gap, touch = round(horizon * fps), round(GAP * fps), case.distance <= 0
        for pair in np.flatnonzero(alarm.any(0) | touch.any(0)):
            flags = stretches(alarm[:, pair], 1)
            for first, end in flags:
                if not touch[first, pair]:
                    score.alarms += 1
                    score.right += bool((case.distance[first : min(end + ahead + 1, last), pair] <= NEAR_MISS).any())
            for start, _ in stretches(touch[:, pair], gap):
                if start >= 3:
                    before = [first for first, end in flags if first < start and end >= start - ahead]
                    score.contacts += 1
                    score.foreseen += bool(before)
                    score.leads.append((start - before[-1]) / fps if before else 0.0)
    return score


def by_distance(cases: Sequence[Case], horizon: float) -> list[Score]:
    """The alarm by distance alone, held as long as the warnings are, at each of the thresholds."""
    hold, scores = WarnOptions().release, []
    for threshold in THRESHOLDS:
        alarms = []
        for case in cases:
            size = round(hold * case.trajectory.fps) + 1
            near = (case.distance <= threshold).astype(np.int8)
            alarms.append(maximum_filter1d(near, size, axis=0, mode="constant", origin=(size - 1) // 2) > 0)
        scores.append(judge(cases, alarms, horizon))
    return scores


def measured(robot: rr.Robot, kind: str, trajectories: Sequence[Trajectory]) -> list[Case]:
    """Trajectories with what MuJoCo says of them."""
    links = LinkDistances(robot, FAR)
    return [Case(kind, one, least_since(links, one.qpos)) for one in trajectories]


def least_since(links: LinkDistances, qpos: Floats) -> Floats:
    """The least distances (T, P) from the previous frame, not included, to each frame [m]."""
    shares = np.arange(1 - BETWEEN, 1)[:, None] / BETWEEN
    before = np.concatenate([qpos[:1], qpos[:-1]])
    ways = (now + shares * (now - last) for last, now in zip(before, qpos, strict=True))
    return np.array([links.along(way).min(axis=0) for way in ways])


@dataclass(frozen=True)
class Accuracy:
    """Scores of the warnings of some trajectories, and of alarms by distance at every threshold."""

    warned: Score
    plain: list[Score]

    def line(self, *names: str) -> str:
        """Beside the alarm by distance with the largest threshold that is as precise."""
        score = self.warned
        fits = [k for k, plain in enumerate(self.plain) if plain.precision >= score.precision]
        threshold, plain = (THRESHOLDS[fits[-1]], self.plain[fits[-1]]) if fits else (0.0, Score())
        cells = (
            *names, score.contacts, f"{score.recall:.3f}", f"{score.precision:.3f}", f"{score.lead:.3f}",
            f"{threshold * 100:.1f}", f"{plain.recall:.3f}", f"{plain.lead:.3f}",
        )  # fmt: skip
        return f"| {' | '.join(map(str, cells))} |"


def accuracy(robot: rr.Robot, links: LinkDistances, groups: dict[str, list[Case]]) -> list[Accuracy]:
    """A line per kind of trajectory and one for all of them."""
    options, results = WarnOptions(), []
    for kind, cases in groups.items():
        found = [warnings_of(case.trajectory, robot, options, links, planned=False) for case in cases]
        warned = judge(cases, [one.flagged for one in found], AFTER)
        results.append(Accuracy(warned, by_distance(cases, AFTER)))
        print(results[-1].line(robot.name, kind), flush=True)
    print(together(results).line(robot.name, "all"), flush=True)
    return results


def together(results: Sequence[Accuracy]) -> Accuracy:
    """All of them as one."""
    ladders = zip(*(one.plain for one in results), strict=True)
    warned, plain = pooled([one.warned for one in results]), [pooled(scores) for scores in ladders]
    return Accuracy(warned, plain)


def pooled(scores: Sequence[Score]) -> Score:
    """All of them together."""
    counts = [sum(getattr(one, name) for one in scores) for name in ("contacts", "foreseen", "alarms", "right")]
    return Score(*counts, leads=[lead for one in scores for lead in one.leads])


def over_horizons(robot: rr.Robot, links: LinkDistances, groups: dict[str, list[Case]]) -> None:
    """Two lines per kind, along the last step and along the frames: recall, precision and lead at every horizon."""
    for (kind, cases), planned in product(groups.items(), (False, True)):
        cells = []
        for horizon in HORIZONS:
            options = WarnOptions(horizon=horizon)
            alarms = [warnings_of(case.trajectory, robot, options, links, planned=planned).flagged for case in cases]
            score = judge(cases, alarms, AFTER)
            cells.append(f"{score.recall:.2f} / {score.precision:.2f} / {score.lead:.2f}")
        print(f"| {robot.name} | {kind}{', planned' * planned} | {' | '.join(cells)} |", flush=True)


def speed(robot: rr.Robot, links: LinkDistances, trajectory: Trajectory) -> None:
    """Print distances per second, whole warnings per second, and the time of one update of a stream."""
    bare = best_time(lambda: links.along(trajectory.qpos)) / len(trajectory)
    whole = best_time(lambda: warnings_of(trajectory, robot, links=links)) / len(trajectory)
    spent = min((update_times(Warner(robot, trajectory.fps, links=links), trajectory) for _ in range(REPEATS)), key=sum)
    print(
        f"| {robot.name} | {len(links)} | {1 / bare:,.0f} | {1 / whole:,.0f} | {np.median(spent) * 1e3:.2f} "
        f"| {np.percentile(spent, 95) * 1e3:.2f} |",
        flush=True,
    )


def update_times(warner: Warner, trajectory: Trajectory) -> list[float]:
    """Wall time of every update of a stream [s]."""
    times = []
    for qpos in trajectory.qpos:
        began = time.perf_counter()
        warner.update(qpos)
        times.append(time.perf_counter() - began)
    return times


def best_time(run: Callable[[], object]) -> float:
    """The shortest of several wall times [s]."""
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return min(times)


def heading(title: str, *columns: str) -> None:
    print(f"\n{title}\n\n| {' | '.join(columns)} |\n|{'---|' * len(columns)}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", nargs="+", default=["op3"], help="names or MJCF files")
    parser.add_argument("--clips", type=Path, nargs="*", default=[SAMPLES], help="BVH files, or folders of them")
    parser.add_argument("--random", type=int, default=200, help="random motions per robot")
    parser.add_argument("--some", type=int, default=20, help="of these, how many for horizons")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, help="tables to print")
    chosen = parser.parse_args()
    robots = [rr.load_robot(name) for name in chosen.robot]
    watched = [LinkDistances(robot) for robot in robots]
    sets = []
    for robot in robots:
        clips = measured(robot, "clips", list(clips_of(robot, chosen.clips)))
        motions = measured(robot, "random", [random_motion(robot, seed) for seed in range(chosen.random)])
        hasty = measured(robot, "fast", [random_motion(robot, seed, HASTE) for seed in range(chosen.random)])
        sets.append({"clips": clips, "random": motions, "fast": hasty})
    both = list(zip(robots, watched, sets, strict=True))
    few = [(r, k, {kind: c if kind == "clips" else c[: chosen.some] for kind, c in g.items()}) for r, k, g in both]

    if "accuracy" in chosen.parts:
        columns = ("robot", "trajectories", "contacts", "recall", "precision", "lead [s]")
        plain = ("distance as precise [cm]", "its recall", "its lead [s]")
        heading("Warnings", *columns, *plain)
        results = [result for one in both for result in accuracy(*one)]
        print(together(results).line("all", "all"), flush=True)
    if "horizons" in chosen.parts:
        heading("Recall / precision / lead [s]", "robot", "trajectories", *(f"{horizon:.2f} s" for horizon in HORIZONS))
        for one in few:
            over_horizons(*one)
    if "speed" in chosen.parts:
        closed = "distances [frames/s]", "whole warnings [frames/s]"
        heading("Speed", "robot", "pairs", *closed, "update [ms]", "95 % [ms]")
        for robot, links, groups in both:
            speed(robot, links, max((case.trajectory for case in groups["clips"]), key=len))


if __name__ == "__main__":
    main()
