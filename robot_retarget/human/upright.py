"""From a file's unit and axes to metres with z up, decided by the body in its poses before anything the file says."""

from dataclasses import replace

import numpy as np
from scipy.constants import centi, deci, inch, milli

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.errors import MatchError, MotionError, UsageError, known
from robot_retarget.base.keypoints import ARM, LEG, SIDES
from robot_retarget.base.untrusted.arrays import FARTHEST
from robot_retarget.contact.record import labelled
from robot_retarget.human.capture import Capture, Request, one_performer
from robot_retarget.human.defects import ScrambleRule, clean_part, excess, span
from robot_retarget.human.motion import Motion
from robot_retarget.human.recognition.recognise import ADULT_LEG, Recognition, leg_length, recognise, stature
from robot_retarget.human.repair import FootingRule, RepairRule, footing, repaired
from robot_retarget.human.up_axis import AXES, UpAxisRule, find_up_axis, levelled

# Calibration frames: a clip may start or end with a T-pose, or at the origin, and jump into the motion or out of it.
#
# A retargeter that starts there sends the robot across the room. What jumps is dropped; a T- or A-pose that leads smoothly into
# the motion may be intended, and is only reported.

CALIBRATION_POSE = 0.3
"""Minimum duration of a calibration pose [s]; half changes no clip of 13 exporters, double changes one note."""
BEND = 0.35
"""Maximum deviation of a calibration pose from straight knees and elbows and from `RAISED` upper arms [rad]. Half and double
change one note in clips of 13 exporters."""
RAISED = {"T-pose": np.pi / 2, "A-pose": np.pi / 4}
"""Angle between upper arms and the way down the trunk [rad]."""


def calibration_frames(recognition: Recognition, positions: Floats, fps: float) -> tuple[slice, tuple[str, ...]]:
    """Return the frames of the motion proper, and sentences about the still poses before its first jump and after its last.

    The body jumps where its keypoints, on average, step farther than a body can.

    Args:
        positions: (T, J, 3) of the joints [any unit].
        fps: frames per second [1/s].
    """
    rule, points = RepairRule(), recognition.place(positions) / leg_length(recognition, positions)
    steps = np.linalg.norm(excess(np.diff(points, axis=0), rule.steps), axis=2).mean(axis=1)
    jumps = np.flatnonzero(steps > rule.steps.body_threshold(fps)) + 1
    start, stop, notes = 0, len(points), []
    if jumps.size and stop - jumps[0] > 1 and np.ptp(points[: jumps[0]], axis=0).max() < rule.still:
        start = int(jumps[0])
        notes.append(_dropped("first", start, fps, "from"))
    if jumps.size and jumps[-1] - start > 1 and np.ptp(points[jumps[-1] :], axis=0).max() < rule.still:
        stop = int(jumps[-1])
        notes.append(_dropped("last", len(points) - stop, fps, "to"))
    return slice(start, stop), tuple(notes)


def _dropped(which: str, count: int, fps: float, way: str) -> str:
    what = (
        f"The {which} frame is a calibration"
        if count == 1
        else f"The {which} {count} frames ({count / fps:.2f} s) are one"
    )
    return f"{what} pose, {way} which the body jumps: dropped."


def calibration_pose_notes(recognition: Recognition, positions: Floats, fps: float) -> tuple[str, ...]:
    """A sentence for each end of a clip that is a T- or an A-pose, held still before or after a motion.

    Args:
        positions: (T, J, 3) of the joints, z up [m].
        fps: frames per second [1/s].
    """
    x, notes, count = recognition.place(positions) / leg_length(recognition, positions), [], len(positions)
    for which, seen in (("starts", x), ("ends", x[::-1])):
        pose, held = _pose(recognition, seen), _held(recognition, seen)
        if pose and CALIBRATION_POSE * fps <= held < count / 2:
            first, last = (0, held - 1) if which == "starts" else (count - held, count - 1)
            rest = f"{held}:" if which == "starts" else f":{count - held}"
            where = span(first, last, fps)
            notes.append(f"It {which} in a {pose}, {where}: --frames {rest} leaves it out.")
    return tuple(notes)


