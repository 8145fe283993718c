"""What turns inside a servo: the position controller, and a plain motor on a load."""

from dataclasses import dataclass, field
from math import exp, sin, sqrt

from robot_retarget.actuators.control_tables import Model
from robot_retarget.actuators.motors import (
    FULL_PWM,
    HEAT_RISE,
    HEAT_TIME,
    ROOM,
    TICKS_PER_TURN,
    Pendulum,
    mechanics_of,
    next_speed,
)
from robot_retarget.servo.emulator.registers import (
    CURRENT_POSITION,
    HOMING_REACH,
    POSITION,
    POSITIONS,
    REVERSE,
    TIME_BASED,
    Registers,
)

OVERLOAD_DUTY = 0.8
"""A servo that puts this part of its supply on the winding ..."""
OVERLOAD_SPEED = 0.1
"""... and does not reach this part of its no-load speed carries more than it can ..."""
OVERLOAD_TIME = 1.0
"""... and after this time without a break reports overload [s]."""


@dataclass
class EmulatedMotor:
    """State of one output shaft in ticks of its encoder; angle 2048 is the middle of the table."""

    model: Model
    position: float = 2048.0
    """Unfolded [ticks]; 2048 is the middle of the turn of an X servo."""
    velocity: float = 0.0
    """[ticks/s]."""
    duty: float = 0.0
    """Part of the supply on the winding, −1…1."""
    current: float = 0.0
    """[A]."""
    temperature: float = ROOM
    inertia: float = 0.012
    """Of rotor and load at the output [kg m²]."""
    damping: float = 0.0
    """Besides the back-EMF [N m s/rad]."""
    friction: float = 0.03
    """Dry [N m]: that of the XM430 of the OP3 in `PUBLISHED`, 0.03."""
    weight: float = 0.0
    """Torque of a pendulum's weight when it is horizontal [N m]."""
    hanging: float = TICKS_PER_TURN / 2
    """Where the pendulum hangs [ticks]: in the middle of the turn."""
    gear: float = 1.0
    """Turns of the shaft for one of the pendulum."""
    jammed: bool = False
    """Whether the shaft is blocked."""
    strained: float = 0.0
    """For how long it has carried more than it can [s]."""
    integral: float = field(default=0.0, repr=False)

    @property
    def tick(self) -> float:
        """Angle of a tick [rad]."""
        return 1 / self.model.motor.ticks_per_radian

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
        """Step the built-in plant: J ω' = τ(duty) − m g l sin q − d ω − friction (`motors.next_speed`)."""
        tick = self.tick
        torque = self.torque(voltage) - self.weight * sin((self.position - self.hanging) * tick / self.gear)
        drag = self.model.motor.back_emf + self.damping
        omega = next_speed(self.velocity * tick, torque, self.inertia, drag, self.friction, dt)
        self.velocity = 0.0 if self.jammed else omega / tick
        self.position += self.velocity * dt

    def update_load(self, voltage: float, dt: float) -> None:
        """Update current, heat and overload from duty and speed."""
        motor, speed = self.model.motor, self.velocity * self.tick
        self.current = motor.current(self.duty, speed, voltage) if self.duty else 0.0
        goal = ROOM + HEAT_RISE * (self.current / motor.continuous_current) ** 2
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
        raw = self.tick * ahead + self.integral
        self.duty = max(-limit, min(limit, raw))

    def switch_off(self) -> None:
        """Torque off."""
        self.duty = self.integral = self.strained = 0.0


# The path from where a goal position finds the servo to the goal: step, rectangle, triangle or trapezoid of speed.

ACCELERATION = {"mx1": 8.583 / 360}
"""One raw unit of acceleration by table [turns/s²]; that of the X series is 214.577 / 3600."""

STEP, RECTANGLE, TRIANGLE, TRAPEZOID = 0x00, 0x10, 0x20, 0x30
"""Bits 4 and 5 of `moving_status`."""


@dataclass(frozen=True)
class Profile:
    """A point-to-point path in ticks: accelerate, cruise, brake."""

    start: float
    distance: float
    """Signed [ticks]."""
    speed: float
    """Reached in the middle [ticks/s]."""
    ramp: float
    """Duration of speeding up and of braking [s]."""
    total: float
    """Duration [s]; 0 for a step."""
    kind: int

    def position(self, time: float) -> float:
        """Where the path is after `time` [s]."""
        if time >= self.total:
            return self.start + self.distance
        sign = 1 if self.distance >= 0 else -1
        if time < self.ramp:
            return self.start + sign * self.speed * time * time / (2 * self.ramp)
        left = self.total - time
        if left < self.ramp:
            return self.start + self.distance - sign * self.speed * left * left / (2 * self.ramp)
        return self.start + sign * self.speed * (time - self.ramp / 2)

    def velocity(self, time: float) -> float:
        """How fast the path is after `time` [ticks/s]."""
        if time >= self.total:
            return 0.0
        sign = 1 if self.distance >= 0 else -1
        share = min(1.0, time / self.ramp, (self.total - time) / self.ramp) if self.ramp else 1.0
        return sign * self.speed * share


def velocity_based(start: float, goal: float, speed: float, pull: float) -> Profile:
    """t₁ = V / A, t₂ = Δ / V, t₃ = t₁ + t₂; a triangle where V is not reached. V = 0 is a step, A = 0 a rectangle.

    Args:
        start: of the path [ticks].
        goal: its end [ticks].
        speed: V [ticks/s].
        pull: A [ticks/s²].
    """
    distance = goal - start
    if not speed or not distance:
        return Profile(start, distance, 0.0, 0.0, 0.0, STEP)
    if not pull:
        return Profile(start, distance, speed, 0.0, abs(distance) / speed, RECTANGLE)
    if speed * speed / pull > abs(distance):
        speed = sqrt(pull * abs(distance))
        return Profile(start, distance, speed, speed / pull, 2 * speed / pull, TRIANGLE)
    return Profile(start, distance, speed, speed / pull, speed / pull + abs(distance) / speed, TRAPEZOID)


