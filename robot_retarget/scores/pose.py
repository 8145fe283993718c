"""Figures of limbs, waist and root against the human.

Each body is seen in the heading frame of its pelvis (the hip line). Unit and range stand at each figure.

limb_deg: angle between a bone of the human and the robot's, over upper and lower arms, thighs, shins and the trunk

    θ = arccos(û · v̂)        unit: degree, range: 0 to 180

Source: the direction error of motion retargeting, as in GMR's and this project's comparisons.

twist_deg: the same angle between the shoulder lines, a twisted waist. Source: waist jumps are the artefact that GMR's authors blame for
failures of trained policies.

root_path_err: distance of the robot's pelvis from the human's, scaled path

    mean_t ‖(p_t − p_0) − (ℓ'/ℓ) R (h_t − h_0)‖ / ℓ'        unit: leg lengths, range: 0 and more

p the robot's pelvis, h the human's, ℓ' and ℓ their legs, R the turn between their first headings. Source: this project.

body_pos_err_cm: distance between the robot's keypoints and the human's after the human has been given the robot's bone lengths

    mean over keypoints and frames of ‖y_k − ŷ_k‖,   ŷ_k = ŷ_parent + ℓ'_k û_k,   ŷ_pelvis = y_pelvis        unit: cm, range: 0 and more

û_k the direction of the human's bone, turned from the human's heading to the robot's, ℓ'_k the robot's bone. Source: SPARK's mean body
position error [arXiv 2603.11480, Table I]. SPARK calibrates a human URDF to the robot by hand and compares its bodies; here the bone
lengths of the keypoints are the calibration, so figures compare in kind, not to the digit.
"""

from collections.abc import Sequence

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, unit
from robot_retarget.graph.kinds.bodies import links_of
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import NEAR
from robot_retarget.scores.figure import Figure, Value, measures
from robot_retarget.scores.pair import Pair, angles_between
from robot_retarget.scores.subject import Subject


@measures(
    Figure("limb_deg_mean", "deg", 2, "angle between a human bone and the robot's, mean", most=180.0),
    Figure("limb_deg_p95", "deg", 2, "the same, 95th percentile", most=180.0),
    human=True,
)
def limbs(subject: Subject) -> tuple[Value, ...]:
    """The mean and the 95th percentile over bones and frames."""
    angles = np.degrees(list(subject.pair.bone_angles().values()))
    return (angles.mean(), np.percentile(angles, 95)) if angles.size else (None, None)


@measures(
    Figure("twist_deg_mean", "deg", 2, "angle between the shoulder lines, seen from the hips, mean", most=180.0),
    Figure("twist_deg_max", "deg", 2, "the same, largest", most=180.0),
    human=True,
)
def twist(subject: Subject) -> tuple[Value, ...]:
    """The mean and the largest over the frames."""
    pair = subject.pair
    if not pair.has("l_shoulder", "r_shoulder"):
        return None, None
    left, right = pair.index("l_shoulder"), pair.index("r_shoulder")
    angles = np.degrees(angles_between(*(x[:, left] - x[:, right] for x in pair.seen)))
    return angles.mean(), angles.max()


@measures(Figure("root_path_err", "legs", 3, "distance of the pelvis from the human's scaled path, mean"), human=True)
def root_path(subject: Subject) -> tuple[Value, ...]:
    """The mean over the frames."""
    pair = subject.pair
    if not pair.has("pelvis"):
        return (None,)
    human, robot = (x[:, pair.index("pelvis")] for x in (pair.human, pair.robot))
    scaled = pair.match.leg_ratio * (human - human[0]) @ pair.turn[0].T
    return (np.linalg.norm(robot - robot[0] - scaled, axis=1).mean() / pair.match.robot_leg,)


@measures(
    Figure("body_pos_err_cm", "cm", 2, "distance of keypoints from the human of the robot's bone lengths (SPARK)"),
    human=True,
)
def body_position(subject: Subject) -> tuple[Value, ...]:
    """The mean distance over all keypoints but the pelvis."""
    pair = subject.pair
    off = np.linalg.norm(pair.robot - _calibrated(pair), axis=2)[:, pair.match.parents >= 0]
    return (100 * off.mean() if off.size else None,)


