"""Arms and legs as mirrored pairs of chains, and the centres of their joints."""

import itertools
import re
from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import ALIGNED, Floats
from robot_retarget.robot.anatomy import GUESSED, LIKELY, SURE
from robot_retarget.robot.links import Axis, Links, meeting_point

LEFT_WORDS = {"l", "left", "ll", "fl"}
RIGHT_WORDS = {"r", "right", "lr", "fr"}
ELBOW_WORDS = {"elbow", "el", "elb", "forearm", "lowerarm", "radius", "lradius", "rradius"}
KNEE_WORDS = {"knee", "kne", "shin", "tibia", "shank", "kfe", "calf"}
GRASP_WORDS = {"finger", "thumb", "index", "middle", "ring", "pinky", "little", "gripper", "claw", "jaw"}
"""Names of fingers and grippers, which are neither legs nor heads."""
ARM_WORDS = ELBOW_WORDS | GRASP_WORDS | {"arm", "shoulder", "upperarm", "humerus", "wrist", "hand"}
_LEG_WORDS = KNEE_WORDS | {"leg", "hip", "thigh", "femur", "ankle", "foot", "toe"}
MEETING = 0.25
"""Axes that pass a joint's centre within this share of the limb segment belong to that joint; a knee is farther under
its hip. Of eight robots half loses the G1's hands and moves ToddlerBot's hips by 12 mm, and double moves shoulders of
the CMU humanoid by 20 mm."""
CANTED = 0.5
"""A hip flexion axis has at least this cosine with the hip line; robots cant it by up to 45°."""
ONE_PLACE = 0.1
"""Places nearer than this share of a limb or sole are the same: mirrored hinge lines and ends, heights at which limbs
start or end, the middle of a sole and its ankle [-]. Half and double recognise the same in eight robots."""
SOLE = 0.01
"""Points of a foot within this height above its lowest one belong to the sole [m]: half moves the toes of the robot
Berkeley Humanoid by 4 mm, and double by 6 mm."""
HAND_SHARE = 0.8
"""Without a wrist joint the wrist is put at this share of the way from the elbow to the end of the arm: half moves the
hands of the OP3 by 6 cm."""


@dataclass(frozen=True)
class Chain:
    """One limb: the links from its first hinge to its end, and the hinges between."""

    links: tuple[int, ...]
    axes: tuple[Axis, ...]
    end: Floats
    """The middle of the last link's extent. (3,)"""
    tip: Floats
    """Points of the last link's extent, without a held object. (P, 3)"""

    @property
    def start(self) -> Floats:
        return self.axes[0].anchor

    @property
    def reach(self) -> float:
        return float(np.linalg.norm(self.end - self.start))


@dataclass(frozen=True)
class MirroredLimbs:
    """Two limbs that mirror each other, and the link that carries both."""

    carrier: int
    chains: tuple[Chain, Chain]
    miss: float
    """By how much they miss mirroring each other, as a share of the limb."""

    @property
    def lateral(self) -> Floats:
        """Horizontal unit vector from the second chain to the first. (3,)"""
        return _horizontal(self.chains[0].end - self.chains[1].end)

    @property
    def links(self) -> set[int]:
        """Of both limbs."""
        return {link for chain in self.chains for link in chain.links}

    @property
    def limbs(self) -> tuple[int, ...]:
        """The links that both begin with."""
        return tuple(chain.links[0] for chain in self.chains)

    @property
    def height(self) -> float:
        """Where the limbs begin [m]."""
        return float((self.chains[0].start[2] + self.chains[1].start[2]) / 2)

    @property
    def lowest(self) -> float:
        return float(min(c.end[2] for c in self.chains))

    def called(self, links: Links) -> int:
        """Return +1 for limbs with arm names, −1 for leg names, 0 without either."""
        texts = [words(links.words(link)) for link in self.links]
        return int(np.sign(sum(bool(text & ARM_WORDS) - bool(text & _LEG_WORDS) for text in texts)))


