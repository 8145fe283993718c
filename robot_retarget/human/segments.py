"""Orientation of the human's pelvis, chest, head, feet and hands."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, cross, lengths, unit
from robot_retarget.base.keypoints import ARM
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.rule import JOINTS
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.robot.facing import SHOWS_AXIS, hand_frames, snapped_to_axes

# Rotations of the source's joints, and the constant between a joint and its segment.

TURNED_BY = {"l_foot": "l_ankle", "r_foot": "r_ankle"}
"""The keypoint of the joint that rotates each foot."""
UP = np.array([0.0, 0.0, 1.0])
ARBITRARY = 1.2
"""A rotation that differs by more from the one that the body shows carries no information [rad]: of a rest pose, of fingers,
of a foot against the axis of its knee."""


def own_rotation(motion: Motion, match: Match, segment: str) -> Floats | None:
    """Return the rotations (T, 3, 3) of the joint that turns a segment, or None for a source without rotations."""
    if motion.rotations is None:
        return None
    return matrices_of(motion.rotations[:, carrying_joint(motion, match, segment)])


def matrices_of(rotations: Floats) -> Floats:
    """Return the matrices (…, 3, 3) of quaternions (…, 4), w x y z of any length: R = (w² − u·u) I + 2 u uᵀ + 2 w [u]×."""
    size = np.vecdot(rotations, rotations)
    pairs = rotations[..., :, None] * (rotations / size[..., None])[..., None, :]
    return (pairs.reshape(*size.shape, 16) @ _PRODUCTS).reshape(*size.shape, 3, 3)


def _products() -> Floats:
    """Return (16, 9) shares of the products of a quaternion's components in its matrix."""
    shares = np.zeros((4, 4, 3, 3))
    shares[0, 0] = np.eye(3)
    for k in range(3):
        shares[k + 1, k + 1] = -np.eye(3)
        shares[0, k + 1] = 2 * np.cross(np.eye(3)[k], np.eye(3)).T
    for i, j in np.ndindex(3, 3):
        shares[i + 1, j + 1, i, j] += 2.0
    return shares.reshape(16, 9)


_PRODUCTS = _products()


def carrying_joint(motion: Motion, match: Match, segment: str) -> int:
    """Return the joint that turns a segment: its keypoint's, or the one that carries all joints of the keypoint."""
    joints = match.recognition.marks[TURNED_BY.get(segment, segment)].joints
    carriers = [set(motion.skeleton.above(joint)[1:]) for joint in joints]
    return joints[0] if len(joints) == 1 else max(set.intersection(*carriers), default=0)


def constant_between(own: Floats, wanted: Floats) -> Floats:
    """Return the rotation C (3, 3) that minimises Σ ‖own C − wanted‖² over the frames (orthogonal Procrustes).

    Args:
        own: (T, 3, 3) rotations of the joint.
        wanted: (T, 3, 3) rotations of the segment.
    """
    u, _, vt = np.linalg.svd(np.einsum("tji,tjk->ik", own, wanted))
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


# Orientation of the human's feet: level in the frames in which an upright human stands on them with the ankles lowest.
#
# Positions do not show the roll of a foot. A source with rotations gives the rotation of the ankle, times the constant that
# makes the foot level in those frames.

FEET = ("l_foot", "r_foot")
FLAT_SHARE = 0.1
"""Share of the frames, those with the lowest ankle, in which a standing foot is flat [-]: on tiptoe the ankle is higher. Half
and double change no contact of five labelled clips."""
TWISTED = np.cos(ARBITRARY)
"""Largest cosine of the angle between the left of a twisted foot and the axis of its knee [-]."""
UPRIGHT = 0.9
"""A human is upright while the head is above this share of its largest height [-]. Half changes no contact of five labelled
clips."""
SEATED = 0.5
"""Hips that are never higher than this over the floor are those of a human who lies or kneels [leg lengths]; on a chair they are at 0.55."""
DROP = 0.4
"""Toes of a level foot are this far below the ankle, where the clip does not show it [rad]: the median of 14 exporters."""


