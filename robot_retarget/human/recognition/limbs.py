"""Limbs of an unknown skeleton: pairs of chains with candidates for hip–knee–ankle or shoulder–elbow–wrist.

Two long rigid bones one after the other, about as long as each other, the same on both sides: that is an arm or a leg
in any unit, any axes and any language. Every choice of three joints on a chain gets a score (a log-likelihood up to a
constant); names add to it.
"""

import re
import tomllib
import unicodedata
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, Ints, unit
from robot_retarget.human.skeleton import Skeleton

# Evidence in the names of joints: a side and parts of the body, each with a weight.
#
# `LeftLeg` is the knee for one exporter and the hip for another, `LeftShoulder` a clavicle or an upper arm: a name speaks
# for several parts, and tree and geometry decide between them.

WORDS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("joint_names.toml").read_text(encoding="utf-8"))
_SIDE_OF = {word: side for side, words in WORDS["sides"].items() for word in words}
_GLUED_SIDE = re.compile(r"(left|right|[lr])(.{3,})", re.IGNORECASE)

_PARTS: dict[str, dict[str, float]] = WORDS["parts"]
"""The first pattern that is found in a name counts."""
_TIP = re.compile(r"end|nub|top|tip|site")
_PIECE = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|\d+")


@dataclass(frozen=True)
class NameEvidence:
    """The evidence in one name."""

    side: str = ""
    """`l`, `r` or nothing."""
    parts: dict[str, float] = field(default_factory=dict)
    """Weight in 0 … 1 of every part of the body the name may mean."""
    tip: bool = False
    """The name is that of an end, not of a joint."""

    def agreement(self, part: str) -> float:
        """The weight of `part`; −0.5 where the name speaks of other parts only, 0 where it says nothing."""
        return self.parts.get(part, -0.5 if self.parts else 0.0)


def name_evidence(name: str) -> NameEvidence:
    """Parse a joint's name of any prefix, case and separators."""
    bare = re.sub(r"([左右])", r" \1 ", re.split(r"[:|]", unicodedata.normalize("NFKC", name))[-1])
    words = [word.lower() for run in _PIECE.findall(bare) for word in _unglued(run) if not word.isdigit()]
    side = next((_SIDE_OF[word] for word in words if word in _SIDE_OF), "")
    rest = "".join(word for word in words if word not in _SIDE_OF)
    parts = next((parts for pattern, parts in _PARTS.items() if re.search(pattern, rest)), {})
    return NameEvidence(side, parts, bool(_TIP.search(rest)))


def _unglued(piece: str) -> tuple[str, ...]:
    """`lhand` → `l`, `hand`: a side glued to a word that the table knows from its first letter on."""
    glued = _GLUED_SIDE.fullmatch(piece)
    if glued is None or _starts_a_part(piece) or not _starts_a_part(glued.group(2)):
        return (piece,)
    return glued.groups()


def _starts_a_part(word: str) -> bool:
    return any(re.match(pattern, word.lower()) for pattern in _PARTS)


FRAMES = 120
"""Frames looked at, spread over the clip. Half and double recognise clips of 13 exporters alike."""

LIMBS = {"arm": ("shoulder", "elbow", "hand"), "leg": ("hip", "knee", "ankle")}
_RATIO = {"arm": 1.17, "leg": 1.0}
"""Upper over lower bone: the medians of 14 exporters (0.9 to 1.5 and 0.8 to 1.4)."""
_ARM_TO_LEG = 0.61
"""Shoulder to wrist over hip to ankle: the median of the same 14 (0.47 to 0.68)."""
_LONGEST_CHAIN = 32
"""Joints of a chain that can be a limb, with the spine before it and a finger behind it; longer chains are ropes or
hair. Half and double recognise the same joints in 21 clips."""
_REACHING = 1.5
"""Weight of the logarithm of the share of the chain that the limb reaches over [-]. Half and double recognise clips of 13
exporters alike."""
_ODD = -8.0
"""Score of odd proportions, however odd; names that agree raise it. Half loses one of 13 exporters, double none."""
_SPREAD = 0.25
"""Standard deviation of both ratios, of their logarithms [-]. Half and double recognise clips of 13 exporters alike."""
SAME = 0.04
"""Joints nearer than this share of a limb are at one place [-]. Half recognises 13 exporters alike, double changes two of
them."""
UNDER = 0.8
"""An end site less than this off the line of the shin is under the ankle, no toe [rad]: 0.02 to 0.43 in two exporters, 1.2 to 1.6 in
those whose end sites are toes."""
SHORT_CHAIN = 0.2
"""Chains shorter than this share of a limb are no limb, no head on a trunk, and no hand below a wrist [-]: half and
double recognise the same joints in 21 clips."""
_BOTH = 4.0
"""Score of a body for having arms in addition to legs. Half and double recognise clips of 13 exporters alike."""


