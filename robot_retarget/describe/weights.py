"""How much each kind of edge counts."""

from dataclasses import dataclass, field, fields, replace

from robot_retarget.errors import UsageError, known

FAVOURS = {"directions": 0.2, "balanced": 1.0, "distances": 5.0}
"""What distances between keypoints count, over what they count in the balanced blend [-]."""


@dataclass(frozen=True)
class Weights:
    """π of every kind, checked; one set for all clips and robots. Errors are dimensionless: over a path, a leg, or of unit vectors."""

    near: float = 56.0
    """Distances between keypoints that are near each other, over the path between them ..."""
    far: float = 17.0
    """... and of those that are far; all of a frame together, over the number of keypoints."""
    reach: float = 0.35
    """Two keypoints at this share of the path between them are half near [-]."""
    give: float = 0.028
    """Errors of distances well over this count linearly, those under it by their square [-]."""
    touch: float = 2000.0
    """A hand and what it touches, a foot and the other, on top of their distance."""
    bones: dict[str, float] = field(
        default_factory=lambda: {
            "knee": 8.0,
            "ankle": 8.0,
            "chest": 3.2,
            "elbow": 2.0,
            "hand": 2.0,
            "toe": 0.64,
            "neck": 0.24,
            "head": 0.24,
        }
    )
    """Directions of the bones that end in a keypoint; clavicles and hip bones only mirror how a body is built."""
    hips: float = 20.0
    """Direction of the hip line: which way the body faces."""
    shoulders: float = 3.0
    """Direction of the shoulder line."""
    orientation: float = 0.3
    """Forward and up of pelvis, chest, head and hands ..."""
    foot: float = 0.1
    """... and of feet."""
    path: float = 4.0
    """The pelvis on its path, over the leg."""
    rest: float = 0.0004
    """Joints as the robot stands [1/rad²] ..."""
    wrist: float = 0.1
    """... and wrists, where nothing shows how a hand is turned [1/rad²]."""
    swing: float = 4.0
    """A swing foot on its reference, over the leg ..."""
    landing: float = 40.0
    """... and next to its stances."""
    smooth: float = 20.0
    """Squared second differences of the joints at 30 frames a second [1/rad²]."""
    smooth_root: float = 10.0
    """How much more the root's count, per rad² and per m² [-]."""

    interaction: float = 0.0
    """Links that near each other, over the squared leg; 0 for none, 1 lowers false alarms of warnings [-]."""

    def __post_init__(self) -> None:
        for name, value in (*self._numbers(), *((f"bones[{bone!r}]", w) for bone, w in self.bones.items())):
            positive = name in ("reach", "give")
            if not (value > 0 if positive else value >= 0) or value == float("inf"):
                raise UsageError(
                    f"Weights.{name} must be a number {'above 0' if positive else 'of 0 or more'}, got {value}"
                )

    def _numbers(self) -> list[tuple[str, float]]:
        return [(f.name, getattr(self, f.name)) for f in fields(self) if f.name != "bones"]

    def favouring(self, what: str) -> "Weights":
        """The weights with distances between keypoints weighed by `FAVOURS`.

        `directions` keeps limbs as the human's point, `distances` keeps parts as near each other, `balanced` changes nothing.

        Raises:
            UsageError: it is none of these.
        """
        if what not in FAVOURS:
            raise UsageError(f"nothing to favour is called {what!r}; {known(FAVOURS, typed=what)}")
        return replace(self, near=FAVOURS[what] * self.near, far=FAVOURS[what] * self.far)