def foot_constants(
    motion: Motion, match: Match, x: dict[str, Floats], floor: Floats, contacts: ContactRecord
) -> dict[str, Floats]:
    """Return the constant (3, 3) of each foot; the flat foot corrects one that is on its toes throughout.

    In a skeleton without toes, a flat foot has the heading of the body, and the rotation of the ankle then gives the constant.
    If no foot is ever flat, the axis of the bent knee is the left of the foot, and the way to the toes its forward.

    Args:
        x: (T, 3) per keypoint, over level ground [m].
        floor: (T,) its height in the source [m].
    """
    top = x[next(k for k in ("head", "chest", *match.keypoints) if k in x)][:, 2]
    upright = np.asarray(top >= UPRIGHT * top.max())
    hips = [x[k][:, 2] for k in ("l_hip", "r_hip") if k in x]
    lies = bool(hips) and -JOINTS.floor_height(-np.mean(hips, axis=0)) < SEATED * match.human_leg
    found, drops = {}, {}
    for side in "lr":
        ankle, toe = x.get(f"{side}_ankle"), x.get(f"{side}_toe")
        if ankle is None or f"{side}_knee" not in x or (toe is None and motion.rotations is None):
            continue
        stands = contacts.of(side)[:, 0]
        if toe is not None and lies:
            found[side] = _bent(motion, match, side, x)
            continue
        flat = _flat(ankle[:, 2] + floor, stands, upright)
        if toe is None:
            ahead = facing(trunk_frames(x), len(ankle))[..., 0]
        else:
            ahead = toe - ankle
            drops[side] = _drop(ahead[flat]), stands.any()
        found[side] = _levelled(motion, match, side, x, ahead, flat)
    least = min((drop for drop, stands in drops.values() if stands), default=np.inf)
    for side, (drop, _) in drops.items():
        if drop - least > SHOWS_AXIS:
            found[side] = found[side] @ Rotation.from_euler("y", drop - least).as_matrix()
    return found


def untwisted(feet: Floats, legs: Floats) -> Floats:
    """Return the axes (T, F, 3, 3) of feet, with the axis of the knee as left where no ankle could turn that far from it.

    Captures lose the roll of a foot that points along its shin, and some turn it right over.

    Args:
        feet: (T, F, 3, 3) axes.
        legs: (T, F, 3, 3) places of hip, knee and ankle [m].
    """
    thigh, shin = legs[..., 1, :] - legs[..., 0, :], legs[..., 2, :] - legs[..., 1, :]
    across = cross(thigh, shin)
    bend, along = lengths(across), np.vecdot(feet[..., 1], across)
    turned = (along < TWISTED * bend) & (bend > SHOWS_AXIS * lengths(thigh) * lengths(shin))
    if not turned.any():
        return feet
    y = unit(across)
    ahead = unit(feet[..., 0] - (feet[..., 0] * y).sum(-1, keepdims=True) * y)
    return np.where(turned[..., None, None], np.stack([ahead, y, cross(ahead, y)], axis=-1), feet)


def _flat(height: Floats, stands: np.ndarray, upright: np.ndarray) -> np.ndarray:
    """Return (T,) the frames in which a foot is flat: its ankle is lowest, and mostly an upright human stands on its toes.

    A lying human may have the lowest ankles, with the toes up. Then the frames are chosen among those of an upright stance.
    """
    low, bears = height <= np.quantile(height, FLAT_SHARE), stands & upright
    if bears[low].mean() > 0.5:
        return low
    frames = next(some for some in (bears, stands, np.ones_like(stands)) if some.any())
    return frames & (height <= np.quantile(height[frames], FLAT_SHARE))


def _drop(along: Floats) -> float:
    """Return the median angle by which the toes are below the ankle, from ankle-to-toe vectors (N, 3) [rad]."""
    return float(np.median(np.arcsin(-unit(along)[:, 2])))


def _levelled(motion: Motion, match: Match, side: str, x: dict[str, Floats], ahead: Floats, flat: np.ndarray) -> Floats:
    """Return the constant (3, 3) that makes a foot level, its toes `ahead` (T, 3), in the frames (T,) in which it is flat."""
    ahead = unit(ahead[flat] * [1, 1, 0])
    level = np.stack([ahead, np.cross(UP, ahead), np.broadcast_to(UP, ahead.shape)], axis=2)
    own = own_rotation(motion, match, f"{side}_foot")
    if own is None:
        own = foot_axes(*(x[f"{side}_{k}"] for k in ("knee", "ankle", "toe")))
    return constant_between(own[flat], level)


def _bent(motion: Motion, match: Match, side: str, x: dict[str, Floats]) -> Floats:
    """Return the constant (3, 3) of a foot from the bend of its leg; the toes of a level foot are `DROP` below its ankle."""
    knee, ankle, toe = (x[f"{side}_{k}"] for k in ("knee", "ankle", "toe"))
    seen, level = foot_axes(knee, ankle, toe), Rotation.from_euler("y", -DROP).as_matrix()
    own = own_rotation(motion, match, f"{side}_foot")
    return level if own is None else constant_between(own, seen @ level)


