"""Friction of gears that depends on load and speed: the form M4 of Rhoban's BAM (Duclusaud et al., 2025).

    f = f_c + l |τ_m − τ_e| + s (f_s + l_s |τ_m − τ_e|),      s = exp(−|ω / ω_s|^α)

τ_m is the torque of the motor with its back-EMF, τ_e that of gravity, contacts and the other bodies. f_c is the dry friction of
`Drives.friction`. MuJoCo stops a joint with up to `frictionloss`, which `apply` sets to f at each step.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints, frozen


@dataclass(frozen=True, eq=False)
class GearFriction:
    """What load and rest add to the dry friction of n joints."""

    static: Floats
    """f_s (n,): more at rest [N m]."""
    load: Floats
    """l (n,): per torque through the gears [-]."""
    static_load: Floats
    """l_s (n,): more of that at rest [-]."""
    speed: Floats
    """ω_s (n,): where the part at rest has fallen to 1/e [rad/s]."""
    shape: Floats
    """α (n,) [-]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, frozen(value))

    def more(self, motor: Floats, external: Floats, speed: Floats) -> Floats:
        """Return f − f_c (n,) [N m] for torques (n,) [N m] and speeds (n,) [rad/s]."""
        through = np.abs(motor - external)
        rest = np.exp(-(np.abs(speed / self.speed) ** self.shape))
        return self.load * through + rest * (self.static + self.static_load * through)

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData, dofs: Ints, dry: Floats, back_emf: Floats) -> None:
        """Set the friction of the next step from the forces of the last one.

        Args:
            dofs: (n,) of the joints.
            dry: f_c (n,) [N m].
            back_emf: (n,) torque per speed [N m s/rad].
        """
        speed = data.qvel[dofs]
        motor = data.qfrc_actuator[dofs] - back_emf * speed
        external = data.qfrc_constraint[dofs] - _friction(data, model.nv)[dofs] - data.qfrc_bias[dofs]
        model.dof_frictionloss[dofs] = dry + self.more(motor, external, speed)


def _friction(data: mujoco.MjData, dofs: int) -> Floats:
    """The friction (dofs,) among the forces of the last step's constraints [N m]."""
    found = np.zeros(dofs)
    rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
    found[data.efc_id[rows]] = data.efc_force[rows]
    return found