def _held(recognition: Recognition, x: Floats) -> int:
    """For how many frames the first pose is held."""
    moved = np.linalg.norm(x - x[:1], axis=2).max(axis=1) > RepairRule().still
    return int(moved.argmax()) if moved.any() else len(x)


def _pose(recognition: Recognition, x: Floats) -> str:
    """The name of the calibration pose in the first frame; empty for any other pose."""
    at = {keypoint: x[0, k] for k, keypoint in enumerate(recognition.keypoints)}
    limbs = [[at[f"{side}_{part}"] for part in parts[:3]] for side in SIDES for parts in (ARM, LEG)]
    bends = [np.arccos(np.clip(unit(b - a) @ unit(c - b), -1, 1)) for a, b, c in limbs]
    if max(bends) > BEND:
        return ""
    shoulders = (at["l_shoulder"] + at["r_shoulder"]) / 2
    down = unit(at["pelvis"] - shoulders)
    raised = [np.arccos(np.clip(unit(at[f"{s}_elbow"] - at[f"{s}_shoulder"]) @ down, -1, 1)) for s in SIDES]
    return next((pose for pose, angle in RAISED.items() if np.abs(np.subtract(raised, angle)).max() < BEND), "")


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
"""Statures between which a unit of the table is accepted [m]."""
DOWN = "-y"
"""The axis that points up in the frame of a camera that stands level."""
TALLEST = 8.0
"""Maximum stature of a body in leg lengths [-], a taller one is refused; adults have 2, cartoon figures 4."""


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
        request: chooses one of several people in one tree of joints.

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
    clean, scrambled = clean_part(capture, ScrambleRule())
    capture = capture.part(clean)
    metres, unit_note = unit_of(recognition, capture.positions, height)
    raw, (capture, broken) = capture, repaired(capture, recognition, metres, RepairRule(mend=repair))
    axis, axis_notes = _up(recognition, capture, raw, metres) if given is None else (given, ())
    if capture.camera and axis == DOWN:
        capture, tilt = levelled(capture, recognition, turn_to_z(axis)[2])
        axis_notes = (*axis_notes, tilt)
    level = metres * capture.positions @ turn_to_z(axis).T
    feet = footing(recognition, level, capture.fps, FootingRule())
    ends = calibration_pose_notes(recognition, level, capture.fps)
    notes = (
        *others,
        *((f"{scrambled}.",) if scrambled else ()),
        *axis_notes,
        *broken,
        *feet,
        *recognition.notes,
        *calibration,
        *ends,
        unit_note,
    )
    if axis != "+z":
        notes = (*notes, f"The file has {axis} up; it was turned to z up.")
    upright = _motion(capture, metres, axis, notes)
    start = (proper.start + clean.start) / capture.fps
    return replace(upright, start_time=start, known=recognition, scrambled=scrambled)


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
    leg = leg_length(recognition, positions)
    if not tall < TALLEST * leg:
        raise MotionError(f"a stature of {tall:.3g} over legs of {leg:.3g} is no body")
    metres = ADULT_LEG / leg
    return (
        metres,
        f"No known unit fits: scaled to legs of {ADULT_LEG} m ({metres:.4g} m a unit), a stature of {tall * metres:.2f} m.",
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
    farthest = float(np.abs(capture.positions).max()) * metres
    if farthest > FARTHEST:
        raise MotionError(f"a joint is {farthest:.3g} m from the origin, more than {FARTHEST:g} m", capture.source)
    skeleton = replace(capture.skeleton, offsets=metres * capture.skeleton.offsets @ turn.T)
    positions = metres * capture.positions @ turn.T
    contacts = None if capture.contacts is None else labelled(capture.contacts)
    return Motion(skeleton, positions, rotations, capture.fps, capture.source, (*capture.notes, *notes), contacts)


def _likely_unit(positions: Floats) -> str:
    """The unit in which the skeleton's first pose is about as large as a person."""
    size = float(np.linalg.norm(np.ptp(positions[0], axis=0)))
    return min(UNITS, key=lambda unit: abs(np.log(max(size, 1e-12) * UNITS[unit] / STATURES[1])))
