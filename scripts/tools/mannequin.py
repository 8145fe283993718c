"""The body of the sample clips: the 22 joints of [Mucherino2017], posed by what its pelvis, hands and feet do.

Bone lengths are those of Table I there, bone directions an upright T-pose: x forward, y left, z up, metres. Hands and
feet are targets, reached in closed form by a two-bone arm or leg: what is planted stays planted to rounding.
"""

from dataclasses import dataclass

import numpy as np
from moves import Floats, unit
from scipy.spatial.transform import Rotation

from robot_retarget.human.motion import Motion
from robot_retarget.human.skeleton import Skeleton, backward, forward
from robot_retarget.papers.skeletal import table_one_body

SIDES = {"Right": -1.0, "Left": 1.0}
UP, FORWARD = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])

_LIMBS = {"C": "Collar", "S": "Shoulder", "E": "Elbow", "W": "Wrist", "H": "Hip", "K": "Knee", "A": "Ankle", "T": "Toe"}
_NAMES = {"H": "Hips", "C": "Chest", "CA": "Chest2", "CB": "Chest3", "N": "Neck", "HD": "Head"}
_NAMES |= {side[0] + letter: side + joint for side in SIDES for letter, joint in _LIMBS.items()}
_TABLE = table_one_body()
_LENGTH = {_NAMES[joint]: float(length) for joint, length in zip(_TABLE.names, _TABLE.lengths.round(6), strict=True)}
THIGH, SHIN, UPPER_ARM, FOREARM = (_LENGTH[f"Left{joint}"] for joint in ("Knee", "Ankle", "Elbow", "Wrist"))

ANKLE_HEIGHT, BALL_HEIGHT = 0.08, 0.02
HEEL = np.array([-0.05, 0.0, -ANKLE_HEIGHT])
"""The heel's lowest point, in the foot [m]."""
BALL = np.array([np.sqrt(_LENGTH["LeftToe"] ** 2 - (ANKLE_HEIGHT - BALL_HEIGHT) ** 2), 0.0, BALL_HEIGHT - ANKLE_HEIGHT])
"""The toe joint, in the foot [m]."""
_DIRECTIONS = {
    "Collar": (0, 0.6, 0.8),
    "Shoulder": (0, 0.93, -0.37),
    "Elbow": (0, 1, 0),
    "Wrist": (0, 1, 0),
    "Hip": (0, 0.82, -0.57),
    "Knee": (0, 0, -1),
    "Ankle": (0, 0, -1),
    "Toe": tuple(BALL),
}
"""Of the bones of the left side in the T-pose; those of the middle point up."""
_ENDS = {"Head": (0, 0, 0.12), "Wrist": (0, 0.09, 0), "Toe": (0.065, 0, -BALL_HEIGHT)}
"""Where the end sites are in their joints, on the left side [m]: the crown, the knuckles, the tip of the toes."""


def _skeleton() -> Skeleton:
    names = [_NAMES[joint] for joint in _TABLE.names]
    parents = [*_TABLE.parents]
    offsets = [_LENGTH[name] * unit(_sided(name, _DIRECTIONS, (0, 0, 1))) for name in names]
    for name in tuple(names):
        if name.removeprefix("Right").removeprefix("Left") in _ENDS:
            parents.append(names.index(name))
            names.append(f"{name}_end")
            offsets.append(_sided(name, _ENDS, (0, 0, 0)))
    return Skeleton(tuple(names), np.array(parents), np.round(offsets, 6))


def _sided(name: str, table: dict[str, tuple], otherwise: tuple) -> Floats:
    """A joint's vector of a table of the left side and the middle."""
    side = next((side for side in SIDES if name.startswith(side)), "Left")
    return np.array(table.get(name.removeprefix(side), otherwise), dtype=float) * (1, SIDES[side], 1)


