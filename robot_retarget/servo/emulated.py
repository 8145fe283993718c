"""Play on an emulated robot in one call, with the emulator in a second process."""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from robot_retarget.actuators.map import ServoMap, dump_map
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.outcome import PlaybackOptions, PlaybackOutcome
from robot_retarget.servo.plan import goal_plan, plain_plan
from robot_retarget.servo.play import play
from robot_retarget.trajectory import Trajectory


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
