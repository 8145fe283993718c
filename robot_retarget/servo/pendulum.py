"""A known load on a servo's shaft, by which it is identified."""

from dataclasses import dataclass

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY
from robot_retarget.base.errors import ServoError


@dataclass(frozen=True)
class Pendulum:
    """What turns with the shaft; the axis is horizontal."""

    mass: float
    """[kg]."""
    length: float
    """From the axis to the centre of mass [m]."""
    inertia: float = 0.0
    """About the axis [kg m²]; 0 takes that of a point mass."""

    def __post_init__(self) -> None:
        for name, low, high in (("mass", 1e-3, 50.0), ("length", 1e-3, 5.0), ("inertia", 0.0, 100.0)):
            if not low <= getattr(self, name) <= high:
                raise ServoError(f"the pendulum's {name} {getattr(self, name):g} is not in {low:g}…{high:g}")
        if not self.inertia:
            object.__setattr__(self, "inertia", self.mass * self.length**2)

    @property
    def weight(self) -> float:
        """Torque of its weight when it is horizontal [N m]."""
        return self.mass * STANDARD_GRAVITY * self.length