def time_based(start: float, goal: float, total_ms: int, ramp_ms: int) -> Profile:
    """Both durations given [ms]; the ramp is at most half of the whole. 0 ms is a step."""
    distance = goal - start
    total = total_ms / 1000
    ramp = min(ramp_ms / 1000, total / 2)
    if not total or not distance:
        return Profile(start, distance, 0.0, 0.0, 0.0, STEP)
    kind = RECTANGLE if not ramp else TRIANGLE if 2 * ramp >= total else TRAPEZOID
    return Profile(start, distance, abs(distance) / (total - ramp), ramp, total, kind)


# What hosts see of a servo's shaft: reversed, offset, folded to a turn; and the path it is on.

IN_POSITION = 20
"""Distance from its goal within which a servo is in position [ticks]."""
FOLLOWING_ERROR = 100
"""Distance from its path beyond which it reports a following error [ticks]."""


class Shaft:
    """The motor's encoder as the registers show it, and the profile from the last goal."""

    def __init__(self, registers: Registers, motor: EmulatedMotor) -> None:
        self.registers, self.motor = registers, motor
        model = motor.model
        self.turn: float = model.motor.ticks_per_turn
        self.speed: float = model.velocity_unit * model.motor.ticks_per_radian
        """One raw unit of velocity [ticks/s] ..."""
        self.pull: float = ACCELERATION.get(model.table, 214.577 / 3600) * self.turn
        """... and of acceleration [ticks/s²]."""
        self.path: Profile = velocity_based(0.0, 0.0, 0.0, 0.0)
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
        return (self.turn - ticks if self.direction < 0 else ticks) + self.offset

    def to_encoder(self, ticks: float) -> float:
        """Encoder position for a present position."""
        ticks -= self.offset
        return self.turn - ticks if self.direction < 0 else ticks

    @property
    def present(self) -> float:
        """Present position, unrounded [ticks]."""
        return self.to_present(self.motor.position)

    def drop_turns(self) -> None:
        """Forget full turns."""
        self.motor.position %= self.turn

    def start(self, goal: float, now: float) -> None:
        """Begin a path from where the present one is to a goal."""
        r, here = self.registers, self.path.position(now - self.since)
        velocity, acceleration = r["profile_velocity"], r["profile_acceleration"]
        if r["drive_mode"] & TIME_BASED:
            self.path = time_based(here, goal, velocity, acceleration)
        else:
            self.path = velocity_based(here, goal, velocity * self.speed, acceleration * self.pull)
        self.since = now

    def set_stationary(self, goal: float, now: float) -> None:
        """A path that is at its end already."""
        self.path, self.since = velocity_based(goal, goal, 0.0, 0.0), now

    def running(self, now: float) -> bool:
        """Whether the path is not over."""
        return now - self.since < self.path.total

    def publish(self, now: float, torque: bool) -> None:
        """Bring the registers of position, speed and effort up to date."""
        r, motor, elapsed = self.registers, self.motor, now - self.since
        r["present_position"] = round(self.present)
        r["present_velocity"] = round(self.direction * motor.velocity / self.speed)
        r["present_pwm"] = round(self.direction * motor.duty * FULL_PWM)
        if "present_current" in r.by_name:
            r["present_current"] = round(self.direction * motor.current / motor.model.current_unit)
        else:
            r["present_load"] = round(self.direction * motor.duty * 1000)
        r["velocity_trajectory"] = round(self.path.velocity(elapsed) / self.speed)
        r["position_trajectory"] = round(self.path.position(elapsed))
        r["moving"] = int(self.moving(now, torque))
        r["moving_status"] = self._status(now, torque)

    def moving(self, now: float, torque: bool) -> bool:
        """Whether the path runs or the shaft turns."""
        threshold = self.registers["moving_threshold"] * self.speed
        return (torque and self.running(now)) or abs(self.motor.velocity) > threshold

    def _status(self, now: float, torque: bool) -> int:
        off = abs(self.path.position(now - self.since) - self.present)
        arrived = abs(self.registers["goal_position"] - self.present) < IN_POSITION
        running = torque and self.running(now)
        lags = torque and off > FOLLOWING_ERROR
        return arrived | 2 * running | 8 * lags | (self.path.kind if running else 0)


# The position controller of a servo: from goal and gains to the duty of the motor.


def drive(mode: int, r: Registers, shaft: Shaft, now: float, dt: float) -> None:
    """Set the motor's duty for the next `dt` [s]; modes that do not control the position leave the motor without current."""
    motor, elapsed = shaft.motor, now - shaft.since
    if mode not in POSITIONS:
        motor.duty = 0.0
        return
    limit = abs(r["goal_pwm"]) / r.by_name["goal_pwm"].high
    if mode == CURRENT_POSITION:
        limit = min(limit, abs(r["goal_current"]) * motor.model.current_unit / motor.model.motor.stall_current)
    factory = motor.model.motor.p_gain
    gains = (
        r["position_p_gain"] if "position_p_gain" in r.by_name else factory,
        r["position_i_gain"],
        r["position_d_gain"],
    )
    target = shaft.to_encoder(shaft.path.position(elapsed))
    motor.control_position(target, shaft.direction * shaft.path.velocity(elapsed), gains, limit, dt)