@dataclass(frozen=True)
class PosedSkeleton:
    """A skeleton in its poses, with what recognition asks again and again."""

    skeleton: Skeleton
    positions: Floats
    """(F, J, 3) of some frames, in any unit and axes."""
    children: tuple[tuple[int, ...], ...]
    bones: Floats
    """(J,) median distance from the parent, 0 at a root."""
    stretch: float
    """Deviations of the lengths of bones over the sum of these lengths: 0 for a rigid skeleton, 0.05 from a depth camera [-]."""
    reach: Floats
    """(J,) longest path of bones below a joint."""
    evidence: tuple[NameEvidence, ...]

    @classmethod
    def of(cls, skeleton: Skeleton, positions: Floats) -> "PosedSkeleton":
        picked = np.unique(np.linspace(0, len(positions) - 1, FRAMES).round().astype(int))
        poses = np.asarray(positions, dtype=float)[picked]
        parents = skeleton.parents
        apart = np.linalg.norm(poses - poses[:, np.maximum(parents, 0)], axis=2)
        bones = np.where(parents < 0, 0.0, np.median(apart, axis=0))
        stretch = float(apart.std(axis=0)[parents >= 0].sum() / max(bones.sum(), 1e-12))
        children: list[list[int]] = [[] for _ in parents]
        reach = np.zeros(len(parents))
        for joint in range(len(parents) - 1, -1, -1):
            if (parent := parents[joint]) >= 0:
                children[parent].insert(0, joint)
                reach[parent] = max(reach[parent], bones[joint] + reach[joint])
        return cls(
            skeleton,
            poses,
            tuple(map(tuple, children)),
            bones,
            stretch,
            reach,
            tuple(map(name_evidence, skeleton.names)),
        )

    def branch(self, joint: int) -> float:
        """Longest path of bones from a joint's parent down through it."""
        return float(self.bones[joint] + self.reach[joint])

    def chain(self, joint: int) -> tuple[int, ...]:
        """From a joint down to its farthest descendant."""
        chain = [joint]
        while below := self.children[chain[-1]]:
            chain.append(max(below, key=self.branch))
        return tuple(chain)

    def toe(self, limb: "Limb") -> int | None:
        """The joint a foot rolls over: the first one below the ankle that stands apart from it, or the foot's end."""
        return (self.toes(limb) or [None])[0]

    def toes(self, limb: "Limb") -> list[int]:
        """The candidates for the toe, the likeliest first, without heels and joints straight below the ankle.

        Those are less than half as far off the line of the shin as another candidate. End sites that are all near that line
        show the sole under the ankle: such a foot has no toe.
        """
        below = [
            joint for joint in self._foot(limb.joints[2]) if self.distance(joint, limb.joints[2]) > SAME * limb.lower
        ]
        found = [joint for joint in below if "helper" not in self.evidence[joint].parts] or below
        off = [self._off_the_shin(limb, joint) for joint in found]
        if all(self.evidence[joint].tip for joint in found) and max(off, default=0.0) < UNDER:
            return []
        return [joint for joint, angle in zip(found, off, strict=True) if angle >= max(off) / 2]

    def _off_the_shin(self, limb: "Limb", joint: int) -> float:
        """Return the median angle between the shin and the way from the ankle to a joint [rad]."""
        _, knee, ankle = (self.positions[:, k] for k in limb.joints)
        along = (unit(ankle - knee) * unit(self.positions[:, joint] - ankle)).sum(axis=1)
        return float(np.median(np.arccos(along.clip(-1, 1))))

    def _foot(self, ankle: int) -> list[int]:
        """Return the joints of the longest branch below an ankle, from the top down, without heels."""
        chain, joint = [], ankle
        while below := [child for child in self.children[joint] if not self._only_heel(child)]:
            joint = max(below, key=self.branch)
            chain.append(joint)
        return [joint for joint in chain if "heel" not in self.evidence[joint].parts]

    def _only_heel(self, joint: int) -> bool:
        """Whether a joint and all below it are called heels."""
        return "heel" in self.evidence[joint].parts and all(map(self._only_heel, self.children[joint]))

    def at(self, pair: "LimbPair", which: int) -> Floats:
        """(F, 2, 3) of the first (0), middle (1) or last (2) joints of two limbs.

        Args:
            pair: two limbs.
            which: 0, 1 or 2.
        """
        return self.positions[:, [limb.joints[which] for limb in pair.sides]]

    def distance(self, a: int, b: int) -> float:
        """Median distance of two joints."""
        return float(np.median(np.linalg.norm(self.positions[:, a] - self.positions[:, b], axis=1)))