def _calibrated(pair: Pair) -> Floats:
    """(T, K, 3) the human with the robot's bones, hung from the robot's pelvis [m]."""
    placed, lengths = pair.robot.copy(), pair.match.robot_bones
    for k, parent in enumerate(pair.match.parents.tolist()):
        if parent >= 0:
            bone = np.einsum("tij,tj->ti", pair.turn, unit(pair.human[:, k] - pair.human[:, parent]))
            placed[:, k] = placed[:, parent] + lengths[k] * bone
    return placed


# Figures of distances between pairs of keypoints, over the path τ between them: ‖x_u − x_v‖/τ_uv, 0 (together) to 1 (stretched).
#
# distance_err and near_err: difference of the human's and the robot's
#
#     | ‖x_u − x_v‖/τ_uv − ‖y_u − y_v‖/τ'_uv |        unit: 1, range: 0 to 1
#
# over all pairs, and over those that are near in the human: ‖x_u − x_v‖/τ_uv < 0.35. Source: the normalisation of [Mucherino2017].
#
# contact_recall and contact_f1: contacts of the hands that the human makes and the robot keeps. A human contact is a pair hand–hand,
# hand–head or hand–leg whose distance is below its threshold. The robot keeps it if its distance is at most the human's plus 0.04. A contact
# is false if the robot is below the threshold and the human more than 0.04 above it.
#
#     recall = kept / human contacts        F1 = 2 kept / (2 kept + false + lost)        unit: 1, range: 0 to 1
#
# None where the clip has no contact. The rule is that of `contact.touch`. Source: contact preservation as in OmniRetarget, on the body itself.


@measures(
    Figure("distance_err_mean", "", 4, "error of normalised distances over all pairs of keypoints", most=1.0),
    Figure("near_err", "", 4, "the same over pairs that are near in the human", most=1.0),
    human=True,
)
def distances(subject: Subject) -> tuple[Value, ...]:
    """The mean over all pairs, and over near pairs."""
    human, robot = subject.pair.closeness(*np.triu_indices(len(subject.pair.match.keypoints), 1))
    error, near = np.abs(human - robot), human < NEAR
    return error.mean(), error[near].mean() if near.any() else None


@measures(
    Figure("contact_recall", "", 3, "contacts of the hands that the robot keeps", "higher", 1.0),
    Figure("contact_f1", "", 3, "the same, false contacts counted (F1)", "higher", 1.0),
    Figure("contact_frames", "frames", 0, "frames in which the human makes a contact", "neither"),
    human=True,
)
def contacts(subject: Subject) -> tuple[Value, ...]:
    """Recall, F1 and the frames in which the human makes any contact."""
    touches = subject.pair.touches
    if touches.share is None:
        return None, None, 0
    made, hit, false = (int(which.sum()) for which in (touches.human, touches.kept, touches.false))
    return touches.share, 2 * hit / (hit + false + made), int(touches.human.any(axis=1).sum())


# Touches of the bodies around a robot, by MuJoCo's distances d of its links from them, as the public comparison of retargeters has them.
#
#     touch: a link is −1.1 mm ≤ d ≤ 2 cm from a body; inside: a link is deeper than 1.1 mm
#     kept: frames × contacts of the human with a body in which the same part of the robot touches the same body
#
# A contact of the human is a touch of a hand, elbow, knee, toe or the pelvis, or a foot that stands on a body. A distance within 2 cm
# alone says nothing: a hand 12 cm inside a box has it as well. Units: % of frames, mm. Range: 0 to 100 %; 0 and more.

BODY_TOUCH = (-0.0011, 0.02)
"""Bounds of a touch [m], by the definition above."""


@measures(
    Figure("body_touch_pct", "%", 1, "frames in which a link touches a body without sinking in", "higher", 100),
    Figure("body_touch_hands_pct", "%", 1, "the same of the hands", "higher", 100),
    Figure("body_touch_feet_pct", "%", 1, "the same of the feet", "higher", 100),
    Figure("body_inside_pct", "%", 1, "frames in which a link is over 1.1 mm inside a body", most=100),
    Figure("body_depth_mm", "mm", 1, "deepest that a link is inside a body"),
    scene=True,
)
def touches(subject: Subject) -> tuple[Value, ...]:
    """Return the shares of frames with touches and with links inside, and the largest depth."""
    distance = subject.body_distances
    shares = [
        _share(distance[..., own]) for own in (slice(None), *(_columns(subject, end) for end in ("hand", "foot")))
    ]
    inside = 100.0 * (distance < BODY_TOUCH[0]).any(axis=(1, 2)).mean()
    return *shares, inside, 1e3 * max(-float(distance.min()), 0.0)