SKELETON = _skeleton()
_INDEX = {name: joint for joint, name in enumerate(SKELETON.names)}
_OFFSET = dict(zip(SKELETON.names, SKELETON.offsets.copy(), strict=True))
HIP_DROP = -float(_OFFSET["LeftHip"][2])
"""The hip joints are this far below the Hips joint [m]."""
WAIST = float(sum(_OFFSET[joint][2] for joint in ("Chest", "Chest2", "Chest3")))
"""The thorax, that is the Chest3 joint, is this far above the Hips joint [m]."""
SHOULDER = _OFFSET["LeftCollar"] + _OFFSET["LeftShoulder"]
"""The left shoulder in the thorax [m]."""


@dataclass(frozen=True)
class Hand:
    """Where one hand goes, in the frame of the joint `Act.hands_in`; directions of any length, (T, 3) each."""

    wrist: Floats
    """[m]"""
    elbow: Floats
    """The side to which the elbow points."""
    palm: Floats
    """The normal of the palm."""
    fingers: Floats
    """Where the hand points."""


@dataclass(frozen=True)
class Foot:
    """Where one foot goes, in the world."""

    ankle: Floats
    """(T, 3) [m]"""
    pitch: Floats
    """(T,) of the foot, toes up positive [rad]"""
    toes: Floats
    """(T,) pitch of the toes [rad]"""


@dataclass(frozen=True)
class Act:
    """What the body does over T frames; angles are yaw, pitch (forward positive), roll about z, y, x (T, 3) [rad]."""

    hips: Floats
    """(T, 3) the middle between the hip joints [m]"""
    pelvis: Floats
    spine: Floats
    """of the thorax against the pelvis"""
    head: Floats
    """of the head against the thorax"""
    hands: dict[str, Hand]
    feet: dict[str, Foot]
    hands_in: str = "Chest3"
    """A joint, or `world`."""


def perform(act: Act, fps: float, title: str) -> Motion:
    """The motion of the skeleton that does what the act says.

    Raises:
        ValueError: a hand or foot target is out of reach.
    """
    turns = _trunk(act)
    names, count = SKELETON.names, len(act.hips)
    pelvis = act.hips + turns["Hips"].apply([0, 0, HIP_DROP])
    for side, foot in act.feet.items():
        hip = pelvis + turns["Hips"].apply(_OFFSET[f"{side}Hip"])
        turns |= _leg(side, hip, foot)
    joints = _places(pelvis, turns, count) | {"world": np.zeros((count, 3))}
    frame = turns.get(act.hands_in, Rotation.identity())
    for side, hand in act.hands.items():
        turns |= _arm(side, joints[f"{side}Shoulder"], hand, joints[act.hands_in], frame)
    world = np.stack([_turn(turns, joint).as_quat(scalar_first=True) for joint in range(len(names))], axis=1)
    positions, rotations = _posed(pelvis, world)
    return Motion(SKELETON, positions, rotations, fps, title)


def two_bone(root: Floats, tip: Floats, upper: float, lower: float, pole: Floats) -> Floats:
    """The middle joint of a two-bone limb from root to tip (T, 3), bent to the side of `pole`."""
    reach = tip - root
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    if (distance > upper + lower).any():
        frame = int(np.argmax(distance))
        raise ValueError(
            f"frame {frame}: the target is {distance[frame, 0]:.3f} m away, the limb {upper + lower:.3f} m"
        )
    along = reach / distance
    side = unit(pole - np.sum(pole * along, axis=-1, keepdims=True) * along)
    forth = (distance**2 + upper**2 - lower**2) / (2 * distance)
    return root + forth * along + np.sqrt(np.maximum(upper**2 - forth**2, 0)) * side


def pitched(vector: Floats, pitch: Floats) -> Floats:
    """A vector of the sagittal plane turned by a pitch (T,), toes up positive → (T, 3)."""
    return Rotation.from_rotvec(np.multiply.outer(-pitch, [0.0, 1.0, 0.0])).apply(vector)