@dataclass(frozen=True)
class Limb:
    """Three joints of a chain, the joints below them, and their score."""

    joints: tuple[int, int, int]
    chain: tuple[int, ...]
    upper: float
    lower: float
    score: float
    lead: float = np.inf
    """Of the score over that of the best choice of three that has a joint elsewhere."""

    @property
    def length(self) -> float:
        return self.upper + self.lower


@dataclass(frozen=True)
class LimbPair:
    """Two limbs that hang from one joint."""

    hub: int
    sides: tuple[Limb, Limb]
    score: float

    @property
    def length(self) -> float:
        """Mean length of both limbs in the file's unit."""
        return (self.sides[0].length + self.sides[1].length) / 2

    @property
    def lead(self) -> float:
        """That of the less certain limb."""
        return min(limb.lead for limb in self.sides)

    @property
    def chains(self) -> set[int]:
        return set(self.sides[0].chain) | set(self.sides[1].chain)

    def below(self, body: PosedSkeleton) -> set[int]:
        """Every joint of the two branches, fingers and props too."""
        starts = {limb.chain[0] for limb in self.sides}
        return {joint for joint in range(len(body.children)) if starts & set(body.skeleton.above(joint))}


def find_limbs(body: PosedSkeleton) -> tuple[LimbPair | None, LimbPair | None]:
    """The best legs and arms; None for a missing pair."""
    chains = _side_by_side(body)
    legs, arms = (_pairs(body, chains, kind) for kind in ("leg", "arm"))
    options: list[tuple[float, LimbPair | None, LimbPair | None]] = [(leg.score, leg, None) for leg in legs]
    options += [
        (leg.score + arm.score + _BOTH + _relation(body, leg, arm), leg, arm)
        for leg in legs
        for arm in arms
        if not leg.chains & arm.chains and arm.hub not in leg.chains and leg.hub not in arm.chains
    ]
    _, leg, arm = max(options, key=lambda option: option[0], default=(0.0, None, None))
    return leg, arm


def _relation(body: PosedSkeleton, leg: LimbPair, arm: LimbPair) -> float:
    """Legs are longer than arms, and the head is at the arms' end of the trunk."""
    size = -0.5 * (np.log(arm.length / leg.length / _ARM_TO_LEG) / _SPREAD) ** 2
    return max(size, -12.0) + 2.0 * (_stump(body, arm, leg) - _stump(body, leg, arm))


def _stump(body: PosedSkeleton, pair: LimbPair, other: LimbPair) -> bool:
    """A third branch at the pair's hub, shorter than its limbs and not on the way to the other pair: a head."""
    way = set(body.skeleton.above(other.hub))
    return any(
        child not in pair.chains and child not in way and SHORT_CHAIN * pair.length < body.branch(child)
        for child in body.children[pair.hub]
    )


def _side_by_side(body: PosedSkeleton) -> list[tuple[int, "_Chain", "_Chain"]]:
    """Return the joints that two chains hang from, with the chains."""
    found, long = [], SHORT_CHAIN * _second_longest(body)
    for hub, children in enumerate(body.children):
        chains = [body.chain(child) for child in children if body.branch(child) > long]
        for left, right in combinations(chains, 2):
            if max(len(left), len(right)) <= _LONGEST_CHAIN:
                found.append((hub, _Chain.of(body, left, right), _Chain.of(body, right, left)))
    return found


def _second_longest(body: PosedSkeleton) -> float:
    """The longest branch with a longer sibling: an arm or a leg, also below wrappers of the skeleton's root."""
    beside = [sorted(map(body.branch, children))[-2] for children in body.children if len(children) > 1]
    return max(beside, default=0.0)


def _pairs(body: PosedSkeleton, chains: list[tuple[int, "_Chain", "_Chain"]], kind: str) -> list[LimbPair]:
    """Candidates for the legs or the arms, the best ones first."""
    pairs = []
    for hub, left, right in chains:
        one, two = (_fit(body, chain, kind) for chain in (left, right))
        if one is not None and two is not None:
            uneven = abs(np.log(one.upper / two.upper)) + abs(np.log(one.lower / two.lower))
            score = one.score + two.score - 6 * uneven + 0.5 * _opposite(body, one, two)
            pairs.append(LimbPair(hub, (one, two), float(score)))
    return sorted(pairs, key=lambda pair: -pair.score)[:6]


def _opposite(body: PosedSkeleton, one: Limb, two: Limb) -> int:
    """How many of the three joints are named after opposite sides, less those named after the same one."""
    sides = [(body.evidence[a].side, body.evidence[b].side) for a, b in zip(one.joints, two.joints, strict=True)]
    return sum((a != b) - (a == b) for a, b in sides if a and b)


