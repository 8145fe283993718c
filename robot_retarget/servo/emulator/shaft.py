"""What hosts see of a servo's shaft: reversed, offset, folded to a turn; and the path it is on."""

from robot_retarget.actuators.motors import FULL_PWM, TICKS_PER_TURN
from robot_retarget.servo.emulator import profile
from robot_retarget.servo.emulator.motor import EmulatedMotor
from robot_retarget.servo.emulator.profile import Profile
from robot_retarget.servo.emulator.registers import HOMING_REACH, POSITION, REVERSE, TIME_BASED, Registers

IN_POSITION = 20
"""Distance from its goal within which a servo is in position [ticks]."""
FOLLOWING_ERROR = 100
"""Distance from its path beyond which it reports a following error [ticks]."""


class Shaft:
    """The motor's encoder as the registers show it, and the profile from the last goal."""

    registers: Registers
    motor: EmulatedMotor

    def __init__(self, registers: Registers, motor: EmulatedMotor) -> None:
        self.registers, self.motor = registers, motor
        self.path: Profile = profile.velocity_based(0.0, 0.0, 0, 0)
        self.since: float = 0.0
        """When the path began [s]."""

    @property
    def direction(self) -> int:
        """−1 in reverse mode."""
        return -1 if self.registers["drive_mode"] & REVERSE else 1

    @property
    def offset(self) -> int:
        """The homing offset, if it has an effect [ticks]."""
        offset = self.registers["homing_offset"]
        single = self.registers["operating_mode"] == POSITION
        return 0 if single and abs(offset) > HOMING_REACH else offset

    def to_present(self, ticks: float) -> float:
        """Present position for an encoder position: reversed, then offset."""
        return (TICKS_PER_TURN - ticks if self.direction < 0 else ticks) + self.offset

    def to_encoder(self, ticks: float) -> float:
        """Encoder position for a present position."""
        ticks -= self.offset
        return TICKS_PER_TURN - ticks if self.direction < 0 else ticks

    @property
    def present(self) -> float:
        """Present position, unrounded [ticks]."""
        return self.to_present(self.motor.position)

    def drop_turns(self) -> None:
        """Forget full turns."""
        self.motor.position %= TICKS_PER_TURN

    def start(self, goal: float, now: float) -> None:
        """Begin a path from where the present one is to a goal."""
        r, here = self.registers, self.path.position(now - self.since)
        kind = profile.time_based if r["drive_mode"] & TIME_BASED else profile.velocity_based
        self.path, self.since = kind(here, goal, r["profile_velocity"], r["profile_acceleration"]), now

    def set_stationary(self, goal: float, now: float) -> None:
        """A path that is at its end already."""
        self.path, self.since = profile.velocity_based(goal, goal, 0, 0), now

    def running(self, now: float) -> bool:
        """Whether the path is not over."""
        return now - self.since < self.path.total

    def publish(self, now: float, torque: bool) -> None:
        """Bring the registers of position, speed and effort up to date."""
        r, motor, elapsed = self.registers, self.motor, now - self.since
        r["present_position"] = round(self.present)
        r["present_velocity"] = round(self.direction * motor.velocity / profile.VELOCITY)
        r["present_pwm"] = round(self.direction * motor.duty * FULL_PWM)
        if "present_current" in r:
            r["present_current"] = round(self.direction * motor.current / motor.model.current_unit)
        else:
            r["present_load"] = round(self.direction * motor.duty * 1000)
        r["velocity_trajectory"] = round(self.path.velocity(elapsed) / profile.VELOCITY)
        r["position_trajectory"] = round(self.path.position(elapsed))
        r["moving"] = int(self.moving(now, torque))
        r["moving_status"] = self._status(now, torque)

    def moving(self, now: float, torque: bool) -> bool:
        """Whether the path runs or the shaft turns."""
        threshold = self.registers["moving_threshold"] * profile.VELOCITY
        return (torque and self.running(now)) or abs(self.motor.velocity) > threshold

    def _status(self, now: float, torque: bool) -> int:
        off = abs(self.path.position(now - self.since) - self.present)
        arrived = abs(self.registers["goal_position"] - self.present) < IN_POSITION
        running = torque and self.running(now)
        lags = torque and off > FOLLOWING_ERROR
        return arrived | 2 * running | 8 * lags | (self.path.kind if running else 0)