def mirrored_pairs(links: Links) -> list[MirroredLimbs]:
    """Every pair of leaves whose chains mirror each other in a vertical plane, other than the fingers of one hand."""
    pairs = []
    for a, b in itertools.combinations(links.leaves, 2):
        path_a, path_b = links.path(a), links.path(b)
        shared = sum(x == y for x, y in zip(path_a, path_b, strict=False))
        pair = _mirrored(links, path_a[shared - 1], (path_a[shared:], path_b[shared:]))
        if pair is not None and not any(grasps(links, limb) for limb in pair.limbs):
            pairs.append(pair)
    return pairs


def _mirrored(links: Links, carrier: int, tails: tuple[list[int], list[int]]) -> MirroredLimbs | None:
    """Return two chains that mirror each other; each ends in the middle of its extent.

    Some models use shapes drawn for one side on both sides. To find such pairs by their hinges, the chains then end at
    the lateral position of their last links' origins. A hand that holds something ends where the other one does, mirrored.
    """
    axes = [tuple(links.axes_along(tail)) for tail in tails]
    if len(axes[0]) != len(axes[1]) or len(axes[0]) < 2:
        return None
    origins = np.array([links.origin(tail[-1]) for tail in tails])
    tips = [links.extent(tail[-1]) for tail in tails]
    middles = np.array([box_middle(tip) for tip in tips])
    lateral = _horizontal(origins[0] - origins[1])
    bare = int(np.linalg.norm(middles[1] - origins[1]) < np.linalg.norm(middles[0] - origins[0]))
    image = tips[bare] - 2 * ((tips[bare] - origins.mean(axis=0)) @ lateral)[:, None] * lateral
    freed = [image, tips[1]] if bare else [tips[0], image]
    for ends, clouds in (
        (middles, tips),
        (middles - ((middles - origins) @ lateral)[:, None] * lateral, tips),
        ([box_middle(cloud) for cloud in freed], freed),
    ):
        one, other = (Chain(tuple(t), a, *end) for t, a, *end in zip(tails, axes, ends, clouds, strict=True))
        miss = _miss(one, other)
        if miss < ONE_PLACE:
            return MirroredLimbs(carrier, (one, other), miss)
    return None


def box_middle(cloud: Floats) -> Floats:
    """(3,) of the box around points (N, 3)."""
    return (cloud.min(0) + cloud.max(0)) / 2


def _miss(one: Chain, other: Chain) -> float:
    """How far hinge lines and ends are from those of the other chain when mirrored in the vertical plane between the ends."""
    apart, between = one.end - other.end, (one.end + other.end) / 2
    lateral = _horizontal(apart)
    lines = [
        b.distance(a.anchor - 2 * lateral * (lateral @ (a.anchor - between)))
        for a, b in zip(one.axes, other.axes, strict=True)
    ]
    return max(float(np.linalg.norm(apart - lateral * (apart @ lateral))), *lines) / max(one.reach, other.reach, 1e-9)


def _horizontal(vector: Floats) -> Floats:
    flat = np.array([vector[0], vector[1], 0.0])
    return flat / max(float(np.linalg.norm(flat)), 1e-12)


@dataclass(frozen=True)
class Centre:
    """A joint's centre, the link it is fixed to, and why it is believed to be there."""

    point: Floats
    link: int
    evidence: str
    confidence: float