def foot_axes(knee: Floats, ankle: Floats, toe: Floats) -> Floats:
    """(T, 3, 3) along the foot, across shin and foot, and square to both.

    Args:
        knee: (T, 3) [m].
        ankle: (T, 3) [m].
        toe: (T, 3) [m].
    """
    along, y = unit(toe - ankle), unit(np.cross(knee - ankle, toe - ankle))
    return np.stack([along, y, np.cross(along, y)], axis=2)


# Orientation of the human's pelvis, chest, head, feet and hands.
#
# A segment's frame has its forward, left and up as columns. Those of pelvis, chest and head are built of two directions
# between keypoints, in the same way on both bodies. Positions show neither the yaw of a head, the roll of a foot, nor the
# tilt of a pelvis. A source with rotations gives the rotation of the joint, times the constant that fits best over the clip
# (`feet.py` has that of feet). A head may hang and a hand may be bent throughout a clip: their constants come from the rest
# pose of the file, if the motion agrees with it, because many exporters write arbitrary rest poses. A head without rotations
# is levelled if its neck leans otherwise than the robot's.

LEVEL = {"trunk": 0.1, "end": 0.6}
"""Axes of a joint within this angle of those of an upright segment are replaced by them: of pelvis and chest, and of head and
hands, which clips may show bent throughout [rad]. Half and double change the axes in 6 and 7 of 13 exporters' clips."""


def segment_constants(
    motion: Motion, match: Match, x: Floats, floor: Floats, contacts: ContactRecord
) -> dict[str, Floats]:
    """Return, per segment that both bodies have, the constant (3, 3) from its measured axes to its forward, left and up.

    The measured axes are those of the joint that turns it, else those that its keypoints show (`visible_segments`).

    Args:
        x: (T, K, 3) keypoints over level ground [m].
        floor: (T,) its height in the source [m].
    """
    if match.recognition.segments:
        return {segment: np.eye(3) for segment in match.recognition.segments if segment in match.anatomy.frames}
    points, leans = match.named(x), _leans(match)
    visible = trunk_frames(points)
    found = {segment: _trunk_constant(motion, match, segment, visible, leans) for segment in leans}
    feet = foot_constants(motion, match, points, floor, contacts)
    for side in "lr":
        if side in feet:
            found[f"{side}_foot"] = feet[side]
        if (hand := _hand_constant(motion, match, side, points)) is not None:
            found[f"{side}_hand"] = hand
    return {segment: constant for segment, constant in found.items() if segment in match.anatomy.frames}


def _trunk_constant(
    motion: Motion, match: Match, segment: str, visible: dict[str, Floats], leans: dict[str, Floats]
) -> Floats:
    """Return the constant (3, 3) of pelvis, chest or head."""
    upright, own = visible[segment] @ leans[segment], own_rotation(motion, match, segment)
    if own is None:
        level = _nod(upright, visible["chest"] @ leans["chest"]) if segment == "head" else np.eye(3)
        return leans[segment] @ level
    constant = constant_between(own, upright)
    if segment == "head":  # at rest it faces as the chest does
        constant = _likelier(constant, _resting(motion, match)["chest"][0] @ leans["chest"])
    return snapped_to_axes(constant, LEVEL["end" if segment == "head" else "trunk"])


def visible_segments(x: dict[str, Floats]) -> dict[str, Floats]:
    """Return the axes (T, 3, 3) of pelvis, chest, head and feet that keypoints (T, 3) show."""
    frames = trunk_frames(x)
    for side in "lr":
        knee, ankle, toe = (x.get(f"{side}_{k}") for k in ("knee", "ankle", "toe"))
        if knee is not None and ankle is not None and toe is not None:
            frames[f"{side}_foot"] = foot_axes(knee, ankle, toe)
    return frames


def trunk_frames(x: dict[str, Floats]) -> dict[str, Floats]:
    """(T, 3, 3) of pelvis, chest and head as their keypoints (T, 3) show them, of either body."""
    frames: dict[str, Floats] = {}
    if {"pelvis", "chest", "l_hip", "r_hip"} <= x.keys():
        frames["pelvis"] = _upright(x["l_hip"] - x["r_hip"], x["chest"] - x["pelvis"])
    if {"pelvis", "chest", "l_shoulder", "r_shoulder"} <= x.keys():
        middle = (x["l_shoulder"] + x["r_shoulder"]) / 2
        frames["chest"] = _upright(x["l_shoulder"] - x["r_shoulder"], middle - x["pelvis"])
    if "chest" in frames and {"neck", "head"} <= x.keys():
        frames["head"] = _upright(frames["chest"][:, :, 1], x["head"] - x["neck"])
    return frames


