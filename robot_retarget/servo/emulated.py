"""Play on an emulated robot in one call: an emulator process of its own, the player here."""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from robot_retarget.errors import ServoError
from robot_retarget.servo.map import ServoMap, dump_map
from robot_retarget.servo.outcome import Options, Outcome
from robot_retarget.servo.plan import goal_plan, plain_plan
from robot_retarget.servo.play import play
from robot_retarget.trajectory import Trajectory


@contextmanager
def emulator_process(servo_map: ServoMap, *options: str) -> Iterator[str]:
    """The port of a running emulator; it is stopped when the block is left.

    Args:
        servo_map: its servos.
        options: more of `robot-retarget servos emulate`, such as `--physics`.

    Raises:
        ServoError: it does not start.
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
    options: Options | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Outcome:
    """Play a trajectory's goals, or where it has none itself, on an emulated robot: `outcome.figures` says how closely it followed.

    Args:
        trajectory: of a robot that ships, or without physics of any.
        servo_map: its servos.
        physics: the robot's MuJoCo model stands behind the servos on its floor; else each motor turns by itself.
        lockstep: as fast as both processes go: time goes by goals and not by the clock.
        log: where `play.npz` goes.
        options: how to play.
        say: is told what is being done.

    Raises:
        ServoError: the map does not cover the joints, or the emulator does not start.
    """
    plan = plain_plan(trajectory, servo_map) if trajectory.goals is None else goal_plan(trajectory, servo_map)
    words = [*(["--physics"] if physics else []), *(["--lockstep", str(plan.rate)] if lockstep else [])]
    with emulator_process(servo_map, *words) as port:
        return play(plan, servo_map, port, replace(options or Options(), lockstep=lockstep), log, say)
