"""Fit the gains of a robot's balance feedback on survived pushes: `python scripts/bench/fit_feedback.py CLIP.npz … --robot op3 -o servos.toml`.

Pushes ahead and back fit the pitch joints of the legs, pushes to the sides the roll joints. A set of gains scores the mean over motions and directions of

    min(AIM, (J_min + J_mean) / (J⁰_min + J⁰_mean))          J, J⁰: largest survived impulses with and without feedback, over the drawn worlds

and nothing if the standing robot oscillates. Worlds are those of the verdict, with the delay of a slow loop. `stand` is the first pose of the first
clip, held. The search is differential evolution around the gains of the map. The result is the [balance] table; `-o` writes the whole map.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pushes import DIRECTIONS, standing, survived_impulses, worlds_at_push
from scipy.optimize import differential_evolution

import robot_retarget as rr
from robot_retarget.actuators.balance_tables import Balance, JointGain
from robot_retarget.actuators.map import dump_map
from robot_retarget.base.arrays import Floats
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.feedback import oscillation, with_feedback
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.playback import Playback, roll_out
from robot_retarget.judge.rollout import plant_of
from robot_retarget.judge.worlds import Draw, Spread, draws
from robot_retarget.robot import Robot
from robot_retarget.robot.anatomy import mirror_of
from robot_retarget.robot.support import feet_of
from robot_retarget.trajectory import Trajectory, load_trajectory

AIM = 1.5
"""A larger gain in one direction counts no more: it must not pay for a loss in another [-]."""
DELAY = (0.01, 0.04)
"""Drawn delays of the goals [s]: the loop over a bus, and twice as slow."""
PLANES = {"pitch": (1, ("fore", "aft")), "roll": (0, ("left", "right"))}
"""Axis of the root body about which a plane's joints turn, and its pushes."""
SPREAD_OF_START = np.array([0.04, 0.2])
"""Standard deviation of the first gains around those of the map: rate [s], tilt [-]."""
REACH = np.array([0.3, 1.0])
"""Largest gains: rate [s], tilt [-]."""
Pair = tuple[str, ...]
"""A joint and its counterpart on the other side."""


@dataclass(frozen=True)
class Task:
    """What gains are scored on."""

    robot: Robot
    motions: tuple[Trajectory, ...]
    """The first stands."""
    worlds: tuple[Draw, ...]

    def impulses(self, robot: Robot, ways: Sequence[str], feedback: bool) -> Floats:
        """J_min + J_mean (motions, directions) [N s]."""
        plant, rows = plant_of(robot, "free"), []
        for motion in self.motions:
            starts = worlds_at_push(plant, motion, self.worlds, feedback)
            found = [survived_impulses(starts, np.array(DIRECTIONS[way])) for way in ways]
            rows.append([x.min() + x.mean() for x in found])
        return np.array(rows)

    def oscillates(self, plant: Plant) -> bool:
        """Whether additions swing on the standing robot at the largest delay."""
        stand = self.motions[0]
        goals = with_feedback(plant, stand, compensated(plant, stand, "free"))
        rollout = roll_out(plant, stand, "free", Playback(delay=DELAY[1]), goals)
        assert rollout.added is not None
        return oscillation(rollout.added, self.robot.joint_names, goals.rate) is not None


def leg_pairs(robot: Robot, axis: int) -> list[Pair]:
    """The hinges between the root body and the feet that turn about an axis of the root body, with their counterparts."""
    model, bodies = robot.model, set[int]()
    for foot in feet_of(robot).all_bodies:
        while foot != robot.root_body:
            bodies.add(foot)
            foot = int(model.body_parentid[foot])
    data = mujoco.MjData(model)
    data.qpos[:] = robot.standing()
    mujoco.mj_kinematics(model, data)
    turns = data.xmat[robot.root_body].reshape(3, 3)
    main = np.abs(data.xaxis[robot.joint_ids] @ turns).argmax(axis=1)
    partner = mirror_of(robot, turns[:, 1]).partner
    names, places = robot.joint_names, model.jnt_bodyid[robot.joint_ids]
    chosen = [k for k in range(len(names)) if places[k] in bodies and main[k] == axis and partner[k] > k]
    return [(names[k], names[partner[k]]) for k in chosen]


def with_gains(robot: Robot, pairs: Sequence[Pair], gains: Floats) -> Robot:
    """The robot with gains (2 · pairs,): rate and tilt of each pair."""
    servo_map = robot.servo_map
    assert servo_map is not None
    balance = servo_map.balance or Balance()
    rows = [JointGain(round(float(rate), 3), round(float(tilt), 2)) for rate, tilt in gains.reshape(-1, 2)]
    joints = {joint: gain for pair, gain in zip(pairs, rows, strict=True) for joint in pair}
    new = replace(balance, joints={**balance.joints, **joints})
    return replace(robot, servo_map=replace(servo_map, balance=new))


def fitted(task: Task, plane: str, rounds: int, population: int) -> Robot:
    """The robot with the best gains of the joints of one plane."""
    axis, ways = PLANES[plane]
    robot, pairs = task.robot, leg_pairs(task.robot, axis)
    balance = robot.servo_map.balance if robot.servo_map else None
    known = [(balance.joints.get(one) if balance else None) or JointGain() for one, _ in pairs]
    start = np.array([(gain.rate, gain.tilt) for gain in known]).ravel()
    without = task.impulses(robot, ways, feedback=False)

    def cost(gains: Floats) -> float:
        tried = with_gains(robot, pairs, gains)
        if task.oscillates(plant_of(tried, "free")):
            return 0.0
        score = float(np.minimum(task.impulses(tried, ways, feedback=True) / without, AIM).mean())
        print(f"{plane} {score:.3f} {np.round(gains, 3).tolist()}", flush=True)
        return -score

    reach, spread = (np.tile(x, len(pairs)) for x in (REACH, SPREAD_OF_START))
    first = start + spread * np.random.default_rng(0).standard_normal((population, len(start)))
    first[0], first[1] = start, 0.0
    bounds = list(zip(-reach, reach, strict=True))
    seeded: dict[str, Any] = {"init": np.clip(first, -reach, reach), "seed": 0}  # SciPy 1.14 knows no `rng`
    found = differential_evolution(cost, bounds, maxiter=rounds, polish=False, **seeded)
    return with_gains(robot, pairs, found.x)


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("clips", nargs="+", type=Path, help="trajectories of the robot, from `run`")
    ap.add_argument("--robot", default="op3", help="shipped robot, or an MJCF with a servos.toml that has [imu]")
    ap.add_argument("--worlds", type=int, default=4)
    ap.add_argument("--rounds", type=int, default=6)
    ap.add_argument("--population", type=int, default=12)
    ap.add_argument("-o", "--out", type=Path, help="servo map to write")
    arg = ap.parse_args()
    robot, motions = rr.load_robot(arg.robot), [load_trajectory(path) for path in arg.clips]
    if robot.servo_map is None or robot.servo_map.imu is None:
        ap.error(f"the servo map of {arg.robot} has no [imu]")
    worlds = draws(arg.worlds, spread=Spread(delay=DELAY))
    task = Task(robot, (standing(motions[0]), *motions), worlds)
    for plane in PLANES:
        task = replace(task, robot=fitted(task, plane, arg.rounds, arg.population))
    assert task.robot.servo_map is not None
    text = dump_map(task.robot.servo_map)
    print(text[text.index("[balance]") : text.index("[stop.pose]")] if "[stop.pose]" in text else text)
    if arg.out:
        arg.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
