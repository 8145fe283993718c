"""What poses are for: lines of JSON, servos."""

import json
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import IO

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError
from robot_retarget.live.guard import SelfCollisionGuard
from robot_retarget.live.loop import LivePose, Loop, StreamStats
from robot_retarget.robot import Robot
from robot_retarget.servo.live import TargetStream, follow
from robot_retarget.servo.outcome import PlaybackOutcome


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
