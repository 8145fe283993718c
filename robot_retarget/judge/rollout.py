"""Simulate a trajectory in MuJoCo and judge it: first as kinematics, then on position servos."""

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast, get_args

import numpy as np

from robot_retarget.actuators.goals import Goals
from robot_retarget.base.choices import Stand
from robot_retarget.base.errors import UsageError
from robot_retarget.base.progress import Count, Progress
from robot_retarget.base.untrusted.documents import NAMES
from robot_retarget.collision import Warnings
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import as_motion
from robot_retarget.judge.bodies import Objects
from robot_retarget.judge.build import build_plant, crowded_body
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.feedback import has_feedback, with_feedback
from robot_retarget.judge.figures import at_frames
from robot_retarget.judge.plant import Mode, Plant
from robot_retarget.judge.playback import Playback, Rollout, plain_goals, roll_out
from robot_retarget.judge.policy import Policy, under_policy
from robot_retarget.judge.policy_files import read_policy
from robot_retarget.judge.report import Report, SimulatedTrajectory, as_executed, build_report, series_of
from robot_retarget.judge.servo_model import Drives, drives_of
from robot_retarget.judge.verdict import Thresholds
from robot_retarget.judge.worlds import (
    BACKLASH,
    NOMINAL,
    WORLDS,
    Draw,
    drawn,
    is_decided,
    judges,
    run_trials,
    stop_of,
    trial_figures,
    worst_trial,
)
from robot_retarget.judge.worlds import draws as drawn_worlds
from robot_retarget.robot.catalog import on_robot
from robot_retarget.robot.contacts import replay_contacts
from robot_retarget.robot.model import Robot
from robot_retarget.scene.scene import Scene
from robot_retarget.solver.pipeline import Result
from robot_retarget.trajectory import Trajectory, fingerprint

IN_MOTION = Playback(settle_before=0.0, settle_after=0.0)
"""Under a policy, a trajectory begins and ends at its own speed: a running robot would fall from a stand in its first pose."""
COMPENSATION = 2
"""Duration of the compensation, as the progress counts it: in simulations of the trajectory."""
SIMULATED = 2 + COMPENSATION
"""Steps of the progress of a simulation without drawn simulations."""


def simulate(
    trajectory: Result | Trajectory | str | Path,
    robot: Robot | str | Path | None = None,
    *,
    mode: Stand = "auto",
    drives: Drives | str | None = "auto",
    playback: Playback | None = None,
    compensate: bool = True,
    goals: Goals | None = None,
    others: bool = True,
    thresholds: Thresholds | None = None,
    warnings: Warnings | None = None,
    draws: int = WORLDS,
    feedback: bool | None = None,
    backlash: float = 0.0,
    objects: Objects = "carried",
    policy: Policy | str | Path | None = None,
    motion: Motion | str | Path | None = None,
    progress: Progress | None = None,
) -> Report:
    """Play a trajectory and judge it.

    It is first replayed without physics (self-contacts, joint ranges, joint speeds), then tracked by position servos under
    gravity after settling in its first pose (tracking errors, torques, contacts).

    Args:
        trajectory: a result of `retarget`, a trajectory, or its file; its `likeness` is judged if present. The report's
            `trajectory` also holds the judged goals, and the report has the sha256 of its file (`fingerprint`): save both.
        robot: a robot, or a name or model file that `load_robot` loads; by default the trajectory's.
        mode: `auto` is `free` for a trajectory that was planned in balance, else `pinned`. `pinned` carries the root along
            its path in the air: the limbs feel gravity as the root turns, but not
            the root's accelerations. `free` sets the robot on a floor and leaves it alone.
        drives: the servos; `auto` takes those of the robot's servo map if it has one, None keeps the model's own
            actuators.
        playback: rate, delay and settling times; a policy has its own rate and by default no settling: the robot begins with the
            velocity of the trajectory.
        compensate: send goals that make up for lag, load and speed (`compensate.compensated`) rather than the
            trajectory itself; the report then has the figures of plain playback as well.
        goals: goals to judge in place of these.
        others: judge on other servos than the modelled ones too (`judges`), and report the servos with the worst outcome.
        thresholds: limits of a pass (`verdict.read_thresholds` reads them from TOML).
        warnings: of the trajectory (`collision.warnings_of`), by default those of the result; the report then says
            how they agree with the contacts that happened.
        draws: in mode `free`, largest number of drawn simulations (`worlds.draws`) if the robot stays up in this one: half of them where none ends
            in a fall (`worlds.is_decided`).
        feedback: judge goals together with the balance feedback of the robot's servo map. None does so in mode `free` if the
            map has a sensor and gains.
        backlash: play between every servo and its link, either way [rad]; goals and feedback have no information about it.
        objects: whether the moving bodies of the trajectory's scene are `carried` along their path, or `free`: then they
            have mass, and only friction holds them.
        policy: a frozen controller, or its ONNX file (`policy_files.read_policy`), that makes the goals from the state in mode `free`; the
            trajectory is its reference. Servo map, compensation and feedback do not act, and `play` refuses the report.
        motion: the human of the trajectory, or its file; by default that of the result. The motion under a policy is compared with it; without a policy
            the trajectory's `likeness` is judged.
        progress: called with (steps done, steps in all), a step for each simulation.

    Raises:
        UsageError: an unknown mode, `free` for a robot without a free root, feedback without a sensor in the map, or a
            backlash out of bounds.
        TrajectoryError: the file cannot be read, or is of another robot, or comes from another motion.
        RobotError: the robot's MJCF cannot be prepared, or a hinge has no servo.
    """
    played, robot = on_robot(trajectory, robot)
    if policy is not None:
        policy = policy if isinstance(policy, Policy) else read_policy(policy)
        if mode == "pinned":
            raise UsageError("a policy balances the robot itself: mode 'free'")
        mode, drives, compensate, others, feedback = "free", None, False, False, False
        playback = replace(playback or IN_MOTION, rate=policy.contract.rate)
    mode = mode_of(played) if mode == "auto" else mode
    plant = plant_of(robot, mode, drives, backlash, played.scene, objects)
    plant = plant if policy is None else under_policy(plant, policy)
    count = Count(progress, SIMULATED + (draws if mode == "free" else 0))
    how, replayed = cast(Mode, mode), replay_contacts(robot, played.qpos)
    if goals is None and compensate:
        goals = compensated(plant, played, how, playback)
    goals = goals or plain_goals(plant, played, playback)
    if _closes(plant, mode, feedback):
        goals = with_feedback(plant, played, goals)
    count.advance(COMPENSATION)
    judged = replace(played, goals=goals)
    trials = run_trials(judges(plant) if others else {NOMINAL: plant}, judged, how, playback, goals)
    chosen = worst_trial(trials)
    count.advance()
    plain = roll_out(chosen.plant, played, how, playback) if compensate else chosen.rollout
    count.advance()
    asked, upright = thresholds or Thresholds(), how == "free" and not chosen.fell
    fallen = _fallen(plant, judged, playback, draws, asked.fallen_share, count) if upright else ()
    if warnings is None and isinstance(trajectory, Result) and len(played) > 1:
        warnings = trajectory.warnings
    human = trajectory.source if motion is None and isinstance(trajectory, Result) else motion
    human = None if human is None or policy is None else as_motion(human)
    if human is not None:
        played.require_source(human.source, human.source_sha256)
    outcome = SimulatedTrajectory(judged, chosen.plant, how, replayed, chosen.rollout, plain, warnings, fallen, human)
    servos = trial_figures(trials, chosen) | ({} if policy is None else {"policy": policy.name})
    if policy is not None and not policy.contract.follows_joints:
        asked = replace(asked, tracking_rms=np.inf)
    return build_report(outcome, fingerprint(judged), asked, servos)


