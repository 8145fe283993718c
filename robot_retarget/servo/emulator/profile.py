"""The path from where a goal position finds the servo to the goal: step, rectangle, triangle or trapezoid of speed."""

from dataclasses import dataclass
from math import sqrt

from robot_retarget.actuators.motors import TICKS_PER_TURN

VELOCITY = 0.229 * TICKS_PER_TURN / 60
"""One raw unit of velocity [ticks/s]."""
ACCELERATION = 214.577 * TICKS_PER_TURN / 3600
"""One raw unit of acceleration [ticks/s²]."""

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


def velocity_based(start: float, goal: float, velocity: int, acceleration: int) -> Profile:
    """t₁ = V / A, t₂ = Δ / V, t₃ = t₁ + t₂; a triangle where V is not reached. V = 0 is a step, A = 0 a rectangle."""
    distance = goal - start
    speed, pull = velocity * VELOCITY, acceleration * ACCELERATION
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