@measures(
    Figure("body_contacts_kept_pct", "%", 1, "contacts of the human with bodies that the robot keeps", "higher", 100),
    scene=True,
    human=True,
)
def kept(subject: Subject) -> tuple[Value]:
    """Return the share of frames × contacts that are kept; None without a contact."""
    found = contacts_of(subject)
    made, held = (sum(int(each[k].sum()) for each in found.values()) for k in range(2))
    return (100.0 * held / made if made else None,)


def notes_of(subject: Subject) -> list[str]:
    """Return a note about every body that the human touches: in how many frames of contact the robot touches it, by part."""
    by_body: dict[str, list[str]] = {}
    for (part, body), (touching, held) in contacts_of(subject).items():
        name = part.replace("ankle", "foot")
        by_body.setdefault(body, []).append(f"{name} {int(held.sum())} of {int(touching.sum())} frames")
    return [f"{body}: contacts kept {', '.join(parts)}" for body, parts in by_body.items()]


def contacts_of(subject: Subject) -> dict[tuple[str, str], tuple[Bools, Bools]]:
    """Return per part and body in contact (T,) whether the human touches, and whether the robot does then too."""
    human, scene = subject.around, subject.trajectory.scene
    if human is None or scene is None or subject.anatomy is None:
        return {}
    found = {}
    for (part, body), touching in _human_contacts(human).items():
        if touching.any():
            links = links_of(part, subject.robot, subject.anatomy)
            near = subject.body_distances[:, body][:, np.isin(subject.body_links, links)].min(axis=1)
            found[part, scene.names[body]] = touching, touching & _touching(near)
    return found


def _human_contacts(human: HumanFeatures) -> dict[tuple[str, int], Bools]:
    """Return per part and body (T,) whether a human touches, or stands."""
    around = human.around
    assert around is not None
    found = {pair: around.touches.held[:, k] for k, pair in enumerate(around.touches.pairs)}
    for k, foot in enumerate(human.contacts.feet):
        own = [k for k, name in enumerate(around.ground.keypoints) if name[0] == foot]
        part = f"{foot}_ankle"
        for body in range(len(around.scene)):
            on = (around.ground.bodies[:, own] == body).any(axis=1) & human.contacts.planted[:, k]
            found[part, body] = on
    return found


def _columns(subject: Subject, end: str) -> np.ndarray:
    """Return (L,) which links are those of the hands with their fingers, or of the feet."""
    anatomy = subject.anatomy
    if anatomy is None:
        return np.zeros(len(subject.body_links), dtype=bool)
    if end == "foot":
        weld = np.asarray(subject.robot.model.body_weldid)
        return np.isin(subject.body_links, [weld[sole.bodies[0]] for sole in anatomy.soles.values()])
    hands = [anatomy.sites[name].body for name in ("l_hand", "r_hand") if name in anatomy.sites]
    return np.isin(subject.body_links, _carried(subject, hands))


def _carried(subject: Subject, bodies: Sequence[int]) -> list[int]:
    """Return the links of some bodies of the model and of those that they carry."""
    parents = subject.robot.model.body_parentid
    found = set(np.asarray(subject.robot.model.body_weldid)[list(bodies)].tolist())
    for body in range(1, len(parents)):
        if int(parents[body]) in found:
            found.add(body)
    return sorted(found)


def _touching(distance: Floats) -> Bools:
    return (distance >= BODY_TOUCH[0]) & (distance <= BODY_TOUCH[1])


def _share(distance: Floats) -> Value:
    """Return the share of frames in which the nearest of some links (T, B, L) touches [%]; None without such a link."""
    return 100.0 * float(_touching(distance.min(axis=(1, 2))).mean()) if distance.size else None
