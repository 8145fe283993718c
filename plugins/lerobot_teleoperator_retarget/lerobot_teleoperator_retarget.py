"""LeRobot teleoperator `retarget`: the joints of a humanoid that follows a performer or a motion file.

Actions are `JOINT.pos` [rad] of every hinge, within its range. The robot stands until a performer is seen for a second, and eases to a stop while no
frame arrives.
"""

import logging
from dataclasses import dataclass
from functools import cached_property
from threading import Thread

from lerobot.teleoperators import Teleoperator, TeleoperatorConfig
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from robot_retarget.live.loop import LivePose, Loop
from robot_retarget.live.sources import LOOPBACK, opened
from robot_retarget.robot import load_robot
from robot_retarget.solver.stream import Stream

log = logging.getLogger(__name__)


@TeleoperatorConfig.register_subclass("retarget")
@dataclass(kw_only=True)
class RetargetTeleoperatorConfig(TeleoperatorConfig):
    """The robot, and the performer as `robot-retarget stream` takes it."""

    model: str = "op3"
    """A shipped name, an MJCF or URDF file, or a `robot_descriptions` name."""
    servos: str = ""
    """Servo map (.toml), whose ranges and speeds apply; empty takes the robot's own."""
    source: str = "vmc"
    """`vmc`, `json`, … or a motion file, which is played in real time."""
    listen: int | None = None
    """Port to listen at; by default the protocol's."""
    host: str = LOOPBACK
    """Address to listen at; `0.0.0.0` lets other machines send."""
    sender: str = ""
    """Name or address of the only machine that may send; empty for any."""


class RetargetTeleoperator(Teleoperator):
    """Angles of a robot that follows a performer."""

    config_class = RetargetTeleoperatorConfig
    name = "retarget"

    def __init__(self, config: RetargetTeleoperatorConfig) -> None:
        super().__init__(config)
        self.config = config
        self.robot = load_robot(config.model, servos=config.servos or None)
        self._qpos = self.robot.standing()
        self._loop: Loop | None = None
        self._failed: Exception | None = None

    @cached_property
    def action_features(self) -> dict[str, type]:
        return {f"{joint}.pos": float for joint in self.robot.joint_names}

    feedback_features: dict[str, type] = {}  # noqa: RUF012 (of the base class)

    @property
    def is_connected(self) -> bool:
        return self._loop is not None

    is_calibrated = True

    def calibrate(self) -> None:
        """Do nothing: the first second of a performer is observed."""

    def configure(self) -> None:
        """Do nothing."""

    def connect(self, calibrate: bool = True) -> None:
        """Open the source and follow it in a second thread."""
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        told, say = self.config, log.info
        source = opened(told.source, told.listen, told.host, sender=told.sender, say=say)
        self._loop = Loop(source, lambda skeleton: Stream(self.robot, skeleton), self, say)
        self._thread = Thread(target=self._run, args=(self._loop,), daemon=True)
        self._thread.start()

    def _run(self, loop: Loop) -> None:
        try:
            loop.run()
        except Exception as error:
            self._failed = error

    def show(self, pose: LivePose) -> None:
        """Take a pose of the loop."""
        self._qpos = pose.qpos

    def get_action(self) -> dict[str, float]:
        """Return the newest angles [rad]; after the end of a file its last ones."""
        if self._loop is None or self._failed:
            raise DeviceNotConnectedError(f"{self}: {self._failed or 'not connected'}")
        angles = self._qpos[self.robot.qpos_index]
        return {f"{joint}.pos": float(angle) for joint, angle in zip(self.robot.joint_names, angles, strict=True)}

    def send_feedback(self, feedback: dict[str, float]) -> None:
        """Do nothing: a performer feels no robot."""

    def disconnect(self) -> None:
        """Close the source."""
        if self._loop is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        self._loop.stop.set()
        self._thread.join()
        self._loop.source.close()
        self._loop = None
