"""The vertical of a capture in a camera's frame: the direction in which planted feet do not move and bodies stand.

The up direction u minimises  uᵀ A u  over unit vectors, with

    A = Σ_s (p_s − p̄)(p_s − p̄)ᵀ / σ_f²  +  (I − m mᵀ) / σ_m²  +  (I − c cᵀ) / σ_c²,

p_s the places of planted feet over the path of the body, m the mean direction from ankles to head of a standing body, and c the
camera's own up axis. Its smallest eigenvector is u; the gaps to the others give the standard deviation of the tilt.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, intervals, unit
from robot_retarget.contact.rule import JOINTS, standing
from robot_retarget.human.capture import Capture
from robot_retarget.human.recognition.recognise import Recognition, leg_length

ROUNDS = 3
"""Stances are found again with the vertical that the ones before gave."""


@dataclass(frozen=True)
class CameraRule:
    """How far each kind of evidence strays."""

    floor: float = 0.05
    """σ_f, of the height of a planted foot in a video's result [leg lengths]."""
    posture: float = 0.1
    """σ_m, of the mean lean of a standing person [rad]."""
    camera: float = 0.3
    """σ_c, of the tilt of a camera [rad]."""
    upright: float = 0.8
    """A body stands while its head is higher over the ankles than this share of the most [-]."""


@dataclass(frozen=True)
class Vertical:
    """The up direction of a capture, and how sure it is."""

    up: Floats
    """(3,) in the frame of the capture."""
    tilt: float
    """Angle between the camera's up axis and it [rad]."""
    sigma: float
    """Standard deviation of its direction [rad]."""
    stances: int
    """Number of planted feet that it was found from."""

    @property
    def note(self) -> str:
        """The finding and its certainty, as a sentence."""
        tilt, sigma = np.degrees([self.tilt, self.sigma])
        return (
            f"The camera is tilted by {tilt:.0f}° ± {sigma:.0f}°, from {self.stances} planted feet and the posture: "
            "the motion was levelled."
        )


def levelled(
    capture: Capture, recognition: Recognition, axis: Floats, rule: CameraRule | None = None
) -> tuple[Capture, str]:
    """Return the capture turned about a level axis so that its vertical is the camera's up axis, and a sentence about it.

    Args:
        capture: in the frame of a camera that stands still.
        axis: (3,) the camera's up axis.
        rule: how far each kind of evidence strays; None takes the defaults.
    """
    found = find_vertical(recognition, capture.positions, capture.fps, axis, rule or CameraRule())
    turn = Rotation.align_vectors(axis, found.up)[0]
    positions = turn.apply(capture.positions.reshape(-1, 3)).reshape(capture.positions.shape)
    rotations = capture.rotations
    if rotations is not None:
        flat = Rotation.from_quat(rotations.reshape(-1, 4), scalar_first=True)
        rotations = (turn * flat).as_quat(scalar_first=True).reshape(rotations.shape)
    return replace(capture, positions=positions, rotations=rotations), found.note


def find_vertical(recognition: Recognition, positions: Floats, fps: float, axis: Floats, rule: CameraRule) -> Vertical:
    """Return the up direction of joints (T, J, 3) over time.

    Args:
        positions: (T, J, 3) [any unit].
        fps: frames per second [1/s].
        axis: (3,) the camera's up axis.
        rule: how far each kind of evidence strays.
    """
    leg = leg_length(recognition, positions)
    x = dict(zip(recognition.keypoints, recognition.place(positions / leg).swapaxes(0, 1), strict=True))
    ankles = (x["l_ankle"] + x["r_ankle"]) / 2
    body = x.get("head", x["l_shoulder"] + x["r_shoulder"] - x["pelvis"]) - ankles
    tall = np.linalg.norm(body, axis=1)
    mean = unit(unit(body[tall >= rule.upright * tall.max()]).mean(axis=0))
    prior = (np.eye(3) - np.outer(mean, mean)) / rule.posture**2 + (np.eye(3) - np.outer(axis, axis)) / rule.camera**2
    up, values, stances = mean, np.linalg.eigvalsh(prior), np.zeros((0, 3))
    for _ in range(ROUNDS):
        stances = _planted([x[f"{side}_ankle"] for side in "lr"], up, fps)
        spread = stances - stances.mean(axis=0) if len(stances) else stances
        values, vectors = np.linalg.eigh(prior + spread.T @ spread / rule.floor**2)
        up = vectors[:, 0] * np.sign(vectors[:, 0] @ mean)
    sigma = float(np.sqrt(np.mean(1 / np.maximum(values[1:] - values[0], 1e-9))))
    return Vertical(up, float(np.arccos(np.clip(up @ axis, -1, 1))), sigma, len(stances))


def _planted(feet: list[Floats], up: Floats, fps: float) -> Floats:
    """(S, 3) the median place of every foot in every stance [leg lengths]."""
    places = []
    for foot in feet:
        height = foot @ up
        stands = standing(foot, height - JOINTS.floor_height(height), fps)
        places += [np.median(foot[start:stop], axis=0) for start, stop in intervals(stands)]
    return np.array(places).reshape(-1, 3)
