"""The weights of every kind of edge."""

from dataclasses import dataclass, field, fields, replace

from robot_retarget.base.choices import Preset
from robot_retarget.base.errors import UsageError, known
from robot_retarget.human.match import NEAR

BLEND = 5.0
"""Factor between two presets [-]: in 2 s of a dance on the G1 the limbs are off by 2.5, 3.7 and 6.0° from directions to
distances, and near distances by 0.040, 0.037 and 0.030."""
PRESETS: dict[Preset, dict[str, float]] = {
    "directions": {"near": 1 / BLEND, "far": 1 / BLEND},
    "balanced": {},
    "distances": {"near": BLEND, "far": BLEND},
}
"""Factors of weights, relative to the balanced blend [-]."""
LEG = 8.0
"""Directions of thigh and shin [-] (3.33, 3.19; 139, 147): figures in brackets as in `Weights`."""
ARM = 3.0
"""Directions of upper arm and forearm [-] (3.56, 2.98; 142, 144). With a larger weight hands miss their distances by more."""
NECK = 0.24
"""Directions of neck and head [-] (3.24, 3.27; 143, 142)."""
RAMP = 0.1
"""Touches and footholds gain and lose their priority within this time [s]: half and double change the jerk of the box
sample as a stream by less than 0.5 %."""
REFERENCE_FPS = 30.0
"""Frame rate at which `Weights.smooth` is given [1/s]: 30 frames a second, of most motion files."""


@dataclass(frozen=True)
class Weights:
    """π of every kind, checked; one set for all clips and robots. Errors are dimensionless: over a path, a leg, or of unit vectors.

    In brackets, with 1/1.5 and with 1.5 of a weight: the mean angle of the limbs to the human's [°] and, after a semicolon, the jerk of
    the joints [rad/s³], at the minima of ten clips on the G1. They are 3.25 and 143 with an `ARM` of 2, `near` of 60, `shoulders`
    of 3 and `jerk` of 24, around which all were measured; the four are chosen on 31 clips on the G1 and the OP3 together.
    """

    near: float = 75.0
    """Distances between nearby keypoints, over the path between them (3.17, 3.36; 142, 143) ..."""
    far: float = 17.0
    """... and between distant ones; the sum over a frame, over the number of keypoints (3.07, 3.50; 142, 144)."""
    reach: float = NEAR
    """Two keypoints at this share of the path between them are half near [-]."""
    huber_delta: float = 0.028
    """Errors of distances well above this count linearly, those below it by their square [-] (3.02, 3.46; 141, 144)."""
    touch: float = 2000.0
    """A hand and the part it touches, in addition to their distance (3.25, 3.26; 142, 143)."""
    bones: dict[str, float] = field(
        default_factory=lambda: {
            "knee": LEG,
            "ankle": LEG,
            "chest": 3.2,
            "elbow": ARM,
            "hand": ARM,
            "toe": 0.64,
            "neck": NECK,
            "head": NECK,
        }
    )
    """Directions of the bones that end in a keypoint; clavicles and hip bones only mirror how a body is built."""
    hips: float = 20.0
    """Direction of the hip line, which is the heading of the body (3.25, 3.25; 142, 143)."""
    shoulders: float = 4.5
    """Direction of the shoulder line (3.25, 3.27; 142, 143; the largest twist of the shoulders is 5.4 and 4.5°)."""
    orientation: float = 0.3
    """Forward and up of pelvis, chest, head and hands (3.24, 3.27; 142, 143) ..."""
    foot: float = 0.1
    """... and of feet."""
    path: float = 4.0
    """The pelvis on its path, over the leg (3.26, 3.25; 142, 143)."""
    rest: float = 0.0004
    """Joints as the robot stands [1/rad²] ..."""
    wrist: float = 0.1
    """... and wrists, if no marker shows the rotation of a hand [1/rad²] (in 2 s of a clap by positions 4.00 and
    4.00)."""
    swing: float = path
    """A swing foot at its reference, as the pelvis on its path."""
    smooth: float = 5.0
    """Squared second differences of the joints at `REFERENCE_FPS` [1/rad²] (3.24, 3.27; 145, 139) ..."""
    jerk: float = 26.0
    """... and third ones (3.24, 3.27; 153, 132)."""
    smooth_root: float = 120.0
    """Factor for the place of the root, in both: legs absorb what would accelerate the whole body [rad²/m²]. The root of three runs on
    the G1 has a jerk of 91 m/s³, with half and double 116 and 74 ..."""
    smooth_turn: float = 45.0
    """... and for its rotation, in second ones [-] (3.24, 3.26; 142, 143)."""
    inertia: float = 0.5
    """Inertia of hinges in streams, as a share of that of `RealTime.frequency` [-] (in streams of the two 10.0 and 11.0, and
    12.5 with this one; jerk 1650, 1280 and 1320 rad/s³) ..."""
    inertia_leg: float = 3.0
    """... of legs, whose directions weigh more: with less inertia they follow more of the noise [-] (12.4, 12.6; jerk 1570,
    1290) ..."""
    inertia_root: float = 5.0
    """... and of the root, per rad² and per m² [-] (12.5, 12.5; jerk 1540, 1300)."""

    def __post_init__(self) -> None:
        for name, value in (*self._numbers(), *((f"bones[{bone!r}]", w) for bone, w in self.bones.items())):
            positive = name in ("reach", "huber_delta")
            if not (value > 0 if positive else value >= 0) or value == float("inf"):
                raise UsageError(
                    f"Weights.{name} must be a number {'above 0' if positive else 'of 0 or more'}, got {value}"
                )

    def _numbers(self) -> list[tuple[str, float]]:
        return [(f.name, getattr(self, f.name)) for f in fields(self) if f.name != "bones"]

    def with_preset(self, preset: Preset) -> "Weights":
        """Multiply the weights by the factors of a preset.

        Args:
            preset: `directions` (of limbs, like the human's), `distances` (between parts, like the human's) or `balanced`
                (no change): a key of `PRESETS`.

        Returns:
            The weights; all other weights are unchanged.

        Raises:
            UsageError: the preset is unknown.
        """
        if preset not in PRESETS:
            raise UsageError(f"no preset {preset!r}; {known(PRESETS, typed=preset)}")
        return replace(self, **{name: factor * getattr(self, name) for name, factor in PRESETS[preset].items()})
