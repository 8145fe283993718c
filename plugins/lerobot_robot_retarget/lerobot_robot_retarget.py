"""LeRobot robot `retarget`: a humanoid on a bus of Dynamixel servos, real or emulated.

Actions and observations are `JOINT.pos` [rad] of every hinge. The player moves the servos in a second thread: it approaches the
first action, interpolates between actions, holds the pose half a second after the last one, and applies the guard of
self-collision, speed limits, the watchdog and the judge of faults.
"""

import logging
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from threading import Thread
from time import monotonic, sleep

from lerobot.robots import Robot, RobotConfig
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from robot_retarget.actuators.map import load_map
from robot_retarget.live.sinks import ServoSink
from robot_retarget.robot import load_robot
from robot_retarget.servo.live import follow
from robot_retarget.servo.outcome import PlaybackOutcome
from robot_retarget.servo.play import emulator_process

EMULATED = "emulated"
ENGAGED = 20.0
"""Longest time in which all servos are checked and engaged [s]."""
log = logging.getLogger(__name__)


@RobotConfig.register_subclass("retarget")
@dataclass(kw_only=True)
class RetargetRobotConfig(RobotConfig):
    """The robot and its bus."""

    model: str = "op3"
    """A shipped name, an MJCF or URDF file, or a `robot_descriptions` name."""
    servos: str = ""
    """Servo map (.toml); empty takes the robot's own."""
    port: str = EMULATED
    """Serial port, or `emulated`: an emulated robot with physics."""
    playback: Path | None = None
    """Log of the last minute (.npz)."""


class RetargetRobot(Robot):
    """A humanoid whose servos follow actions under the checks of `robot-retarget stream --to servos`."""

    config_class = RetargetRobotConfig
    name = "retarget"

    def __init__(self, config: RetargetRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self.robot = load_robot(config.model, servos=config.servos or None)
        if self.robot.servo_map is None:
            raise ValueError(f"{self.robot.name} has no servo map of its own: --robot.servos=MAP.toml")
        self.cameras: dict[str, object] = {}
        self._map = load_map(config.servos) if config.servos else self.robot.servo_map
        self._open, self._thread = ExitStack(), None
        self._ended: PlaybackOutcome | Exception | None = None

    @cached_property
    def action_features(self) -> dict[str, type]:
        return {f"{joint}.pos": float for joint in self.robot.joint_names}

    @property
    def observation_features(self) -> dict[str, type]:
        return {f"{joint}.pos": float for joint in self._map.joints}

    @property
    def is_connected(self) -> bool:
        return self._thread is not None

    is_calibrated = True

    def calibrate(self) -> None:
        """Do nothing: the servo map holds zeros and signs."""

    def configure(self) -> None:
        """Do nothing: the player configures the servos."""

    def connect(self, calibrate: bool = True) -> None:
        """Open the bus, check all servos and engage them where they are."""
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        port = self.config.port
        if port == EMULATED:
            port = self._open.enter_context(emulator_process(self._map, "--physics"))
        self._sink, self._ended = ServoSink(self.robot, self._map), None
        self._thread = Thread(target=self._play, args=(port,), daemon=True)
        self._thread.start()
        until = monotonic() + ENGAGED
        while self._sink.targets.present is None:
            if self._ended is not None or monotonic() > until:
                reason = self._reason()
                self.disconnect()
                raise DeviceNotConnectedError(f"{self}: {reason}")
            sleep(0.01)

    def _play(self, port: str) -> None:
        targets, say = self._sink.targets, log.info
        try:
            self._ended = follow(targets, self._map, port, log=self.config.playback, say=say, clear=self._sink.clear)
        except Exception as error:
            self._ended = error

    def _reason(self) -> str:
        ended = self._ended
        return ended.sentence if isinstance(ended, PlaybackOutcome) else str(ended or "the servos do not engage")

    def get_observation(self) -> dict[str, float]:
        """Return the joints as last read [rad]."""
        self._require_playing()
        present = self._sink.targets.present
        assert present is not None
        return {f"{joint}.pos": float(angle) for joint, angle in zip(self._map.joints, present, strict=True)}

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Set the next target; joints without a value keep their standing pose. Returns the angles in range [rad]."""
        self._require_playing()
        robot, qpos = self.robot, self.robot.standing()
        for joint, place, low, high in zip(robot.joint_names, robot.qpos_index, robot.lower, robot.upper, strict=True):
            qpos[place] = min(max(action.get(f"{joint}.pos", qpos[place]), low), high)
        self._sink.set_target(qpos)
        return {f"{j}.pos": float(angle) for j, angle in zip(robot.joint_names, qpos[robot.qpos_index], strict=True)}

    def _require_playing(self) -> None:
        if self._thread is None or self._ended is not None:
            raise DeviceNotConnectedError(f"{self}: {self._reason() if self._ended else 'not connected'}")

    def disconnect(self) -> None:
        """Move to the stop pose, hold it, and close the bus."""
        if self._thread is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        self._sink.targets.over.set()
        self._thread.join()
        self._thread = None
        self._open.close()
        log.info(self._reason())
