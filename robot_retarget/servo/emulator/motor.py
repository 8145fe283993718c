"""What turns inside a servo: the position controller, and a plain motor on a load."""

from dataclasses import dataclass, field
from math import exp, sin, tau

from robot_retarget.actuators.control_tables import Model
from robot_retarget.actuators.motors import (
    FULL_PWM,
    HEAT_RISE,
    HEAT_TIME,
    TICKS_PER_TURN,
    Pendulum,
    mechanics_of,
    next_speed,
)

RADIANS = tau / TICKS_PER_TURN
AMBIENT = 30.0
"""Temperature of the room and of a rested servo [°C]."""
OVERLOAD_DUTY = 0.8
"""A servo that puts this part of its supply on the winding ..."""
OVERLOAD_SPEED = 0.1
"""... and does not reach this part of its no-load speed carries more than it can ..."""
OVERLOAD_TIME = 1.0
"""... and after this time without a break reports overload [s]."""


@dataclass
class EmulatedMotor:
    """State of one output shaft in ticks of its own encoder; angle 2048 is the middle of the table."""

    model: Model
    position: float = 2048.0
    """Unfolded [ticks]."""
    velocity: float = 0.0
    """[ticks/s]."""
    duty: float = 0.0
    """Part of the supply on the winding, −1…1."""
    current: float = 0.0
    """[A]."""
    temperature: float = AMBIENT
    inertia: float = 0.012
    """Of rotor and load at the output [kg m²]."""
    damping: float = 0.0
    """Besides the back-EMF [N m s/rad]."""
    friction: float = 0.03
    """Dry [N m]."""
    weight: float = 0.0
    """Torque of a pendulum's weight when it is horizontal [N m]."""
    hanging: float = 2048.0
    """Where the pendulum hangs [ticks]."""
    gear: float = 1.0
    """Turns of the shaft for one of the pendulum."""
    jammed: bool = False
    """Whether the shaft is blocked."""
    strained: float = 0.0
    """For how long it has carried more than it can [s]."""
    integral: float = field(default=0.0, repr=False)

    def torque(self, voltage: float) -> float:
        """Of the winding, before what speed takes away [N m]."""
        return self.duty * self.model.motor.stall_at(voltage)

    def carry(self, pendulum: Pendulum, gear: float, hanging: float) -> None:
        """Put a pendulum on the joint behind the gear, that hangs at `hanging` [ticks], with the published mechanics of the servo."""
        mechanics = mechanics_of(self.model.motor)
        self.inertia, self.weight = mechanics.armature + pendulum.inertia / gear**2, pendulum.weight / gear
        self.damping, self.friction, self.hanging = mechanics.damping, mechanics.friction, hanging
        self.gear = gear

    def step_plant(self, voltage: float, dt: float) -> None:
        """Step the built-in plant: J ω' = τ(duty) − m g l sin q − d ω − friction (`mechanics.next_speed`)."""
        torque = self.torque(voltage) - self.weight * sin((self.position - self.hanging) * RADIANS / self.gear)
        drag = self.model.motor.back_emf + self.damping
        omega = next_speed(self.velocity * RADIANS, torque, self.inertia, drag, self.friction, dt)
        self.velocity = 0.0 if self.jammed else omega / RADIANS
        self.position += self.velocity * dt

    def update_load(self, voltage: float, dt: float) -> None:
        """Update current, heat and overload from duty and speed."""
        motor, speed = self.model.motor, self.velocity * RADIANS
        self.current = motor.current(self.duty, speed, voltage) if self.duty else 0.0
        goal = AMBIENT + HEAT_RISE * (self.current / motor.continuous_current) ** 2
        self.temperature += (goal - self.temperature) * (1 - exp(-dt / HEAT_TIME))
        stuck = abs(self.duty) >= OVERLOAD_DUTY and abs(speed) < OVERLOAD_SPEED * motor.no_load_speed
        self.strained = self.strained + dt if stuck else 0.0

    @property
    def overloaded(self) -> bool:
        """Whether a load beyond its output has lasted too long."""
        return self.strained > OVERLOAD_TIME

    def control_position(
        self, target: float, speed: float, gains: tuple[int, int, int], limit: float, dt: float
    ) -> None:
        """PID on the position: duty = (Kp e + Ki ∫e + Kd ė) / 885, with the table's scaling of gains."""
        p, i, d = gains
        error = target - self.position
        self.integral = max(-limit, min(limit, self.integral + i / 65536 * error * dt * 1000 / FULL_PWM)) if i else 0.0
        motor = self.model.motor
        ahead = motor.duty_per_error(p) * error + motor.duty_per_speed(d) * (speed - self.velocity)
        raw = RADIANS * ahead + self.integral
        self.duty = max(-limit, min(limit, raw))

    def switch_off(self) -> None:
        """Torque off."""
        self.duty = self.integral = self.strained = 0.0
