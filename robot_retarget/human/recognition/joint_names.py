"""Evidence in the names of joints: a side and parts of the body, each with a weight.

`LeftLeg` is the knee for one exporter and the hip for another, `LeftShoulder` a clavicle or an upper arm: a name speaks
for several parts, and tree and geometry decide between them.
"""

import re
import unicodedata
from dataclasses import dataclass, field

_SIDES = {
    "l": {"left", "l", "lft", "lt", "links", "linke", "linker", "linkes", "gauche", "izquierda", "sinistra", "左"},
    "r": {"right", "r", "rgt", "rt", "rechts", "rechte", "rechter", "rechtes", "droite", "derecha", "destra", "右"},
}
_SIDE_OF = {word: side for side, words in _SIDES.items() for word in words}
_GLUED_SIDE = re.compile(r"(left|right|[lr])(.{3,})", re.IGNORECASE)

# The first line whose pattern is found in the name speaks.
_PARTS: tuple[tuple[str, dict[str, float]], ...] = tuple(
    (pattern, dict(parts))
    for pattern, parts in (
        (r"twist|roll|helper|hipjoint|buttock|metatars", {"helper": 1.0}),
        (r"thumb|index|middle|ring|pinky|little|finger|carpal|daumen|doigt|dedo|指", {"finger": 1.0}),
        (r"heel|calcan|ferse|talon", {"heel": 1.0}),
        (r"toe|ball|zehe|orteil|つま先", {"toe": 1.0}),
        (r"eye|jaw|ear$|tongue|hair|brow|lip|breast|weapon|prop|skirt|cloth", {"other": 1.0}),
        (r"tail|schwanz|wing", {"tail": 1.0}),
        (r"upleg|upperleg|thigh|femur|oberschenkel|cuisse|muslo", {"hip": 1.0}),
        (r"lowleg|lowerleg|loleg|shin|calf|tibia|knee|knie|unterschenkel|genou|rodilla|ひざ", {"knee": 1.0}),
        (r"forearm|lowarm|lowerarm|loarm|elbow|radius|ulna|unterarm|ellbogen|coude|codo|ひじ", {"elbow": 1.0}),
        (r"collar|clav|schluesselbein|schlüsselbein", {"clavicle": 1.0}),
        (r"uparm|upperarm|shldr|humerus|oberarm|腕", {"shoulder": 1.0}),
        (r"shoulder|schulter|epaule|épaule|hombro|肩", {"shoulder": 0.6, "clavicle": 0.6}),
        (r"wrist|handgelenk|poignet|muñeca|手首", {"hand": 1.0}),
        (r"hand|main$|mano", {"hand": 0.9}),
        (r"ankle|knöchel|cheville|tobillo|足首", {"ankle": 1.0}),
        (r"foot|fuß|fuss|pied|^pie$", {"ankle": 0.8, "toe": 0.4}),
        (r"leg|bein|jambe|pierna|足", {"hip": 0.6, "knee": 0.7}),
        (r"arm|bras|brazo", {"shoulder": 0.8}),
        (r"neck|hals|^cou$|cuello|首", {"neck": 1.0}),
        (r"head|kopf|tête|tete|cabeza|skull|頭", {"head": 1.0}),
        (r"pelvis|becken|bassin|下半身", {"pelvis": 1.0}),
        (r"hip|hüfte|huefte|hanche|cadera", {"hip": 0.8, "pelvis": 0.5}),
        (r"chest|thorax|torso|spine|brust|poitrine|pecho|abdomen|back|上半身", {"spine": 1.0}),
    )
)
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
    parts = next((parts for pattern, parts in _PARTS if re.search(pattern, rest)), {})
    return NameEvidence(side, parts, bool(_TIP.search(rest)))


def _unglued(piece: str) -> tuple[str, ...]:
    """`lhand` → `l`, `hand`: a side glued to a word that the table knows from its first letter on."""
    glued = _GLUED_SIDE.fullmatch(piece)
    if glued is None or _starts_a_part(piece) or not _starts_a_part(glued.group(2)):
        return (piece,)
    return glued.groups()


def _starts_a_part(word: str) -> bool:
    return any(re.match(pattern, word.lower()) for pattern, _ in _PARTS)
