"""From a file's unit and axes to metres with z up, decided by the body in its poses, or by its format where that is strict."""

from dataclasses import replace

import numpy as np

from robot_retarget.arrays import Floats, unit
from robot_retarget.errors import MatchError
from robot_retarget.motion.calibration import calibration_frames
from robot_retarget.motion.capture import Capture
from robot_retarget.motion.recognise import Recognition, recognise
from robot_retarget.motion.skeleton import Motion
from robot_retarget.motion.stature import LEG, leg_length, stature

UNITS = {
    "metre": 1.0,
    "centimetre": 0.01,
    "millimetre": 0.001,
    "inch": 0.0254,
    "decimetre": 0.1,
    "CMU unit of 0.0564 m": 0.0254 / 0.45,
}
"""Metres in each unit that exporters use. The CMU library divides inches by 0.45."""
STATURES = (1.2, 2.1)
"""Of a body that a unit of the table is believed for [m]."""
AXES = ("+x", "+y", "+z", "-x", "-y", "-z")


def upright(capture: Capture) -> Motion:
    """A motion in metres, z up, of what a file says; calibration frames at its start are dropped.

    The world is turned by a proper rotation that takes the up axis to z (y up: x' = z, y' = x, z' = y) and scaled;
    nothing else is moved. A body that is not human keeps y up, its unit guessed from its size.
    """
    try:
        recognition = recognise(capture.skeleton, capture.positions)
    except MatchError as error:
        unit = _likely_unit(capture.positions)
        reason = str(error)
        axis = (capture.up or "+y").removeprefix("+")
        note = f"{reason[:1].upper()}{reason[1:]}; {axis} is taken as up and the {unit} as unit."
        return _motion(capture, 0, UNITS[unit], capture.up or "+y", (note,))
    first, calibration = calibration_frames(recognition, capture.positions, capture.fps)
    positions = capture.positions[first:]
    metres, unit_note = unit_of(recognition, positions)
    axis = capture.up or up_axis(recognition, positions)
    notes = (*calibration, unit_note, *recognition.notes)
    if axis != "+z":
        notes = (*notes, f"The file has {axis} up; it was turned to z up.")
    return _motion(capture, first, metres, axis, notes)


def unit_of(recognition: Recognition, positions: Floats) -> tuple[float, str]:
    """Metres in the file's unit, and a sentence: the known unit that makes an adult's stature, else one that fits."""
    tall = stature(recognition, positions)
    for name, metres in UNITS.items():
        if STATURES[0] <= tall * metres <= STATURES[1]:
            return metres, f"The unit is the {name}: a stature of {tall * metres:.2f} m."
    metres = LEG / leg_length(recognition, positions)
    return (
        metres,
        f"No known unit fits: scaled to legs of {LEG} m ({metres:.4g} m a unit), a stature of {tall * metres:.2f} m.",
    )


def up_axis(recognition: Recognition, positions: Floats) -> str:
    """The signed axis that points up.

    Mean of head minus ankles along each axis, less how much the lowest point moves along it: a body that falls and lies
    leaves the mean, but its lowest point stays on the floor.
    """
    x = recognition.place(positions)
    at = recognition.keypoints.index
    ankles = x[:, [at("l_ankle"), at("r_ankle")]].mean(axis=1)
    top = x[:, at("head")] if "head" in recognition.marks else x[:, [at("l_shoulder"), at("r_shoulder")]].mean(axis=1)
    mean = unit(top - ankles).mean(axis=0)
    leg = leg_length(recognition, positions)
    unsteady = np.concatenate([x.min(axis=1).std(axis=0), x.max(axis=1).std(axis=0)]) / leg
    score = np.concatenate([mean, -mean]) - np.minimum(unsteady, 0.5)
    return AXES[int(np.argmax(score))]


def turn_to_z(axis: str) -> Floats:
    """The proper rotation (3, 3) that takes a signed axis to z: a cyclic change of axes, or half a turn about x after it."""
    matrix = np.roll(np.eye(3), AXES.index(f"+{axis[1]}") - 2, axis=1)
    return matrix if axis[0] == "+" else np.diag([1.0, -1.0, -1.0]) @ matrix


def _motion(capture: Capture, first: int, metres: float, axis: str, notes: tuple[str, ...]) -> Motion:
    """x' = s M x and R' = M R Mᵀ, of a quaternion (w, M v): joints keep their rest pose, which turns along."""
    turn = turn_to_z(axis)
    rotations = None
    if capture.rotations is not None:
        rotations = capture.rotations[first:].copy()
        rotations[..., 1:] = rotations[..., 1:] @ turn.T
    skeleton = replace(capture.skeleton, offsets=metres * capture.skeleton.offsets @ turn.T)
    positions = metres * capture.positions[first:] @ turn.T
    contacts = None if capture.contacts is None else capture.contacts[first:]
    return Motion(skeleton, positions, rotations, capture.fps, capture.source, (*capture.notes, *notes), contacts)


def _likely_unit(positions: Floats) -> str:
    """The unit in which the skeleton's first pose is about as large as a person."""
    size = float(np.linalg.norm(np.ptp(positions[0], axis=0)))
    return min(UNITS, key=lambda unit: abs(np.log(max(size, 1e-12) * UNITS[unit] / 1.8)))
