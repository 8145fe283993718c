"""Play judged goals or plain trajectories on servos: approach, play each piece under the watch of the sensor, end."""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.balance_tables import Balance
from robot_retarget.actuators.inertial import LEAN, LeanTest
from robot_retarget.actuators.map import ServoMap, dump_map
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.check import require_fit
from robot_retarget.servo.cycle import Cycle, Step
from robot_retarget.servo.judgement import Piece
from robot_retarget.servo.link import JointScale
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions, PlaybackOutcome, Record
from robot_retarget.servo.performance import Performance, perform
from robot_retarget.servo.plan import ServoPlan, glide, goal_plan, plain_plan
from robot_retarget.servo.watch import Balancer, FallGuard, open_sensor, require_sound
from robot_retarget.trajectory import Trajectory

LEAN_LIMIT = 0.3
"""A test lean that turns a joint by more than this is left out [rad]: four times the 0.07 of the standing OP3, measured. A leg
that is almost straight would bend its knee by 71°."""


class PiecewisePlayback:
    """Pieces in order, each with its watch.

    Raises:
        ServoError: feedback has no sound sensor.
    """

    def __init__(self, performance: Performance, pieces: Sequence[Piece]) -> None:
        self.performance, self.pieces = performance, pieces
        self.watches: list[FallGuard | None] = [_watch(performance, piece.plan) for piece in pieces]

    def run(self, cycle: Cycle) -> str:
        """Approach and play each piece, and move to the stop pose; on a request to stop, take a way into a stand.

        Returns:
            The reason of the end.
        """
        play, watch = self.performance, None
        for k, (piece, watch) in enumerate(zip(self.pieces, self.watches, strict=True)):
            self._begin(cycle, piece, watch, first=not k)
            play.say(f"playing {piece.plan.duration:.1f} s{f' of {piece.name}' if piece.name else ''}")
            play.follow(cycle, piece.plan, "play", watch, piece.ways)
            if watch is not None:
                watch.require_upright()
            if play.stood:
                return PlaybackEnd.INTERRUPTED.value
        play.move_to_stop_pose(cycle, watch)
        if watch is not None:
            watch.require_upright()
        return PlaybackEnd.FINISHED.value

    def _begin(self, cycle: Cycle, piece: Piece, watch: FallGuard | None, first: bool) -> None:
        """Approach the first pose of a piece, and rest there for its pause."""
        play, plan = self.performance, piece.plan
        way = glide(cycle.guard.goal, plan.angles[0], plan.rate, play.map.limits)
        play.say(f"approaching the first frame in {way.duration:.1f} s")
        play.follow(cycle, way, "approach", watch)
        if piece.pause:
            rest = np.tile(plan.angles[0], (round(piece.pause * plan.rate) + 1, 1))
            play.follow(cycle, ServoPlan(rest, plan.rate), "hold", watch)
        if watch is not None:
            watch.ready()
        if first and isinstance(watch, Balancer):
            self._lean(cycle, watch.test(plan.angles[0]), watch)

    def _lean(self, cycle: Cycle, test: LeanTest, balancer: Balancer) -> None:
        """Lean right and ahead, and compare the sensor with that.

        Raises:
            FaultError: the sensor measures another lean; the robot holds its first pose.
        """
        play = self.performance
        if not (play.options.test_lean and test.possible):
            return
        far = np.ptp(test.goals, axis=0)
        if far.max() > LEAN_LIMIT:
            joint = play.map.joints[int(far.argmax())]
            turn = np.degrees(far.max())
            play.note_fault(f"no test lean: it would turn {joint} by {turn:.0f}°, as the legs are almost straight")
            return
        play.say(f"leaning {np.degrees(LEAN):.0f}° right and ahead to test the inertial sensor")
        goals, last = list(test.goals), len(test.goals) - 1

        def step(k: int) -> Step:
            balancer.lean(test, k)
            return Step(goals[k], "lean", goals[min(k + 1, last)])

        play.run_ticks(cycle, step, lambda: last)
        balancer.require_leant(test)


def _watch(performance: Performance, plan: ServoPlan) -> FallGuard | None:
    """Return the watch of the inertial sensor over a plan: feedback if the plan is judged with it, else a stop after a fall.

    Raises:
        ServoError: feedback has no sound sensor.
    """
    imu, balance = performance.map.imu, performance.map.balance or Balance()
    if plan.feedback is not None:
        if imu is None:
            raise ServoError("the goals were judged with feedback, and the servo map has no [imu]; see --no-feedback")
        sensor = open_sensor(performance.bus, imu)
        require_sound(sensor, imu, performance.options.lockstep)
        return Balancer(plan.feedback, plan, sensor, imu, balance, performance.note_fault)
    if imu is None or plan.up is None:
        return None
    try:
        sensor = open_sensor(performance.bus, imu)
    except ServoError as error:
        performance.note_fault(f"{error}: a fall stops nothing")
        return None
    return FallGuard(plan, sensor, imu, balance, performance.note_fault)