def _trunk(act: Act) -> dict[str, Rotation]:
    """World rotations from the pelvis to the head, each bend shared evenly by the joints that make it."""
    turns = {"Hips": Rotation.from_euler("ZYX", act.pelvis)}
    for above, joint, share in (
        ("Hips", "Chest", act.spine / 3),
        ("Chest", "Chest2", act.spine / 3),
        ("Chest2", "Chest3", act.spine / 3),
        ("Chest3", "Neck", act.head / 2),
        ("Neck", "Head", act.head / 2),
    ):
        turns[joint] = turns[above] * Rotation.from_euler("ZYX", share)
    return turns


def _leg(side: str, hip: Floats, foot: Foot) -> dict[str, Rotation]:
    knee = two_bone(hip, foot.ankle, THIGH, SHIN, np.broadcast_to(FORWARD, hip.shape))
    hinge = np.cross(unit(knee - hip), FORWARD)
    return {
        f"{side}Hip": _aligned((-UP, -np.cross(UP, FORWARD)), (knee - hip, hinge)),
        f"{side}Knee": _aligned((-UP, -np.cross(UP, FORWARD)), (foot.ankle - knee, hinge)),
        f"{side}Ankle": Rotation.from_rotvec(np.multiply.outer(-foot.pitch, [0.0, 1.0, 0.0])),
        f"{side}Toe": Rotation.from_rotvec(np.multiply.outer(-foot.toes, [0.0, 1.0, 0.0])),
    }


def _arm(side: str, shoulder: Floats, hand: Hand, place: Floats, frame: Rotation) -> dict[str, Rotation]:
    wrist, pole, palm = place + frame.apply(hand.wrist), frame.apply(hand.elbow), frame.apply(hand.palm)
    elbow = two_bone(shoulder, wrist, UPPER_ARM, FOREARM, pole)
    fingers = frame.apply(hand.fingers)
    out = np.array([0.0, SIDES[side], 0.0])
    return {
        f"{side}Shoulder": _aligned((out, -FORWARD), (elbow - shoulder, pole)),
        f"{side}Elbow": _aligned((out, -UP), (wrist - elbow, palm)),
        f"{side}Wrist": _aligned((out, -UP), (fingers, palm)),
    }


def _aligned(rest: tuple[Floats, Floats], posed: tuple[Floats, Floats]) -> Rotation:
    """The rotation that takes a bone to its new direction and a direction across it as near as it can."""

    def frame(bone: Floats, across: Floats) -> Floats:
        first = unit(np.asarray(bone))
        third = unit(np.cross(first, across))
        return np.stack([first, np.cross(third, first), third], axis=-1)

    return Rotation.from_matrix(frame(*posed) @ np.swapaxes(frame(*rest), -1, -2))


def _turn(turns: dict[str, Rotation], joint: int) -> Rotation:
    """The world rotation of a joint; collars and end sites turn with their parents."""
    while SKELETON.names[joint] not in turns:
        joint = int(SKELETON.parents[joint])
    return turns[SKELETON.names[joint]]


def _places(pelvis: Floats, turns: dict[str, Rotation], count: int) -> dict[str, Floats]:
    """Where the joints stand that no arm moves, by name."""
    world = np.stack([_turn(turns, joint).as_quat(scalar_first=True) for joint in range(len(SKELETON))], axis=1)
    positions, _ = _posed(pelvis, world)
    return {name: positions[:, joint] for name, joint in _INDEX.items()}


def _posed(pelvis: Floats, world: Floats) -> tuple[Floats, Floats]:
    """Positions and rotations of all joints from the pelvis and every joint's world rotation."""
    _, local = backward(SKELETON.parents, np.zeros((*world.shape[:2], 3)), world)
    translations = np.tile(SKELETON.offsets, (len(world), 1, 1))
    translations[:, 0] = pelvis
    return forward(SKELETON.parents, translations, local)
