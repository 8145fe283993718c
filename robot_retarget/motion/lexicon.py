"""What the names of joints say: a side and a part of the body, each with a weight, never the last word.

`LeftLeg` is the knee for one exporter and the hip for another, `LeftShoulder` a clavicle or an upper arm: a name speaks
for several parts, and tree and geometry decide between them.
"""

import re
from dataclasses import dataclass, field

_LEFT = {"left", "l", "lft", "lt", "links", "linke", "gauche", "izquierda", "izq", "sinistra", "左"}
_RIGHT = {"right", "r", "rgt", "rt", "rechts", "rechte", "droite", "derecha", "der", "destra", "右"}

# The first line whose pattern is found in the name speaks.
_PARTS: tuple[tuple[str, dict[str, float]], ...] = tuple(
    (pattern, dict(parts))
    for pattern, parts in (
        (r"twist|roll|helper|hipjoint|buttock|metatars", {"helper": 1.0}),
        (r"thumb|index|middle|ring|pinky|little|finger|carpal|daumen|doigt|dedo|指", {"finger": 1.0}),
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
class Sense:
    """What one name says."""

    side: str = ""
    """`l`, `r` or nothing."""
    parts: dict[str, float] = field(default_factory=dict)
    """Weight in 0 … 1 of every part of the body the name may mean."""
    tip: bool = False
    """The name is that of an end, not of a joint."""

    def agreement(self, part: str) -> float:
        """The weight of `part`; −0.5 where the name speaks of other parts only, 0 where it says nothing."""
        return self.parts.get(part, -0.5 if self.parts else 0.0)


def sense(name: str) -> Sense:
    """What a joint's name says, whatever its prefix, case or separators."""
    bare = re.split(r"[:|]", name)[-1]
    pieces = [piece for run in _PIECE.findall(_split_ideographs(bare)) for piece in _without_side_prefix(run)]
    lower = [piece.lower() for piece in pieces if not piece.isdigit()]
    side = next(("l" if piece in _LEFT else "r" for piece in lower if piece in _LEFT | _RIGHT), "")
    rest = "".join(piece for piece in lower if piece not in _LEFT | _RIGHT)
    parts = next((parts for pattern, parts in _PARTS if re.search(pattern, rest)), {})
    return Sense(side, parts, bool(_TIP.search(rest)))


def _split_ideographs(name: str) -> str:
    return re.sub(r"([左右])", r" \1 ", name)


def _without_side_prefix(piece: str) -> list[str]:
    """`lhand` → `l`, `hand`: a side letter glued to a word the table knows from its first letter on."""
    rest = piece[1:].lower()
    known = len(rest) > 2 and any(re.match(pattern, rest) for pattern, _ in _PARTS)
    whole = any(re.match(pattern, piece.lower()) for pattern, _ in _PARTS)
    return [piece[0], piece[1:]] if piece[0] in "lrLR" and known and not whole else [piece]