def play(
    plan: ServoPlan | Sequence[Piece],
    servo_map: ServoMap,
    port: str | Path,
    options: PlaybackOptions | None = None,
    log: str | Path | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> PlaybackOutcome:
    """Play a plan on the servos of a map, or several in a row.

    Args:
        plan: judged goals (`plan.goal_plan`) or a plain trajectory (`plan.plain_plan`); or pieces of a playback, whose ways
            into a stand are taken on Ctrl-C or the space bar.
        servo_map: the robot's servos.
        port: a serial port, or that of an emulator.
        options: endings.
        log: where `play.npz` goes; written however playing ends, unless it was refused.
        say: receives progress messages.

    Raises:
        ServoError: the port cannot be opened or is too slow, or the robot is not fit to be moved.
    """
    pieces, how = [Piece(plan)] if isinstance(plan, ServoPlan) else plan, options or PlaybackOptions()
    record, rate = Record(servo_map.joints), pieces[0].plan.rate

    def act(performance: Performance) -> PlaybackOutcome:
        return performance.run(PiecewisePlayback(performance, pieces).run).compared(how.tracking_rms)

    return perform(servo_map, port, rate, how, record, log, say, act)


def preview(plan: ServoPlan, servo_map: ServoMap, port: str | Path | None = None) -> dict[str, Any]:
    """Return figures of a plan on the servos; with a port, the robot is examined, too. Nothing moves.

    Raises:
        ServoError: as `play`.
    """
    scale = JointScale(servo_map)
    outside = np.maximum(plan.angles - scale.upper, scale.lower - plan.angles).max(axis=0)
    facts: dict[str, Any] = {
        "duration_s": round(plan.duration, 3),
        "top_speed_rad_s": round(plan.top_speed, 3),
        "speed_limit_rad_s": servo_map.limits.speed,
        "clipped_rad": {j: round(float(x), 4) for j, x in zip(servo_map.joints, outside, strict=True) if x > 5e-5},
    }
    if port is not None:
        with Bus(port, servo_map.baud, version=servo_map.protocol) as bus:
            conditions, warnings = require_fit(bus, servo_map)
        here = np.array([condition.angle for condition in conditions])
        way = glide(here, plan.angles[0], plan.rate, servo_map.limits)
        facts |= {"approach_s": round(way.duration, 2), "warnings": warnings}
    return facts


# Play on an emulated robot in one call, with the emulator in a second process.


@contextmanager
def emulator_process(servo_map: ServoMap, *options: str) -> Iterator[str]:
    """Run an emulator for the duration of a block. Yields its port.

    Args:
        servo_map: its servos.
        options: more of `robot-retarget servos emulate`, such as `--physics`.

    Raises:
        ServoError: the emulator does not start.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "servos.toml"
        path.write_text(dump_map(servo_map), encoding="utf-8")
        command = [sys.executable, "-m", "robot_retarget", "servos", "emulate", "--map", str(path), *options]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
        try:
            line = process.stdout.readline() if process.stdout else ""
            if not line.startswith("ready "):
                raise ServoError("the emulator does not start")
            yield line.split(maxsplit=1)[1].strip()
        finally:
            process.terminate()
            try:
                process.wait(3)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout:
                process.stdout.close()


def play_emulated(
    trajectory: Trajectory,
    servo_map: ServoMap,
    physics: bool = True,
    lockstep: bool = False,
    log: str | Path | None = None,
    options: PlaybackOptions | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> PlaybackOutcome:
    """Play the goals of a trajectory, or the trajectory itself without goals, on an emulated robot.

    Args:
        trajectory: of a robot that ships, or without physics of any.
        servo_map: its servos.
        physics: simulate the robot's MuJoCo model on its floor; otherwise each motor turns alone.
        lockstep: advance time by one tick per frame of goals instead of the clock.
        log: where `play.npz` goes.
        options: how to play.
        say: receives progress messages.

    Raises:
        ServoError: the map does not cover the joints, or the emulator does not start.
    """
    plan = plain_plan(trajectory, servo_map) if trajectory.goals is None else goal_plan(trajectory, servo_map)
    words = [*(["--physics"] if physics else []), *(["--lockstep", str(plan.rate)] if lockstep else [])]
    with emulator_process(servo_map, *words) as port:
        return play(plan, servo_map, port, replace(options or PlaybackOptions(), lockstep=lockstep), log, say)
