#!/usr/bin/env python3
"""Run a frozen tracking policy on references in MuJoCo, and print how well it executes them.

    python scripts/bench/track.py --policy policy.onnx --model g1_29dof.xml --motion dance.bvh ours.npz theirs.pkl
    python scripts/bench/track.py --policy policy.onnx --model g1_29dof.xml --robot unitree_g1.xml --windows clips/ --correlate

The policy is a file of the user in the layout of TWIST2's public G1 tracker: 1432 observations, 29 actions, 50 Hz, position control at 1 kHz.
References are files of robot motion in any known format, or windows of motions that are retargeted here. With `--correlate`, the rank
correlation of every physical figure of the references with the joint error of the execution is printed. Needs onnxruntime.
"""

import argparse
import json
import sys
from collections import deque
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import spearmanr

import robot_retarget as rr
from robot_retarget.robot.timing import resample

RATE, STEPS = 50.0, 20
"""Actions per second [1/s], and physics steps of 1 ms per action."""
LEG, ARM = (-0.2, 0.0, 0.0, 0.4, -0.2, 0.0), (0.0, 0.4, 0.0, 1.2, 0.0, 0.0, 0.0)
DEFAULT = np.array([*LEG, *LEG, 0, 0, 0, *ARM, *(np.array(ARM) * [1, -1, 1, 1, 1, 1, 1])])
"""The pose of action 0 [rad]."""
STIFFNESS = np.array([*(100, 100, 100, 150, 40, 40) * 2, *(150,) * 3, *(40, 40, 40, 40, 4, 4, 4) * 2], dtype=float)
"""[N m/rad]; the torque limits [N m] are the same numbers."""
DAMPING = np.array([*(2, 2, 2, 4, 2, 2) * 2, *(4,) * 3, *(5, 5, 5, 5, 0.2, 0.2, 0.2) * 2], dtype=float)
"""[N m s/rad]."""
ANKLES = [4, 5, 10, 11]
HISTORY, CLIP, SCALE = 10, 10.0, 0.5
FALLEN = 0.5
"""A pelvis below this share of the reference's height is a fall."""
PHYSICAL = (
    "physics_score", "root_residual", "root_residual_p95", "zmp_out_pct", "zmp_margin_cm", "torque_over_pct", "torque_p99", "speed_p99",
    "jerk_rms", "root_jerk", "flight_pct", "skate_cm_s", "self_pen_pct", "near_limit_pct", "travel_m",
)  # fmt: skip


