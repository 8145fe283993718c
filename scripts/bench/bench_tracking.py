"""Tracking errors of servos with plain goals, and with goals compensated for lag and load.

    python scripts/bench/bench_tracking.py                                  # the shipped clips on op3, pinned and free
    python scripts/bench/bench_tracking.py --clips dab.bvh jacks.bvh --mode pinned
    python scripts/bench/bench_tracking.py --clips samples/wave.bvh --emulated    # on the emulated bus too, in real time

Prints a table: rms error of all joints in plain playback and compensated [rad], their ratio, the worst joint. With
`--emulated` the same goals go over the emulated bus to servos with their own motors and MuJoCo twin.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import robot_retarget as rr
from robot_retarget.actuators.map import load_map
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.figures import at_frames
from robot_retarget.judge.plant import Mode
from robot_retarget.judge.playback import plain_goals, roll_out
from robot_retarget.judge.rollout import plant_of
from robot_retarget.robot.timing import sample_hinges
from robot_retarget.servo.play import play_emulated
from robot_retarget.trajectory import Trajectory


def rms(error: Floats) -> float:
    return float(np.sqrt((error**2).mean()))


def simulated(robot: rr.Robot, trajectory: Trajectory, mode: Mode) -> tuple[float, float, str]:
    """Plain and compensated rms [rad], and the joint that is worst when compensated."""
    plant = plant_of(robot, mode)
    goals = None, compensated(plant, trajectory, mode)
    errors = [at_frames(trajectory, robot, roll_out(plant, trajectory, mode, command=told)).error for told in goals]
    worst = np.sqrt((errors[1] ** 2).mean(0))
    return rms(errors[0]), rms(errors[1]), f"{robot.joint_names[worst.argmax()]} {worst.max():.3f}"


def emulated(robot: rr.Robot, trajectory: Trajectory) -> list[tuple[float, float]]:
    """Plain and compensated: rms to the motion on the emulated bus, and from there to the simulation [rad]."""
    plant, found = plant_of(robot, "free"), []
    for goals in (plain_goals(plant, trajectory), compensated(plant, trajectory, "free")):
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "play.npz"
            play_emulated(replace(trajectory, goals=goals), load_map(robot.name), log=log)
            with np.load(log) as kept:
                playing = kept["phase"] == kept["phases"].tolist().index("play")
                order = [kept["joint_names"].tolist().index(joint) for joint in robot.joint_names]
                times, present = kept["time"][playing], kept["present"][playing][:, order]
        times = times - times[0] - goals.lead_in
        rollout = roll_out(plant, trajectory, "free", command=goals)
        ours = np.stack([np.interp(times, rollout.times, column) for column in rollout.hinges.T], axis=1)
        found.append((rms(present - sample_hinges(trajectory, robot, times)), rms(present - ours)))
    return found


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--clips", nargs="*", type=Path, default=sorted(SAMPLES.glob("*.bvh")))
    ap.add_argument("--robot", default="op3")
    ap.add_argument("--mode", choices=("pinned", "free"), nargs="*", default=["pinned", "free"])
    ap.add_argument("--emulated", action="store_true", help="play on the emulated bus too; takes as long as the clips")
    arg = ap.parse_args()
    robot = rr.load_robot(arg.robot)
    print("| clip | mode | plain rad | compensated rad | ratio | worst joint rad |\n|---|---|---|---|---|---|")
    for clip in arg.clips:
        trajectory = rr.retarget(rr.read_motion(clip), robot, balance="off").trajectory
        for mode in arg.mode:
            before, after, worst = simulated(robot, trajectory, mode)
            print(f"| {clip.stem} | {mode} | {before:.4f} | {after:.4f} | {after / before:.2f} | {worst} |", flush=True)
        if arg.emulated:
            (before, off), (after, further) = emulated(robot, trajectory)
            said = f"from the simulation: {off:.4f}, {further:.4f}"
            print(
                f"| {clip.stem} | emulated bus | {before:.4f} | {after:.4f} | {after / before:.2f} | {said} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
