"""Motors of position servos, as their makers' datasheets have them: one line of the speed–torque plane each.

    τ(duty, ω) = τ_stall (duty − ω / ω_0)        I = I_stall (duty − ω / ω_0)

at the nominal voltage; another voltage scales what duty gives, not what speed takes away.
"""

from dataclasses import dataclass
from math import tau

from robot_retarget.base.errors import ServoError, known

TICKS_PER_TURN = 4096
"""Of the encoder."""
FULL_PWM = 885
"""Of the register `goal_pwm`: full duty."""
CONTINUOUS_SHARE = 0.2
"""Of stall torque and current that may last: the maker's manuals call motions stable at a fifth of stall or less."""
HEAT_RISE = 50.0
"""Final temperature rise at the continuous current [K]: from 30 °C to the shutdown at 80 °C."""
HEAT_TIME = 300.0
"""Time constant of that warming [s]."""


@dataclass(frozen=True)
class MotorModel:
    """A servo's motor with its gears, at the output shaft, and the gains it leaves the factory with."""

    name: str
    stall_torque: float
    """[N m]."""
    stall_current: float
    """[A]."""
    no_load_speed: float
    """[rad/s]."""
    voltage: float = 12.0
    """At which the three above hold [V]."""
    p_gain: int = 800
    """Register `position_p_gain`: duty = P / p_divisor / 885 for a tick of error."""
    d_gain: int = 0
    """Register `position_d_gain`: duty = D / 16 / 885 for a tick a millisecond."""
    p_divisor: int = 128
    """Of the register `position_p_gain`, as in the manual; 256 where a measurement contradicts it (XL330: Rhoban BAM)."""

    @property
    def back_emf(self) -> float:
        """Torque that speed takes away [N m s/rad]."""
        return self.stall_torque / self.no_load_speed

    def stall_at(self, voltage: float) -> float:
        """Return the torque of full duty at standstill [N m] on a supply [V]."""
        return self.stall_torque * voltage / self.voltage

    def current(self, duty: float, speed: float, voltage: float) -> float:
        """Return the current of the winding [A] at a duty and a speed [rad/s] on a supply [V]."""
        return self.stall_current * (duty * voltage / self.voltage - speed / self.no_load_speed)

    def duty_per_error(self, p_gain: int | None = None) -> float:
        """Return the duty per error of the position [1/rad], at the factory's gain by default."""
        return (self.p_gain if p_gain is None else p_gain) / self.p_divisor / FULL_PWM * TICKS_PER_TURN / tau

    def duty_per_speed(self, d_gain: int | None = None) -> float:
        """Return the duty per error of the speed [s/rad], at the factory's gain by default."""
        return (self.d_gain if d_gain is None else d_gain) / 16 / 1000 / FULL_PWM * TICKS_PER_TURN / tau

    @property
    def continuous_current(self) -> float:
        """That may last [A]."""
        return CONTINUOUS_SHARE * self.stall_current


# https://emanual.robotis.com/docs/en/dxl/x/ : specifications and control table of each page
MOTORS = {
    motor.name: motor
    for motor in (
        MotorModel("XM430-W350", 4.1, 2.3, 4.82),
        MotorModel("XM430-W210", 3.0, 2.3, 8.06),
        MotorModel("XH430-W350", 3.4, 1.3, 3.14),
        MotorModel("XH430-W210", 2.5, 1.3, 5.24),
        MotorModel("XM540-W270", 10.6, 4.4, 3.14),
        MotorModel("XM540-W150", 7.3, 4.4, 5.55),
        MotorModel("XL430-W250", 1.5, 1.4, 6.39, p_gain=640, d_gain=4000),
        MotorModel("XC430-W150", 1.6, 1.4, 11.1),
        MotorModel("XC430-W240", 1.9, 1.4, 7.33),
        MotorModel("2XL430-W250", 1.4, 1.3, 5.97, voltage=11.1),
        MotorModel("2XC430-W250", 1.8, 1.4, 6.7, p_gain=700),
        MotorModel("XL330-M077", 0.215, 1.47, 40.1, voltage=5.0, p_divisor=256),
        MotorModel("XL330-M288", 0.52, 1.47, 10.8, voltage=5.0, p_divisor=256),
        MotorModel("XC330-T288", 0.92, 0.8, 6.8, voltage=11.1, p_gain=900),
        MotorModel("XC330-M288", 0.93, 1.8, 8.5, voltage=5.0),
    )
}


def motor_named(name: str) -> MotorModel:
    """A motor by the name printed on the servo; a trailing -R or -T (its connector) is ignored.

    Raises:
        ServoError: the servo is unknown.
    """
    plain = name.strip().upper()
    plain = plain[:-2] if plain.endswith(("-R", "-T")) else plain
    if plain not in MOTORS:
        raise ServoError(f"no servo model {name!r}; {known(MOTORS, typed=name)}")
    return MOTORS[plain]
