"""What poses are for: lines of JSON, simulated servos, real servos."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import IO, Any

import numpy as np

from robot_retarget.actuators.goals import RATE
from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError
from robot_retarget.judge.playback import PlayedPlant
from robot_retarget.judge.rollout import plant_of
from robot_retarget.live.guard import SelfCollisionGuard
from robot_retarget.live.loop import LivePose, Loop, StreamStats
from robot_retarget.robot import Robot
from robot_retarget.servo.live import TargetStream, follow
from robot_retarget.servo.outcome import PlaybackOutcome
from robot_retarget.servo.twin import ViewerWindow


class LineSink:
    """Writes each pose at once."""

    def __init__(self, out: IO[str]) -> None:
        self._out = out

    def show(self, pose: LivePose) -> None:
        row = {"time": round(pose.time, 6), "qpos": pose.qpos.round(6).tolist()}
        row |= {"status": pose.status.name.lower(), "age": round(pose.age, 4)}
        row |= {"bodies": {name: p.round(6).tolist() for name, p in pose.bodies.items()}} if pose.bodies else {}
        self._out.write(json.dumps(row) + "\n")
        self._out.flush()


BEHIND = 0.1
"""Largest lag that the physics makes up for at once [s]; longer lags are dropped."""
FALLEN = 0.5
"""Cosine of the lean of the trunk below which the robot counts as fallen [-]."""


class PhysicsSink:
    """The robot on servos: `pinned` by its root, which goes where the poses have it, or `free` on a floor.

    Raises:
        UsageError: an unknown mode, or `free` for a robot without a free root.
        RobotError: its MJCF cannot be prepared.
        ServoError: a window is requested without a display.
    """

    def __init__(self, robot: Robot, mode: str = "pinned", window: bool = False) -> None:
        self._robot, self._pinned, self._played = robot, mode == "pinned", PlayedPlant(plant_of(robot, mode), RATE)
        self.data: Any = self._played.data
        self._window = ViewerWindow(self._played.plant.model, self.data) if window else None
        self._targets = TargetStream()
        self._began: float | None = None
        self._skipped = 0.0
        self._error, self._ticks = 0.0, 0
        self._fell: float | None = None

    def show(self, pose: LivePose) -> None:
        now = time.monotonic()
        self._targets.set_target(pose.qpos[self._robot.qpos_index], now)
        if self._began is None:
            self._began = now
            self._played.place(pose.qpos, on_floor=not self._pinned)
        if self._pinned:
            self._played.carry(pose.qpos)
        self._go_on(now, self._began)
        if self._window is not None:
            self._window.show()

    def _go_on(self, now: float, began: float) -> None:
        """Step the physics to a time of the clock."""
        self._skipped += max(now - began - self._skipped - self.data.time - BEHIND, 0.0)
        while (at := began + self._skipped + self.data.time) + self._played.seconds <= now:
            target = self._targets.at(at)
            assert target is not None
            self._played.tick(target)
            self._note(target)

    def _note(self, target: Floats) -> None:
        self._error += float(((self.data.qpos[self._robot.qpos_index] - target) ** 2).mean())
        self._ticks += 1
        upright = self.data.xmat[self._robot.root_body][8]
        if self._fell is None and not upright > FALLEN:
            self._fell = self.data.time

    def figures(self) -> dict[str, Any]:
        """What came of it."""
        rms = float(np.sqrt(self._error / max(self._ticks, 1)))
        return {
            "simulated_s": round(self.data.time, 2), "left_out_s": round(self._skipped, 2),
            "tracking_rms_rad": round(rms, 4), "fell_s": None if self._fell is None else round(self._fell, 2),
        }  # fmt: skip

    def close(self) -> None:
        """Shut the window."""
        if self._window is not None:
            self._window.close()


class ServoSink:
    """The joints of a map, from poses of a robot.

    Raises:
        ServoError: the map and the robot have not the same joints.
    """

    def __init__(self, robot: Robot, servo_map: ServoMap) -> None:
        joints = robot.joint_names
        bare = [joint for joint in joints if joint not in (*servo_map.joints, *servo_map.passive)]
        idle = [joint for joint in servo_map.joints if joint not in joints]
        if bare or idle:
            what = f"does not cover {', '.join(bare)}" if bare else f"has {', '.join(idle)}, which {robot.name} has not"
            raise ServoError(f"the servo map {what}")
        self.targets: TargetStream = TargetStream()
        self._places = robot.qpos_index[[joints.index(joint) for joint in servo_map.joints]]
        self._pose = self._standing = robot.standing()
        self.guard: SelfCollisionGuard = SelfCollisionGuard(robot)

    @property
    def stand(self) -> Floats:
        """(n,) the standing pose [rad]."""
        return self._standing[self._places]

    def show(self, pose: LivePose) -> None:
        self.set_target(pose.qpos)

    def set_target(self, qpos: Floats) -> None:
        """Set the joints of a configuration (nq,) as the next target."""
        self._pose = qpos
        self.targets.set_target(qpos[self._places])

    def clear(self, last: Floats, goal: Floats) -> Floats:
        """Return the goal (n,), moved back towards the last one where links would overlap [rad]."""
        before, after = self._pose.copy(), self._pose.copy()
        before[self._places], after[self._places] = last, goal
        return self.guard.admit(before, after)[self._places]


def run_servos(
    loop: Loop,
    sink: ServoSink,
    servo_map: ServoMap,
    port: str | Path,
    seconds: float,
    log: Path,
    say: Callable[[str], None],
) -> tuple[PlaybackOutcome, StreamStats]:
    """Run a loop into servos: the loop in a second thread, the player in this one, which receives Ctrl-C.

    Raises:
        ServoError: as `servo.play.play`.
        RobotRetargetError: the loop failed; the servos hold.
    """
    failed: list[Exception] = []

    def go() -> None:
        try:
            loop.run(seconds)
        except Exception as error:
            failed.append(error)
        finally:
            sink.targets.over.set()

    thread = Thread(target=go, daemon=True)
    thread.start()
    try:
        outcome = follow(sink.targets, servo_map, port, log=log, say=say, clear=sink.clear, stand=sink.stand)
    finally:
        loop.stop.set()
        thread.join()
    if failed:
        raise failed[0]
    if sink.guard.changed:
        say(f"the self-collision guard moved {sink.guard.changed} goals back")
    return outcome, loop.stats