def leg_centres(links: Links, chain: Chain, lateral: Floats) -> dict[str, Centre]:
    """Hip, knee and ankle of a leg, from its flexion axes: the hinges that are parallel to the hip line.

    Nothing where the knee is not under the hip: a robot that lies or stands on its head.

    Args:
        chain: the limb.
        lateral: (3,) unit vector along the hip line.
    """
    flexions = _flexions(chain, lateral)
    if len(flexions) < 2:
        return {}
    hip_axis, knee_axis = flexions[:2]
    named = [a for a in chain.axes if is_named(links, a, KNEE_WORDS)]
    evidence, confidence = "second flexion axis of the leg", LIKELY
    if named:
        evidence, confidence = (f"{evidence}, and by name", SURE) if knee_axis in named else ("by name", LIKELY)
        knee_axis = knee_axis if knee_axis in named else named[0]
    later = [a for a in flexions if chain.axes.index(a) > chain.axes.index(knee_axis)]
    ankle = _ankle(links, chain, later[0] if later else None, knee_axis)
    knee = _bend(chain, knee_axis, ankle.point)
    beside = _bend(chain, hip_axis, hip_axis.at_coordinate(knee, lateral))
    thigh = beside - knee
    if thigh[2] <= MEETING * np.linalg.norm(thigh):
        return {}
    hip = _hip(links, chain, hip_axis, beside, knee)
    return {"hip": hip, "knee": Centre(knee, knee_axis.link, evidence, confidence), "ankle": ankle}


def _bend(chain: Chain, axis: Axis, near: Floats) -> Floats:
    """The point (3,) of a bending axis where the other hinges of its link cross it, else the one nearest to `near` (3,)."""
    return axis.nearest(meeting_point([a for a in chain.axes if a.link == axis.link], near))


def _flexions(chain: Chain, lateral: Floats) -> list[Axis]:
    """The axes that flex a leg: those parallel to the hip line, after the axis of a hip whose flexion axis is canted."""
    along = [abs(float(a.direction @ lateral)) for a in chain.axes]
    parallel = [a for a, cosine in zip(chain.axes, along, strict=True) if cosine > ALIGNED]
    if not parallel:
        return []
    before = chain.axes.index(parallel[0])
    above = [k for k in range(before) if chain.axes[k].anchor[2] > parallel[0].anchor[2] + MEETING * chain.reach]
    hip = max(above, key=along.__getitem__, default=None)
    return parallel if hip is None or along[hip] < CANTED else [chain.axes[hip], *parallel]


def foot_links(links: Links, legs: MirroredLimbs) -> list[int]:
    """The links that carry the ankles of both legs."""
    found = [leg_centres(links, chain, legs.lateral).get("ankle") for chain in legs.chains]
    return [ankle.link for ankle in found if ankle is not None]


def _ankle(links: Links, chain: Chain, pitch: Axis | None, knee: Axis) -> Centre:
    """Where the ankle's axes meet, or the point of its one axis above the middle of the foot."""
    if pitch is None:
        low = links.surface(knee.link)
        return Centre(sole_cloud(low).mean(0), knee.link, "end of the shin, no ankle joint", GUESSED)
    shin = float(np.linalg.norm(pitch.anchor - knee.anchor))
    beyond = chain.axes[chain.axes.index(pitch) + 1 :]
    after = [
        pitch,
        *itertools.takewhile(lambda a: a.link == pitch.link or not _has_parallel(links, a.link, pitch), beyond),
    ]
    before = [
        a for a in _before(chain, pitch) if a.distance(pitch.anchor) < MEETING * shin and not _twists(a, knee, pitch)
    ]
    near = [a for a in [*before, *after] if a.link in links.path(after[-1].link)]
    foot = near[-1].link
    sole = links.surface(foot)
    point = meeting_point([a for a in near if a is pitch or abs(a.direction @ pitch.direction) < ALIGNED], sole.mean(0))
    return Centre(point, foot, f"axes of {' and '.join(joint_names(links, near))} meet here", SURE)


def _has_parallel(links: Links, link: int, axis: Axis) -> bool:
    """Whether a link turns about a line parallel to an axis, as toes do to the ankle's."""
    return any(abs(a.direction @ axis.direction) > ALIGNED for a in links.axes[link])


def _before(chain: Chain, pitch: Axis) -> list[Axis]:
    index = chain.axes.index(pitch)
    return list(chain.axes[max(0, index - 1) : index])


def _twists(axis: Axis, start: Axis, end: Axis) -> bool:
    limb = end.anchor - start.anchor
    return bool(abs(axis.direction @ limb) > ALIGNED * np.linalg.norm(limb))