@dataclass(frozen=True)
class Executed:
    """How a reference was executed."""

    name: str
    fall: float | None
    """Time of the fall [s]."""
    joint_error: float
    """Root mean square of the hinges [rad]."""
    torque: float
    """Root mean square [N m]."""
    limb_error: float | None
    """Of the executed motion to the human's, until a fall [deg]."""
    reference: dict[str, Any]
    """Figures of the reference."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("references", nargs="*", type=Path, help="files of robot motion")
    parser.add_argument("--policy", required=True, type=Path, help="ONNX file")
    parser.add_argument("--model", required=True, type=Path, help="MJCF of the policy's robot, with motors and a floor")
    parser.add_argument("--robot", help="robot to retarget windows to; the model by default")
    parser.add_argument("--format", help="format of the references")
    parser.add_argument("--motion", type=Path, help="human motion of the references")
    parser.add_argument("--windows", type=Path, help="folder of motions to cut into windows")
    parser.add_argument("--seconds", type=float, default=5.0, help="of a window")
    parser.add_argument("--most", type=int, default=40, help="windows")
    parser.add_argument(
        "--results", type=Path, help="JSON lines to append results to; references that are there are not run again"
    )
    parser.add_argument("--correlate", action="store_true")
    given = parser.parse_args()
    tracker, results = Tracker(given.policy, given.model), known(given.results)
    for name, trajectory, motion in pieces(given, {one.name for one in results}):
        results.append(tracker.run(name, trajectory, motion))
        print(line(results[-1]), flush=True)
        if given.results:
            with given.results.open("a") as file:
                file.write(json.dumps(asdict(results[-1])) + "\n")
    if results:
        print(summary(results))
    if given.correlate:
        print(correlations(results))
    return 0


def known(path: Path | None) -> list[Executed]:
    """The results of earlier runs."""
    if path is None or not path.is_file():
        return []
    return [Executed(**json.loads(line)) for line in path.read_text().splitlines()]


def pieces(given: Any, done: set[str]) -> Iterator[tuple[str, rr.Trajectory, rr.Motion | None]]:
    """The references, with the human motion they come from."""
    robot = rr.load_robot(given.robot or str(given.model))
    motion = rr.read_motion(given.motion) if given.motion else None
    for path in given.references:
        yield path.name, rr.load_trajectory(path, robot, given.format), motion
    for name, window in windows(given.windows, given.seconds, given.most) if given.windows else ():
        if name in done:
            continue
        try:
            yield name, rr.retarget(window, robot, balance="off").trajectory, window
        except rr.RobotRetargetError as error:
            print(f"{name:44} left out: {error}")


def windows(folder: Path, seconds: float, most: int) -> Iterator[tuple[str, rr.Motion]]:
    """Windows of the motions below a folder, in turn, with half a window between their starts."""
    motions = []
    for path in sorted(folder.rglob("*.bvh")):
        try:
            motion = rr.read_motion(path)
            rr.match(motion, rr.load_robot("op3"))
        except rr.RobotRetargetError:
            continue
        motions.append((path.stem, motion))
    found = 0
    for turn in range(100):
        for name, motion in motions:
            first = round(turn * seconds / 2 * motion.fps)
            last = first + round(seconds * motion.fps)
            if last <= len(motion) and found < most:
                found += 1
                yield f"{name}@{first / motion.fps:.1f}", motion.frames(first, last)


class Tracker:
    """A policy and its robot."""

    def __init__(self, policy: Path, model: Path):
        import onnxruntime  # pyright: ignore[reportMissingImports]

        self.robot = rr.load_robot(str(model))
        self.model = mujoco.MjModel.from_xml_path(str(model))
        self.model.opt.timestep = 1 / (RATE * STEPS)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self.session: Any = onnxruntime.InferenceSession(str(policy), options, providers=["CPUExecutionProvider"])
        self.input = self.session.get_inputs()[0].name

    def run(self, name: str, trajectory: rr.Trajectory, motion: rr.Motion | None) -> Executed:
        """Execute one reference from its first pose, until its end or a fall."""
        played = resample(trajectory, self.robot, RATE)
        wanted, data = mimic_rows(self.robot, played.qpos), mujoco.MjData(self.model)
        data.qpos[:] = played.qpos[0]
        mujoco.mj_differentiatePos(self.model, data.qvel, 1 / RATE, played.qpos[0], played.qpos[1])
        history = deque([np.zeros(127)] * HISTORY, HISTORY)
        action, states, torques, fall = np.zeros(29), [], [], None
        for k in range(len(played)):
            full = np.concatenate([wanted[k], proprioception(data, action)])
            seen = np.concatenate([full, *history, wanted[k]])
            history.append(full)
            action = self.session.run(None, {self.input: seen[None].astype(np.float32)})[0][0].astype(float)
            goal = np.clip(action, -CLIP, CLIP) * SCALE + DEFAULT
            for _ in range(STEPS):
                torque = STIFFNESS * (goal - data.qpos[7:]) - DAMPING * data.qvel[6:]
                data.ctrl[:] = np.clip(torque, -STIFFNESS, STIFFNESS)
                mujoco.mj_step(self.model, data)
            states.append(data.qpos.copy())
            torques.append(data.ctrl.copy())
            if data.qpos[2] < FALLEN * played.qpos[k, 2]:
                fall = k / RATE
                break
        return self._judged(name, played, np.array(states), np.array(torques), fall, motion, trajectory)

    def _judged(
        self,
        name: str,
        played: rr.Trajectory,
        states: Any,
        torques: Any,
        fall: float | None,
        motion: rr.Motion | None,
        trajectory: rr.Trajectory,
    ) -> Executed:
        count = len(states)
        error = np.sqrt(((states[:, 7:] - played.qpos[:count, 7:]) ** 2).mean())
        executed = rr.Trajectory(
            states, RATE, self.robot.joint_names, self.robot.name, name, source_time=played.source_time[:count]
        )
        limbs = rr.score(executed, self.robot, motion).figures["limb_deg_mean"] if motion is not None else None
        figures = dict(rr.score(trajectory, self.robot, motion).figures)
        effort = float(np.sqrt((torques**2).mean()))
        return Executed(name, fall, float(error), effort, None if limbs is None else float(limbs), figures)


def mimic_rows(robot: rr.Robot, qpos: Any) -> Any:
    """(T, 35) root velocity x, y in its frame, height, roll, pitch, yaw rate, hinges."""
    steps = np.zeros((len(qpos), robot.model.nv))
    for k in range(len(qpos) - 1):
        mujoco.mj_differentiatePos(robot.model, steps[k], 1 / RATE, qpos[k], qpos[k + 1])
    steps[-1] = steps[-2]
    turns = Rotation.from_quat(qpos[:, 3:7], scalar_first=True)
    velocity = turns.inv().apply(steps[:, :3])
    return np.column_stack([velocity[:, :2], qpos[:, 2], roll_pitch(turns), steps[:, 5], qpos[:, 7:]])


def proprioception(data: Any, action: Any) -> Any:
    """(92,) angular velocity, roll, pitch, hinges, their speeds, and the last action."""
    speeds = data.qvel[6:].copy()
    speeds[ANKLES] = 0
    lean = roll_pitch(Rotation.from_quat(data.qpos[3:7], scalar_first=True))
    return np.concatenate([data.qvel[3:6] * 0.25, np.ravel(lean), data.qpos[7:] - DEFAULT, speeds * 0.05, action])


def roll_pitch(turns: Rotation) -> Any:
    """(…, 2) [rad]."""
    return turns.as_euler("ZYX")[..., [2, 1]]


def line(one: Executed) -> str:
    fell = "up" if one.fall is None else f"fell at {one.fall:.1f} s"
    limbs = "-" if one.limb_error is None else f"{one.limb_error:.1f} deg"
    return f"{one.name:44} {fell:16} limbs {limbs:9} joints {one.joint_error:.3f} rad, torque {one.torque:.1f} N m"


def summary(results: list[Executed]) -> str:
    up = [one for one in results if one.fall is None]
    if not up:
        return f"none of {len(results)} up"
    limbs = [one.limb_error for one in up if one.limb_error is not None]
    means = f"limbs {np.mean(limbs):.1f} deg, " if limbs else ""
    joints, torque = np.mean([one.joint_error for one in up]), np.mean([one.torque for one in up])
    return f"{len(up)} of {len(results)} up; of those {means}joints {joints:.3f} rad, torque {torque:.1f} N m"


def correlations(results: list[Executed]) -> str:
    """Spearman's ρ of each physical figure with the joint error, and with falling, over all references."""
    errors, falls = [one.joint_error for one in results], [float(one.fall is not None) for one in results]
    lines = [f"rank correlation over {len(results)} references (ρ with joint error, p; ρ with a fall, p)"]
    for name in PHYSICAL:
        values = [np.nan if one.reference[name] is None else one.reference[name] for one in results]
        if len(set(values)) < 2 or np.isnan(values).any():
            lines.append(f"{name:20} the same, or missing, in some references")
            continue
        with_error: Any = spearmanr(values, errors)
        with_fall: Any = spearmanr(values, falls) if len(set(falls)) > 1 else None
        fell = "-" if with_fall is None else f"{with_fall.statistic:+.2f}  {with_fall.pvalue:.3f}"
        lines.append(f"{name:20} {with_error.statistic:+.2f}  {with_error.pvalue:.3f}   {fell}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