def _leans(match: Match) -> dict[str, Floats]:
    """(3, 3) that turns a frame built of the robot's keypoints in its reference pose upright: a head may sit before its neck."""
    forward = match.anatomy.forward
    upright = np.stack([forward, np.cross(UP, forward), UP], axis=1)
    built = trunk_frames(match.named(match.rest[None]))
    return {segment: frames[0].T @ upright for segment, frames in built.items()}


def _nod(head: Floats, chest: Floats) -> Floats:
    """(3, 3) that levels a head whose neck leans otherwise than the robot's on the whole: it faces as the chest then."""
    constant = constant_between(head, chest)
    return constant if Rotation.from_matrix(constant).magnitude() > SHOWS_AXIS else np.eye(3)


def facing(frames: dict[str, Floats], count: int) -> Floats:
    """Return the orientation (T, 3, 3) of the body in `count` frames: its pelvis, else its chest, else no rotation."""
    for segment in ("pelvis", "chest"):
        if segment in frames:
            return frames[segment]
    return np.broadcast_to(np.eye(3), (count, 3, 3))


def _upright(left: Floats, up: Floats) -> Floats:
    """Frames whose left is `left` and whose up is `up` less its part along it."""
    y = unit(left)
    z = unit(up - (up * y).sum(1, keepdims=True) * y)
    return np.stack([np.cross(y, z), y, z], axis=2)


def _hand_constant(motion: Motion, match: Match, side: str, x: dict[str, Floats]) -> Floats | None:
    """Return the constant (3, 3) of a hand; None where the source has no rotations or the elbow never bends.

    The rest pose gives it, if the frames with a bent elbow agree with that on the whole.
    """
    arm = [x[f"{side}_{k}"] for k in ARM if f"{side}_{k}" in x]
    own = own_rotation(motion, match, f"{side}_hand") if len(arm) == len(ARM) else None
    if own is None:
        return None
    straight, bend = hand_frames(*arm)
    if bend.max() < SHOWS_AXIS:
        return None
    fingers = motion.skeleton.outward(carrying_joint(motion, match, f"{side}_hand"))
    constant = pointed(constant_between(own * bend[:, None, None] ** 2, straight), fingers)
    constant = _likelier(constant, _hand_at_rest(facing(_resting(motion, match), 1)[0], fingers))
    return snapped_to_axes(constant, LEVEL["end"])


def _resting(motion: Motion, match: Match) -> dict[str, Floats]:
    """(1, 3, 3) of pelvis, chest and head as the keypoints of the rest pose show them; zeros where the file has none."""
    rest = match.weights(len(motion.skeleton)) @ motion.skeleton.rest()
    return trunk_frames(match.named(rest[None]))


def _hand_at_rest(body: Floats, fingers: Floats) -> Floats:
    """(3, 3) forward, left and up of a hand in the rest pose: to the fingers, elbows back, whether arms are out or down."""
    back, ahead = -body[:, 0], unit(fingers)
    across = np.cross(back, ahead)
    if np.linalg.norm(across) < SHOWS_AXIS:
        return np.zeros((3, 3))
    return np.stack([ahead, unit(across), np.cross(ahead, unit(across))], axis=1)


def _likelier(fitted: Floats, rest: Floats) -> Floats:
    """Return the constant (3, 3) of the rest pose if it exists and is near to the one fitted to the clip, else the fitted one."""
    if not np.allclose(rest.T @ rest, np.eye(3)):
        return fitted
    return rest if Rotation.from_matrix(fitted.T @ rest).magnitude() < ARBITRARY else fitted


def pointed(constant: Floats, fingers: Floats) -> Floats:
    """Return a hand's constant (3, 3) with its forward along its fingers (3,), or along the axis that they are near.

    The mean bend of the wrist over a clip is not that of a straight hand: a clip may show hands on hips throughout.

    Args:
        constant: (3, 3) forward, left and up of the hand in its joint.
        fingers: (3,) way to the fingers in the joint, 0 if unknown [m].
    """
    if not fingers.any():
        return constant
    axis = np.where(np.arange(3) == np.abs(fingers).argmax(), np.sign(fingers), 0.0)
    ahead = axis if axis @ unit(fingers) > np.cos(LEVEL["end"]) else unit(fingers)
    if ahead @ constant[:, 0] < np.cos(ARBITRARY):
        return constant
    return Rotation.align_vectors(ahead, constant[:, 0])[0].as_matrix() @ constant