def _fit(body: PosedSkeleton, chain: "_Chain", kind: str) -> Limb | None:
    """The three joints of a chain that make the best limb."""
    places, apart = _threes(len(chain.joints)), chain.apart
    a, b, c = places.T
    places = places[np.minimum(apart[a, b], apart[b, c]) >= SAME * chain.total]
    if not len(places):
        return None
    agreement, misnamed = _named(body, chain.joints, places, kind)
    scores = chain.scores(places, kind, agreement) + agreement - misnamed
    best = int(scores.argmax())
    chosen = places[best]
    upper, lower = apart[chosen[:2], chosen[1:]].tolist()
    elsewhere = apart[chosen, places].max(axis=1) > SAME * (upper + lower)
    first, middle, last = (chain.joints[place] for place in chosen)
    lead = float(scores[best] - scores[elsewhere].max(initial=-np.inf))
    return Limb((first, middle, last), chain.joints, upper, lower, float(scores[best]), lead)


@cache
def _threes(count: int) -> Ints:
    """Return (K, 3) all choices of three places in order among some."""
    return np.array(list(combinations(range(count), 3)), dtype=int).reshape(-1, 3)


def _named(body: PosedSkeleton, chain: tuple[int, ...], places: Ints, kind: str) -> tuple[Floats, Floats]:
    """Return (K,) how far the names of three joints agree with the parts of a limb, and the penalty of their names.

    The penalty is that of end joints, and of a clavicle, with a shoulder behind it, at the place of a shoulder.
    """
    names = [body.evidence[joint] for joint in chain]
    agreement = np.array([[name.agreement(part) for part in LIMBS[kind]] for name in names])
    tips, clavicles = (np.array(flags) for flags in zip(*((n.tip, "clavicle" in n.parts) for n in names), strict=True))
    called, (first, middle) = np.cumsum(agreement[:, 0] > 0), places[:, :2].T
    collarbones = clavicles[first] & (called[middle - 1] > called[first])
    return agreement[places, range(3)].sum(axis=1), tips[places].sum(axis=1) + 2.0 * collarbones


@dataclass(frozen=True)
class _Chain:
    """N joints below one another, with lengths along them in the unit of the body."""

    joints: tuple[int, ...]
    apart: Floats
    """(N, N) mean distances of joints."""
    spread: Floats
    """(N, N) deviations of these distances over the frames, beyond those of the body's bones on the whole."""
    bulges: Floats
    """(N, N) how far the joints between two others stand off their line, over its length."""
    below: Floats
    """(N,) lengths of the chain below a joint."""
    beside: Floats
    """(N,) distances to the nearest joint of the other chain."""
    total: float
    """Length of the limb: a sword in one hand makes that chain longer, not its arm."""

    @classmethod
    def of(cls, body: PosedSkeleton, chain: tuple[int, ...], other: tuple[int, ...]) -> "_Chain":
        points = body.positions[:, list(chain)]
        apart = np.linalg.norm(points[:, :, None] - points[:, None], axis=3)
        across = np.linalg.norm(points[:, :, None] - body.positions[:, None, list(other)], axis=3)
        below = np.append(np.cumsum(body.bones[list(chain)][:0:-1])[::-1], 0.0)
        mean, total = apart.mean(axis=0), min(below[0], body.branch(other[0]))
        spread = np.maximum(apart.std(axis=0) - body.stretch * mean, 0.0)
        return cls(chain, mean, spread, _bulges(mean), below, across.mean(axis=0).min(axis=1), float(total))

    def scores(self, places: Ints, kind: str, agreement: Floats) -> Floats:
        """Score (K,) two rigid straight bones of the usual ratio, from a joint off the other chain to a hand or foot on this one."""
        a, b, c = places.T
        upper, lower = self.apart[a, b], self.apart[b, c]
        return (
            _REACHING * np.minimum(0.0, np.log((upper + lower) / self.total))
            - 4 * (self.bulges[a, b] + self.bulges[b, c])
            - 20 * (self.spread[a, b] / upper + self.spread[b, c] / lower)
            - np.maximum(0.0, 1 - self.below[c] / (SHORT_CHAIN * lower))
            - 4 * (self.beside[a] < SAME * (upper + lower))
            + np.maximum(
                -0.5 * (np.log(upper / lower / _RATIO[kind]) / _SPREAD) ** 2, _ODD + 2.0 * np.maximum(agreement, 0.0)
            )
        )


def _bulges(mean: Floats) -> Floats:
    """(N, N) how far the joints between two others stand off their line, over its length (Heron's formula).

    Args:
        mean: (N, N) distances between the joints of a chain.
    """
    place = np.arange(len(mean))
    between = (place[:, None, None] < place) & (place < place[:, None])
    base, first, second = mean[:, :, None], mean[:, None, :], mean.T[None]
    s = (base + first + second) / 2
    squared = np.where(between, s * (s - base) * (s - first) * (s - second), 0.0)
    return 2 * np.sqrt(squared.max(axis=2, initial=0.0)) / np.maximum(mean**2, 1e-12)