def _hip(links: Links, chain: Chain, flexion: Axis, point: Floats, knee: Floats) -> Centre:
    """Return the hip: `point` on the flexion axis, moved to the intersection with other close hip axes."""
    thigh = knee - point
    length = float(np.linalg.norm(thigh))
    upper = [
        a
        for a in chain.axes
        if a.anchor[2] > knee[2] + MEETING * length and abs(a.direction @ thigh) < ALIGNED * length
    ]
    meeting = [a for a in chain.axes if a is flexion or (a in upper and a.distance(point) < MEETING * length)]
    centre = meeting_point(meeting, point)
    return Centre(centre, meeting[0].link, f"axes of {' and '.join(joint_names(links, meeting))} meet here", SURE)


def toe_centre(standing: Links, foot: int, surface: Floats, ankle: Floats, forward: Floats) -> Centre:
    """The joint of the toes, or the front edge of the sole of a foot's `surface` (P, 3); the robot stands.

    Args:
        foot: link of the foot.
        surface: (P, 3) points of the foot [m].
        ankle: (3,) [m].
        forward: (3,) unit vector.
    """
    children = [axis for child in standing.children[foot] for axis in standing.axes[child]]
    hinged = [axis for axis in children if abs(axis.direction @ forward) < ALIGNED]
    if hinged:
        return Centre(hinged[0].nearest(ankle), foot, "toe joint", SURE)
    sole = sole_cloud(surface)
    low = ankle * [1, 1, 0] + [0, 0, (sole.min(0) + sole.max(0))[2] / 2]
    point = low + forward * (sole @ forward - low @ forward).max()
    return Centre(point, foot, "front edge of the sole", SURE)


def sole_cloud(surface: Floats) -> Floats:
    """The points of a foot's surface (P, 3), seen or felt, that stand on the floor."""
    return surface[surface[:, 2] < surface[:, 2].min() + SOLE]


def arm_centres(links: Links, chain: Chain) -> dict[str, Centre]:
    """Shoulder, elbow and hand of an arm.

    Args:
        chain: the limb.
    """
    elbow_axis, evidence, confidence = _elbow_axis(links, chain)
    if elbow_axis is None:
        return {}
    before = list(chain.axes[: chain.axes.index(elbow_axis)])
    above = [a for a in before if a.link != elbow_axis.link]  # a ball joint has three hinges at the elbow
    shoulder = _shoulder(links, above or before, elbow_axis)
    elbow = _bend(chain, elbow_axis, shoulder.point)
    hand = _hand(links, _to_the_palm(links, chain, elbow_axis.link), elbow_axis, elbow)
    return {"shoulder": shoulder, "elbow": Centre(elbow, elbow_axis.link, evidence, confidence), "hand": hand}


def _elbow_axis(links: Links, chain: Chain) -> tuple[Axis | None, str, float]:
    """The hinge that bends the arm: by name, else the crosswise one nearest to the middle of the arm; not that of a gripper."""
    later = [a for a in chain.axes[1:] if not grasps(links, a.link)] or list(chain.axes[1:])
    if not later:
        return None, "", 0.0
    limb = (chain.end - chain.start) / max(chain.reach, 1e-9)

    def crosswise(axis: Axis) -> float:
        onward = chain.end - axis.anchor
        return float(1 - abs(axis.direction @ onward) / max(float(np.linalg.norm(onward)), 1e-9))

    def middling(axis: Axis) -> float:
        share = float((axis.anchor - chain.start) @ limb) / max(chain.reach, 1e-9)
        return float(min(share, 1 - share))

    named = [a for a in later if is_named(links, a, ELBOW_WORDS)]
    if named:
        best = max(named, key=crosswise)
        return best, "by name, and it bends the arm", SURE
    apart = [a for a in later if a.distance(chain.start) > MEETING * chain.reach]  # others belong to the shoulder
    bending = [a for a in apart if crosswise(a) > 1 - ALIGNED] or apart or later
    return max(bending, key=middling), "the bending axis nearest to the middle of the arm", LIKELY