def mode_of(trajectory: Trajectory) -> Mode:
    """Return the mode in which a trajectory is judged by default: `free` if it was planned in balance, else `pinned`."""
    return "free" if trajectory.balance else "pinned"


def report_beside(path: Path, trajectory: Trajectory, robot: Robot, mode: str | None = None) -> Report | None:
    """Return the report next to a trajectory file, with its motion simulated again on the judged servos, if the robot has them.

    Args:
        mode: of the report; by default `free`, else `pinned`.
    """
    files = (path.with_name(NAMES[how]) for how in ([mode] if mode else NAMES))
    reports = (Report.load(file) for file in files if file.is_file())
    found = next((report for report in reports if report.trajectory_sha256 == fingerprint(path)), None)
    servos = "" if robot.servo_map is None else robot.servo_map.fingerprint
    if found is None or trajectory.goals is None or trajectory.goals.servos not in ("", servos):
        return found
    how, drives = found.figures["mode"], "auto" if trajectory.goals.servos else None
    backlash, objects = found.figures.get("backlash_rad", 0.0), "free" if "objects" in found.figures else "carried"
    plant = judges(plant_of(robot, how, drives, backlash, trajectory.scene, objects)).get(found.figures["servos"])
    if plant is None:
        return found
    rollout = roll_out(plant, trajectory, how, None, trajectory.goals)
    return replace(found, series=series_of(trajectory, plant, rollout), trajectory=trajectory)


def _closes(plant: Plant, mode: str, feedback: bool | None) -> bool:
    """Whether feedback acts.

    Raises:
        UsageError: feedback is on and cannot run.
    """
    able = mode == "free" and has_feedback(plant)
    if feedback and not able:
        why = "only mode 'free' has balance" if mode != "free" else "the robot's servo map has no [imu] and [balance]"
        raise UsageError(f"no feedback: {why}")
    return able if feedback is None else feedback


