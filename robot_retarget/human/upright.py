"""From a file's unit and axes to metres with z up, decided by the body in its poses before anything the file says."""

from dataclasses import replace

import numpy as np
from scipy.constants import centi, deci, inch, milli

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MatchError, MotionError, UsageError, known
from robot_retarget.human.camera import levelled
from robot_retarget.human.camera_calibration import calibration_frames, calibration_pose_notes
from robot_retarget.human.capture import Capture
from robot_retarget.human.motion import Motion
from robot_retarget.human.performers import one_performer
from robot_retarget.human.readers.request import Request
from robot_retarget.human.recognition.recognise import LEG, Recognition, leg_length, recognise, stature
from robot_retarget.human.repair import FootingRule, RepairRule, footing, repaired
from robot_retarget.human.up_axis import AXES, UpAxisRule, find_up_axis

UNITS = {
    "metre": 1.0,
    "centimetre": centi,
    "millimetre": milli,
    "inch": inch,
    "decimetre": deci,
    "CMU unit of 0.0564 m": inch / 0.45,
}
"""Metres in each unit that exporters use. The CMU library divides inches by 0.45."""
STATURES = (1.2, 2.1)
"""Of a body that a unit of the table is believed for [m]."""


def upright(
    capture: Capture,
    up: str | None = None,
    repair: bool = True,
    height: float | None = None,
    request: Request | None = None,
) -> Motion:
    """Make a motion in metres, z up, from a capture; calibration frames at its ends are dropped.

    The world is turned by a proper rotation that takes the up axis to z (y up: x' = z, y' = x, z' = y) and scaled;
    the rest is kept. A body that is not human keeps y up, its unit guessed from its size.

    Args:
        up: the axis of the file that points up (`x`, `-y`, …), in place of the axis of the format or of the poses.
        repair: repair defects (`repair.repaired`); without, they are only reported.
        height: the human's stature, from which the scale is found, in place of the file's unit [m].
        request: chooses one of several people whose joints are one tree.

    Raises:
        UsageError: `up` is no axis.
        MotionError: the poses do not decide the up axis.
    """
    given = capture.up if up is None else signed_axis(up)
    capture, others = one_performer(capture, request or Request())
    try:
        recognition = recognise(capture.skeleton, capture.positions)
    except MatchError as error:
        return _other_body(capture, given, str(error))
    proper, calibration = calibration_frames(recognition, capture.positions, capture.fps)
    capture = capture.part(proper)
    metres, unit_note = unit_of(recognition, capture.positions, height)
    raw, (capture, broken) = capture, repaired(capture, recognition, metres, RepairRule(mend=repair))
    axis, axis_notes = _up(recognition, capture, raw, metres) if given is None else (given, ())
    if capture.camera:
        capture, tilt = levelled(capture, recognition, turn_to_z(axis)[2])
        axis_notes = (*axis_notes, tilt)
    level = metres * capture.positions @ turn_to_z(axis).T
    feet = footing(recognition, level, capture.fps, FootingRule())
    ends = calibration_pose_notes(recognition, level, capture.fps)
    notes = (*others, *axis_notes, *broken, *feet, *recognition.notes, *calibration, *ends, unit_note)
    if axis != "+z":
        notes = (*notes, f"The file has {axis} up; it was turned to z up.")
    upright = _motion(capture, metres, axis, notes)
    return replace(upright, start_time=proper.start / capture.fps, known=recognition)


def signed_axis(name: str) -> str:
    """`y` → `+y`.

    Raises:
        UsageError: the name is not that of an axis.
    """
    axis = name.lower() if name[:1] in "+-" else f"+{name.lower()}"
    if axis not in AXES:
        raise UsageError(f"no axis {name!r}; {known(AXES)}")
    return axis


def unit_of(recognition: Recognition, positions: Floats, height: float | None = None) -> tuple[float, str]:
    """Metres in the file's unit, and a sentence: the known unit that makes an adult's stature, else one that fits.

    Args:
        positions: (T, J, 3) of the joints [file units].
        height: the human's stature, if it is known [m].
    """
    tall = stature(recognition, positions)
    if height is not None:
        return height / tall, f"Scaled to a stature of {height:.2f} m, by {height / tall:.4g}."
    for name, metres in UNITS.items():
        if STATURES[0] <= tall * metres <= STATURES[1]:
            return metres, f"The unit is the {name}: a stature of {tall * metres:.2f} m."
    metres = LEG / leg_length(recognition, positions)
    return (
        metres,
        f"No known unit fits: scaled to legs of {LEG} m ({metres:.4g} m a unit), a stature of {tall * metres:.2f} m.",
    )


def turn_to_z(axis: str) -> Floats:
    """The proper rotation (3, 3) that takes a signed axis to z: a cyclic change of axes, or half a turn about x after it."""
    matrix = np.roll(np.eye(3), AXES.index(f"+{axis[1]}") - 2, axis=1)
    return matrix if axis[0] == "+" else np.diag([1.0, -1.0, -1.0]) @ matrix


def _up(recognition: Recognition, capture: Capture, raw: Capture, metres: float) -> tuple[str, tuple[str, ...]]:
    """The up axis, with a note if its lead is small or a repair decided it.

    Raises:
        MotionError: it has none.
    """
    rule = UpAxisRule()
    found = find_up_axis(recognition, capture, metres, rule)
    if found.margin < rule.tie:
        raise MotionError(
            f"the poses do not decide whether {found.axis} or {found.second} points up ({found.reasons}); say which (--up {found.axis})",
            capture.source,
        )
    before = found if raw is capture else find_up_axis(recognition, raw, metres, rule)
    if before.axis != found.axis:
        sentence = f"It is not sure that {found.axis} points up: {before.axis} seemed to before the motion was mended"
        return found.axis, (f"{sentence}; if the body should stand otherwise, say --up {before.axis}.",)
    if found.margin >= rule.doubt:
        return found.axis, ()
    sentence = f"It is not sure that {found.axis} points up ({found.share:.0%} against {found.second}; {found.reasons})"
    return found.axis, (f"{sentence}: if the body should stand otherwise, say --up {found.second}.",)


def _other_body(capture: Capture, given: str | None, reason: str) -> Motion:
    """A body that is not human, scaled to about the size of a person, y up by default."""
    unit, axis = _likely_unit(capture.positions), given or "+y"
    note = f"{reason[:1].upper()}{reason[1:]}; {axis.lstrip('+')} is used as up axis and the {unit} as unit."
    return _motion(capture, UNITS[unit], axis, (note,))


def _motion(capture: Capture, metres: float, axis: str, notes: tuple[str, ...]) -> Motion:
    """x' = s M x and R' = M R Mᵀ, of a quaternion (w, M v): joints keep their rest pose, which turns along."""
    turn = turn_to_z(axis)
    rotations = None
    if capture.rotations is not None:
        rotations = capture.rotations.copy()
        rotations[..., 1:] = rotations[..., 1:] @ turn.T
    skeleton = replace(capture.skeleton, offsets=metres * capture.skeleton.offsets @ turn.T)
    positions = metres * capture.positions @ turn.T
    return Motion(
        skeleton, positions, rotations, capture.fps, capture.source, (*capture.notes, *notes), capture.contacts
    )


def _likely_unit(positions: Floats) -> str:
    """The unit in which the skeleton's first pose is about as large as a person."""
    size = float(np.linalg.norm(np.ptp(positions[0], axis=0)))
    return min(UNITS, key=lambda unit: abs(np.log(max(size, 1e-12) * UNITS[unit] / STATURES[1])))