def _shoulder(links: Links, axes: list[Axis], elbow: Axis) -> Centre:
    """Where the axes before the elbow meet, counted back from the elbow; a clavicle's stay out."""
    upper = float(np.linalg.norm(elbow.anchor - axes[-1].anchor)) or 1.0
    upper = max(upper, 0.5 * float(np.linalg.norm(elbow.anchor - axes[0].anchor)))
    taken = [axes[-1]]
    for axis in reversed(axes[:-1]):
        centre = meeting_point([axis, *taken], axis.anchor)
        if max(a.distance(centre) for a in [axis, *taken]) > MEETING * upper:
            break
        taken.insert(0, axis)
    if len(taken) > 2 and _twists(taken[-1], taken[0], elbow):
        taken = taken[:-1]
    point = taken[-1].nearest(meeting_point(taken, taken[0].anchor))  # so that the upper arm keeps its length
    return Centre(point, taken[-1].link, f"axes of {' and '.join(joint_names(links, taken))} meet here", SURE)


def _to_the_palm(links: Links, chain: Chain, elbow: int) -> Chain:
    """Return the chain without its finger: a link beyond the elbow with two sibling chains or a finger's name."""
    first = chain.links.index(elbow) + 1
    for count, link in enumerate(chain.links[first:], first):
        palm = chain.links[count - 1]
        if len(links.children[palm]) > 2 or grasps(links, link):
            own = chain.links[:count]
            tip = links.extent(palm)
            return Chain(own, tuple(axis for axis in chain.axes if axis.link in own), box_middle(tip), tip)
    return chain


def _hand(links: Links, chain: Chain, bend: Axis, elbow: Floats) -> Centre:
    """Return the wrist, if there are wrist axes, else a point four fifths of the way to the end of the arm."""
    axes = chain.axes[chain.axes.index(bend) + 1 :]
    whole = float(np.linalg.norm(chain.end - elbow))
    limb = (chain.end - elbow) / max(whole, 1e-9)
    wrists = [a for a in axes if abs(a.direction @ limb) < ALIGNED and (a.anchor - elbow) @ limb > whole / 2]
    if wrists:
        first = wrists[0].anchor
        wrists = [a for a in wrists if np.linalg.norm(a.anchor - first) < MEETING * whole][:2]
        point = meeting_point(wrists, elbow + limb * ((first - elbow) @ limb))
        return Centre(point, wrists[-1].link, f"wrist of {' and '.join(joint_names(links, wrists))}", SURE)
    along = (chain.tip - elbow) @ limb
    return Centre(
        elbow + limb * HAND_SHARE * along.max(), chain.links[-1], "end of the forearm, no wrist joint", LIKELY
    )


def joint_names(links: Links, axes: list[Axis]) -> list[str]:
    return [links.model.joint(a.joint).name for a in axes]


def is_named(links: Links, axis: Axis, vocabulary: set[str]) -> bool:
    """Whether the hinge, or the body it carries when the hinge itself says nothing, is called one of the words.

    Args:
        axis: the hinge.
        vocabulary: words in lower case.
    """
    return bool(words(links.model.joint(axis.joint).name) & vocabulary) or bool(
        words(links.model.body(axis.link).name) & vocabulary and len(links.axes[axis.link]) == 1
    )


def grasps(links: Links, link: int) -> bool:
    """Whether a link is a finger or part of a gripper, by its own name; a forearm may carry one."""
    return bool(words(links.words(link, fixed=False)) & GRASP_WORDS)


def words(name: str) -> set[str]:
    """Return the words of a name: split at case changes, digits and signs; also without a leading side letter."""
    parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)
    low = {p.lower() for p in parts}
    joined = {"".join(p.lower() for p in parts[i : i + 2]) for i in range(len(parts) - 1)}
    bare = {w[1:] for w in low if len(w) > 3 and w[0] in "lr"}
    trailing = {w[:-2] for w in low | bare if re.fullmatch(r"[a-z]+r[xyz]", w)}
    return low | joined | bare | trailing | {t[1:] for t in trailing if t and t[0] in "lr"}
