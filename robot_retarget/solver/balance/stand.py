"""The balanced stand at both ends of every free-standing playback, and a human who stays in place."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, bearing
from robot_retarget.graph.soles import flattened, heading
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot.support import support
from robot_retarget.solver.balance.balanced_ik import BalancedIk

SETTLE = 1.0
"""Slower turns of a human are part of walking; faster turns happen over standing feet [s]."""


def stand_places(ik: BalancedIk) -> Floats:
    """Return (F, 4, 3) soles of the robot's standing pose, flat on the floor, around the origin, ahead along x [m]."""
    places = flattened(ik.corners(ik.robot.standing()[None])[0])
    turn = Rotation.from_euler("z", heading(places)).as_matrix()
    return (places - places.mean(axis=(0, 1))) @ turn


def balanced_stand(ik: BalancedIk, places: Floats, frame: int = 0) -> Floats:
    """Return the standing pose with its mass over the middle of its support.

    Args:
        ik: solves the pose.
        places: (F, 4, 3) corners of the soles [m].
        frame: whose bodies are around.

    Returns:
        (nq,) configuration.
    """
    own = flattened(ik.corners(ik.robot.standing()[None])[0])
    turn, address = float(heading(places) - heading(own)), ik.robot.root_address
    posed, spin = np.array(ik.robot.standing()), Rotation.from_euler("z", turn)
    root = posed[address : address + 3] - own.mean(axis=(0, 1))
    posed[address : address + 3] = spin.apply(root) + places.mean(axis=(0, 1))
    posed[address + 2] -= (ik.corners(posed[None])[0] - places)[..., 2].mean() + ik.options.crouch * ik.leg
    turned = spin * Rotation.from_quat(posed[address + 3 : address + 7], scalar_first=True)
    posed[address + 3 : address + 7] = turned.as_quat(scalar_first=True)
    return ik.stand(posed, places, support(places.reshape(-1, 3)).middle, frame)


def in_place(human: HumanFeatures, match: Match) -> tuple[HumanFeatures, Floats]:
    """Return the human over standing feet, without travel and slow turns; and these turns (T,) [rad].

    All directions turn back about the vertical by the smoothed heading of the human. The pelvis stays over the origin,
    and both feet stand throughout.
    """
    ahead = human.heading
    turning = np.unwrap(bearing(ahead))
    slow = gaussian_filter1d(turning, SETTLE * human.fps, mode="nearest")
    back = Rotation.from_euler("z", -slow[:, None]).as_matrix()
    pelvis = match.index("pelvis") if "pelvis" in match.keypoints else 0
    centred = human.positions - human.positions[:, pelvis : pelvis + 1] * [1.0, 1.0, 0.0]
    standing = replace(
        human,
        positions=np.einsum("tij,tkj->tki", back, centred),
        axes=back[:, None] @ human.axes,
        contacts={foot: np.ones_like(stands) for foot, stands in human.contacts.items()},
    )
    return standing, slow


def posed_in_place(ik: BalancedIk, draft: Floats, turns: Floats, stand: Floats) -> Floats:
    """Return a draft's upper body over the legs of a stand.

    Args:
        ik: knows the coordinates of the legs.
        draft: (T, nq) configurations.
        turns: (T,) turns of the root about the vertical that are undone [rad].
        stand: (nq,) configuration: gives the legs, the place of the root and its largest height.

    Returns:
        (T, nq) starts of the frames.
    """
    posed, address, legs = np.array(draft), ik.robot.root_address, ik.leg_coordinates
    posed[:, legs] = stand[legs]
    posed[:, address : address + 2] = stand[address : address + 2]
    posed[:, address + 2] = np.minimum(draft[:, address + 2], stand[address + 2])
    own = Rotation.from_quat(draft[:, address + 3 : address + 7], scalar_first=True)
    turned = Rotation.from_euler("z", -turns[:, None]) * own
    posed[:, address + 3 : address + 7] = turned.as_quat(scalar_first=True)
    return posed