def _fallen(
    plant: Plant, trajectory: Trajectory, playback: Playback | None, worlds: int, share: float, count: Count
) -> tuple[bool, ...]:
    """Return whether the robot falls in each of `worlds` drawn simulations, or in those that decide about the share (`worlds.is_decided`)."""
    command, draws, loose = trajectory.goals, drawn_worlds(worlds), plant
    if plant.drives is not None and not plant.places.play.size and crowded_body(plant.robot) is None:
        scene, objects = trajectory.scene, "free" if plant.bodies is not None and plant.bodies.free else "carried"
        loose = build_plant(plant.robot, "free", plant.drives, BACKLASH, scene, objects)
    fallen, half = list[bool](), (worlds + 1) // 2
    for part in (draws[:half], draws[half:]):
        if not is_decided(fallen, worlds, share):
            found = rollouts(loose, trajectory, part, playback=playback, command=command, count=count)
            fallen += [stop_of(world, plant.robot, trajectory) is not None for world in found]
    count.advance(worlds - len(fallen))
    return tuple(fallen)


def plant_of(
    robot: Robot,
    mode: str,
    drives: Drives | str | None = "auto",
    backlash: float = 0.0,
    scene: Scene | None = None,
    objects: Objects = "carried",
) -> Plant:
    """The physics of a robot in a mode among the bodies of a scene; `drives`, `backlash` and `objects` as in `simulate`.

    Raises:
        UsageError: an unknown mode, `free` for a robot without a free root, or a backlash out of bounds.
        RobotError: the robot's MJCF cannot be prepared, or a hinge has no servo.
    """
    if mode not in get_args(Mode):
        raise UsageError(f"unknown mode {mode!r}; known: {', '.join(get_args(Mode))}")
    if mode == "free" and not robot.floating:
        raise UsageError(f"mode 'free' needs a robot with a free root; the root of {robot.name!r} is not free")
    if objects not in get_args(Objects):
        raise UsageError(f"unknown objects {objects!r}; known: {', '.join(get_args(Objects))}")
    chosen = drives_of(robot) if isinstance(drives, str) else drives
    return build_plant(robot, cast(Mode, mode), chosen, backlash, scene, objects)


def rollouts(
    plant: Plant,
    trajectory: Trajectory,
    draws: Sequence[Draw],
    *,
    mode: str = "free",
    playback: Playback | None = None,
    command: Goals | None = None,
    threads: int | None = None,
    count: Count | None = None,
) -> list[Rollout]:
    """The same trajectory in many worlds at once, in the order of the draws.

    Args:
        plant: the world as it should be (`plant_of`); each draw alters it.
        draws: see `worlds.draws`.
        command: goals; by default the trajectory itself.
        threads: at once; by default one for each processor. The physics runs without Python's lock.
        count: of the progress, a step for each world.
    """

    def play(draw: Draw) -> Rollout:
        world, how = drawn(plant, draw, playback or Playback())
        return roll_out(world, trajectory, cast(Mode, mode), how, command)

    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        found = []
        for world in pool.map(play, draws):
            found.append(world)
            if count:
                count.advance()
        return found


# How a frozen controller follows a trajectory: falls in the nominal world and in drawn ones, and the motion as executed.

TRIED = 2
"""Number of drawn worlds in addition to the nominal one."""


@dataclass(frozen=True, eq=False)
class Followed:
    """A trajectory under a controller."""

    name: str
    falls: tuple[float | None, ...]
    """When the robot falls in each world, the nominal one first; None where it stays up [s]."""
    error: float
    """Joints as executed, minus the reference, in the nominal world until a fall (rms) [rad]."""
    executed: Trajectory
    """The motion in the nominal world, until a fall."""

    @property
    def fallen(self) -> int:
        """Number of worlds in which it falls."""
        return sum(fall is not None for fall in self.falls)

    def contract(self) -> dict[str, object]:
        """Plain values for JSON."""
        falls = {"falls": self.fallen, "worlds": len(self.falls), "fall_s": self.falls}
        return {"name": self.name, **falls, "error_rad": self.error}


def followed(trajectory: Trajectory, robot: Robot, policy: Policy, worlds: int = TRIED, name: str = "") -> Followed:
    """Play a trajectory under a controller in the nominal world and in drawn ones.

    Args:
        trajectory: the reference.
        robot: its robot, with the model's own actuators.
        policy: the controller.
        worlds: number of drawn worlds (`worlds.draws`).
        name: of the trajectory; by default its source.

    Raises:
        UsageError: as `simulate` with a policy.
    """
    plant = under_policy(plant_of(robot, "free", None, 0.0, trajectory.scene), policy)
    playback = replace(IN_MOTION, rate=policy.contract.rate)
    goals = plain_goals(plant, trajectory, playback)
    nominal = roll_out(plant, trajectory, "free", playback, goals)
    others = rollouts(plant, replace(trajectory, goals=goals), drawn_worlds(worlds), playback=playback, command=goals)
    falls = tuple(stop_of(each, robot, trajectory) for each in (nominal, *others))
    end = trajectory.duration if falls[0] is None else max(falls[0], 0.0)
    tracking = at_frames(trajectory, robot, nominal)
    played = tracking.times <= end
    error = float(np.sqrt((tracking.error[played] ** 2).mean()))
    executed = as_executed(trajectory, nominal, tracking.times[played])
    return Followed(name or trajectory.source, falls, round(error, 4), executed)


def ranked(found: Iterable[Followed]) -> list[Followed]:
    """Return the trajectories that the controller follows best first: by falls, then by the error of joints."""
    return sorted(found, key=lambda each: (each.fallen, each.error))
