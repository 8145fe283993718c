#!/usr/bin/env python3
"""Run frozen tracking policies on references, and print their falls and the motion as executed.

    python scripts/bench/track.py --policies twist2_1017_20k.onnx twist2_1017_25k.onnx --robot unitree_g1.xml --repos CLONES
    python scripts/bench/track.py … --presets balanced directions --others gmr=FOLDER --correlate

Policies are any that `simulate --policy` reads; those of the results are `assets/ckpts/twist2_1017_{20k,25k}.onnx` of amazon-far/TWIST2 at
d5c7108e. Clips are those of `track_clips.csv`, with repository, commit, path and frames; CLONES holds `owner+name` of each repository. Every
clip is retargeted here with each preset; `--others` adds files of other retargeters, `FOLDER/CLIP.npz` or another known format. Each
reference is followed in the nominal world and in `--draws` drawn ones (`judge.rollout.followed`). Needs onnxruntime.
"""

import argparse
import csv
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

import robot_retarget as rr
from robot_retarget.edit.stands import between_stands
from robot_retarget.judge.policy_files import read_policy
from robot_retarget.judge.rollout import Followed, followed

CLIPS = Path(__file__).with_name("track_clips.csv")
PHYSICAL = (
    "physics_score", "root_residual", "root_residual_p95", "zmp_out_pct", "zmp_margin_cm", "torque_over_pct", "torque_p99", "speed_p99",
    "jerk_rms", "root_jerk", "flight_pct", "skate_cm_s", "self_pen_pct", "near_limit_pct", "travel_m",
)  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A reference under a policy."""

    maker: str
    found: Followed
    limbs: float
    """Between the limbs as executed in the nominal world and the human's, until a fall [deg]."""
    reference: dict[str, Any]
    """Figures of the reference."""


def main() -> None:
    """Print a line per run, and a table per maker."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policies", nargs="+", type=Path, required=True)
    parser.add_argument("--robot", required=True)
    parser.add_argument("--repos", type=Path, required=True)
    parser.add_argument("--only", nargs="*", help="names of clips")
    parser.add_argument("--presets", nargs="*", default=["balanced"])
    parser.add_argument("--others", nargs="*", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--draws", type=int, default=1)
    parser.add_argument("--stand", type=float, default=1.0, help="ways from and into the robot's stand [s]")
    parser.add_argument("--correlate", action="store_true")
    given = parser.parse_args()
    robot, policies = rr.load_robot(given.robot), [read_policy(path) for path in given.policies]
    runs: list[Run] = []
    for maker, name, trajectory, motion in references(given, robot):
        figures = dict(rr.score(trajectory, robot, motion).figures)
        whole = between_stands(trajectory, robot, given.stand)
        for policy in policies:
            found = followed(whole, robot, policy, given.draws, name)
            limbs = limbs_of(found.executed, trajectory, robot, motion)
            runs.append(Run(maker, found, limbs, figures))
            fell = ", ".join("up" if fall is None else f"{fall:.1f} s" for fall in found.falls)
            print(
                f"{maker:10} {name:18} {policy.name:22} {fell:24} limbs {limbs:5.1f} deg, joints {found.error:.3f} rad",
                flush=True,
            )
    print(
        "\n| references | falls of runs | limbs as executed | joints | root jerk | ZMP outside |\n|---|---|---|---|---|---|"
    )
    for maker in dict.fromkeys(run.maker for run in runs):
        print(row(maker, [run for run in runs if run.maker == maker]))
    if given.correlate:
        print(correlations(runs))


def references(given: Any, robot: rr.Robot) -> Iterator[tuple[str, str, rr.Trajectory, rr.Motion]]:
    """Yield maker, name, trajectory and human motion of every reference."""
    others = [other.split("=", 1) for other in given.others]
    for name, motion in clips(given.repos, given.only):
        for preset in given.presets:
            yield preset, name, rr.retarget(motion, robot, balance="off", preset=preset).trajectory, motion
        for maker, folder in others:
            for file in sorted(Path(folder).glob(f"{name}.*"))[:1]:
                yield maker, name, in_step(rr.load_trajectory(file, robot), motion), motion


def in_step(trajectory: rr.Trajectory, motion: rr.Motion) -> rr.Trajectory:
    """Return the trajectory of another retargeter, which begins at 0 s, at the times of the part of the clip that it was made from."""
    return trajectory.altered(source_time=motion.source_time[0] + np.arange(len(trajectory)) / trajectory.fps)


def clips(repos: Path, only: list[str] | None) -> Iterator[tuple[str, rr.Motion]]:
    """Yield the clips of the table, cut to their frames."""
    for line in csv.DictReader(CLIPS.open(encoding="utf-8")):
        if only and line["clip"] not in only:
            continue
        clone = repos / line["repo"].replace("/", "+")
        clone = clone / "repo" if (clone / "repo").is_dir() else clone
        clone = clone / ".git" if (clone / ".git").is_dir() else clone
        show = ["git", "--git-dir", str(clone), "show", f"{line['commit']}:{line['path']}"]
        with tempfile.NamedTemporaryFile(suffix=".bvh") as file:
            file.write(subprocess.run(show, check=True, capture_output=True).stdout)
            file.flush()
            motion = rr.read_motion(file.name)
        yield line["clip"], motion.frames(int(line["first"]), min(int(line["last"]), len(motion)))


def limbs_of(executed: rr.Trajectory, reference: rr.Trajectory, robot: rr.Robot, motion: rr.Motion) -> float:
    """Return the mean angle between the limbs as executed and the human's, without the ways from and into the stand [deg]."""
    first, last = reference.source_time[[0, -1]]
    inside = np.flatnonzero((executed.source_time > first) & (executed.source_time < last))
    if inside.size < 2:
        return np.nan
    cut = executed.altered(qpos=executed.qpos[inside], source_time=executed.source_time[inside])
    return float(rr.score(cut, robot, motion).figures["limb_deg_mean"] or np.nan)


def row(maker: str, runs: list[Run]) -> str:
    """Return a line of the table."""
    falls, worlds = sum(run.found.fallen for run in runs), sum(len(run.found.falls) for run in runs)
    jerk, outside = (np.mean([run.reference[name] for run in runs]) for name in ("root_jerk", "zmp_out_pct"))
    limbs, joints = np.nanmean([run.limbs for run in runs]), np.mean([run.found.error for run in runs])
    return f"| {maker} | {falls} of {worlds} | {limbs:.2f}° | {joints:.3f} rad | {jerk:.0f} m/s³ | {outside:.1f} % |"


def correlations(runs: list[Run]) -> str:
    """Spearman's ρ of each physical figure with the joint error, and with the falls, over all runs."""
    errors, falls = [run.found.error for run in runs], [float(run.found.fallen) for run in runs]
    lines = [f"rank correlation over {len(runs)} runs (ρ with joint error, p; ρ with falls, p)"]
    for name in PHYSICAL:
        values = [np.nan if run.reference[name] is None else run.reference[name] for run in runs]
        if len(set(values)) < 2 or np.isnan(values).any():
            lines.append(f"{name:20} the same, or missing, in some references")
            continue
        with_error: Any = spearmanr(values, errors)
        with_fall: Any = spearmanr(values, falls) if len(set(falls)) > 1 else None
        fell = "-" if with_fall is None else f"{with_fall.statistic:+.2f}  {with_fall.pvalue:.3f}"
        lines.append(f"{name:20} {with_error.statistic:+.2f}  {with_error.pvalue:.3f}   {fell}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
