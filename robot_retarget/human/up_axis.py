"""The up axis of a file, from all evidence, with a margin.

Each kind of evidence gives every signed axis a score, a log-likelihood up to a constant; the scores add up. A body that
lies through the whole clip is still known by the height of its floor, its rest pose, the custom of files and its flights.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.constants import g
from scipy.ndimage import correlate1d
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import ALIGNED, Floats, intervals, unit
from robot_retarget.contact.rule import JOINTS, standing
from robot_retarget.human.capture import Capture
from robot_retarget.human.recognition.recognise import Recognition, leg_length
from robot_retarget.human.skeleton import Skeleton

AXES = ("+x", "+y", "+z", "-x", "-y", "-z")
CUSTOM = ("+y", "+z", "+x", "-x", "-y", "-z")
"""Axes that files have up, the usual ones first; none has an axis that points down."""
SEEN = ("+y", "+z", "-y")
"""Axes that are up where people from video are: two of a world, and that of a camera."""
SEGMENTS = {
    ("pelvis", "chest"): 0.497, ("neck", "head"): 0.081,
    ("hip", "knee"): 0.1, ("knee", "ankle"): 0.0465, ("ankle", "toe"): 0.0145,
    ("shoulder", "elbow"): 0.028, ("elbow", "hand"): 0.022,
}  # fmt: skip
"""Shares of the body's mass between two keypoints; per side for paired segments [Winter2009]."""


@dataclass(frozen=True)
class UpAxisRule:
    """How much each kind of evidence counts, in natural units of a log-likelihood; lengths in leg lengths."""

    strong: float = 4.0
    """Of evidence that fails in one clip of 50: the head is over the ankles, the lowest point of the body keeps its height
    (per leg length), a flight is a free fall. The logarithm of these odds is 3.9."""
    floor: float = 3.5
    """Of a lowest point that begins at 0; less than the posture, as points may be relative to the pelvis."""
    weak: float = 1.5
    """Of evidence that fails in one file of 5: the head is over the ankles in the rest pose, x does not point up. The
    logarithm of these odds is 1.4."""
    near: float = 0.2
    """Height within which the lowest point of a clip begins at 0."""
    airborne: float = JOINTS.flight
    """Duration of a flight that counts fully [s]."""
    free: float = 0.25
    """Share of gravity by which the acceleration of a free fall may differ from it [-]. Half and double change none of 13
    exporters' clips."""
    doubt: float = 2.3
    """A lead over the second best axis below this is reported: odds of less than 10 to 1."""
    tie: float = 0.2
    """A lead below this is a tie. Half and double change none of 13 exporters' clips."""


@dataclass(frozen=True)
class UpAxis:
    """The axis that points up, and what speaks for it."""

    axis: str
    second: str
    margin: float
    """Lead of the best axis over the second: the logarithm of the odds."""
    evidence: dict[str, Floats]
    """(6,) per kind, in the order of `AXES`."""

    @property
    def share(self) -> float:
        """The odds of the best axis against the second as a probability."""
        return float(1 / (1 + np.exp(-self.margin)))

    @property
    def reasons(self) -> str:
        """The kinds of evidence by which the best axis leads, and those by which it falls behind."""
        best, second = AXES.index(self.axis), AXES.index(self.second)
        lead = {kind: float(score[best] - score[second]) for kind, score in self.evidence.items()}
        for_it = [kind for kind in sorted(lead, key=lambda k: -lead[k]) if lead[kind] > 0.5]
        against = [kind for kind in sorted(lead, key=lambda k: lead[k]) if lead[kind] < -0.5]
        sentence = f"for {self.axis}: {', '.join(for_it) or 'nothing'}"
        return f"{sentence}; for {self.second}: {', '.join(against)}" if against else sentence


def find_up_axis(recognition: Recognition, capture: Capture, metres: float, rule: UpAxisRule | None = None) -> UpAxis:
    """Score the six signed axes of a file.

    The rest pose counts only for files with rotations: without, the skeleton's offsets are those of a pose of the motion. Where
    people are from video, the rest pose has y up in every world.

    Args:
        metres: in the file's unit.
        rule: weights of the evidence.
    """
    rule = rule or UpAxisRule()
    positions = capture.positions
    leg = leg_length(recognition, positions)
    keypoints = recognition.place(positions)
    with_rest = capture.rotations is not None and not capture.camera
    evidence = {
        "posture": rule.strong * _signed(_stance(recognition, keypoints).mean(axis=0)),
        "steady lowest point": -rule.strong * _lowest(positions).std(axis=0) / leg,
        "floor at height 0": rule.floor * _floor_at_zero(positions, leg, rule),
        "free fall": rule.strong * _flights(recognition, keypoints * metres, capture.fps, rule),
        "rest pose": rule.weak * (_rest(recognition, capture.skeleton) if with_rest else np.zeros(len(AXES))),
        "custom": np.array([rule.strong * (axis in SEEN) for axis in AXES])
        if capture.camera
        else -rule.weak / 2 * np.array([min(CUSTOM.index(axis), 3) for axis in AXES]),
    }
    total = sum(evidence.values(), np.zeros(len(AXES)))
    order = np.argsort(-total, kind="stable")
    margin = float(total[order[0]] - total[order[1]])
    return UpAxis(AXES[order[0]], AXES[order[1]], margin, evidence)


def _signed(along: Floats) -> Floats:
    """(6,) of a vector: along every axis, then against it."""
    return np.concatenate([along, -along])


def _stance(recognition: Recognition, keypoints: Floats) -> Floats:
    """(T, 3) directions from the farther ankle to the head, or to the shoulders of a body without a head."""
    at = recognition.keypoints.index
    top = ["head"] if "head" in recognition.marks else ["l_shoulder", "r_shoulder"]
    ways = keypoints[:, [at(k) for k in top]].mean(axis=1)[:, None] - keypoints[:, [at("l_ankle"), at("r_ankle")]]
    farther = np.linalg.norm(ways, axis=2).argmax(axis=1)
    return unit(ways[np.arange(len(ways)), farther])


def _lowest(positions: Floats) -> Floats:
    """(T, 6) lowest coordinate of the body along every signed axis."""
    return np.concatenate([positions.min(axis=1), -positions.max(axis=1)], axis=1)


def _floor_at_zero(positions: Floats, leg: float, rule: UpAxisRule) -> Floats:
    """(6,) whether the clip begins at height 0; a thin body that stands astride 0 begins nowhere."""
    low = JOINTS.floor_height(_lowest(positions), axis=0) / leg
    near = np.exp(-((low / rule.near) ** 4))
    return np.maximum(near - np.roll(near, 3), 0.0)


def _flights(recognition: Recognition, keypoints: Floats, fps: float, rule: UpAxisRule) -> Floats:
    """(6,) the longest free fall along every signed axis over `airborne`, 1 at most."""
    window = 2 * round(rule.airborne * fps / 2) + 1
    if window < 5 or len(keypoints) < window:
        return np.zeros(len(AXES))
    acceleration = _fitted_acceleration(centre_of_mass(recognition, keypoints), window, fps)
    off = np.linalg.norm(acceleration[:, None] + g * np.concatenate([np.eye(3), -np.eye(3)]), axis=2)
    falling = off < rule.free * g
    longest = np.zeros(len(AXES))
    run = np.zeros(len(AXES))
    for now in falling:
        run = (run + 1) * now
        longest = np.maximum(longest, run)
    return np.minimum(longest / fps / rule.airborne, 1.0)


def _fitted_acceleration(path: Floats, window: int, fps: float) -> Floats:
    """Return (T, 3) second derivatives of the parabolas that fit a path (T, 3) best in windows of frames [m/s²]."""
    half = window // 2
    weights = 2 * fps**2 * np.linalg.pinv(np.vander(np.arange(window) - half, 3))[0]
    inner = correlate1d(path, weights, axis=0)[half : len(path) - half]
    return np.pad(inner, ((half, half), (0, 0)), mode="edge")


def centre_of_mass(recognition: Recognition, keypoints: Floats) -> Floats:
    """(T, 3) of keypoints (T, K, 3), from the segments that the body has.

    Args:
        keypoints: (T, K, 3) [m].
    """
    at, total, mass = recognition.keypoints.index, np.zeros(keypoints[:, 0].shape), 0.0
    for (upper, lower), share in SEGMENTS.items():
        for side in ("",) if upper in ("pelvis", "neck") else ("l_", "r_"):
            ends = [side + end for end in (upper, lower) if side + end in recognition.marks]
            if ends:
                total += share * keypoints[:, [at(end) for end in ends]].mean(axis=1)
                mass += share
    return total / mass


def _rest(recognition: Recognition, skeleton: Skeleton) -> Floats:
    """(6,) how much the head stands over the ankles at rest; 0 where it lies along x, as bones do that are laid out."""
    along = _stance(recognition, recognition.place(skeleton.rest()[None]))[0]
    clear = np.abs(along[1:]).max() > ALIGNED
    return np.maximum(_signed(along * [0.0, 1.0, 1.0]), 0.0) if clear else np.zeros(len(AXES))


# The vertical of a capture in a camera's frame: the direction in which planted feet do not move, and bodies stand and balance.
#
# The up direction u minimises  uᵀ A u  over unit vectors, with
#
#     A = Σ_s (p_s − p̄)(p_s − p̄)ᵀ / σ_f²  +  Σ_k (I − m_k m_kᵀ) / σ_k²,
#
# p_s the places of planted feet over the path of the body, and m_k the mean direction from the ankles to the head of a standing body,
# that from the middle of its soles to its centre of mass, and the camera's own up axis. Its smallest eigenvector is u; the gaps to
# the others give the standard deviation of the tilt.

VERTICAL_ROUNDS = 3
"""Stances are found again with the vertical that the ones before gave: of eight clips tilted by 17° the vertical errs
by 2.2, 1.8 and 1.7° in the mean after 1, 2 and 3 rounds, and no less after 6."""
SOLE_AHEAD = 0.08
"""How far the middle of a sole is ahead of the ankle, for bodies without toes [leg lengths]: 0.06 m of 0.78 m in the mean SMPL body."""


@dataclass(frozen=True)
class CameraRule:
    """How far each kind of evidence strays.

    In brackets: the mean error of the vertical of 18 clips tilted by 15°, with half and with double; with these it is 1.6°, and
    2.5° for bodies without a path.
    """

    floor: float = 0.025
    """σ_f, of the height of a planted foot in a video's result [leg lengths] (1.9, 1.7)."""
    balance: float = 0.05
    """Of the mean way from the soles to the centre of mass [rad] (1.9, 1.8)."""
    posture: float = 0.1
    """Of the mean lean of a standing person [rad] (1.6, 1.8)."""
    camera: float = 0.3
    """Of the tilt of a camera [rad] (1.5, 1.7)."""
    upright: float = 0.8
    """A body stands while its head is higher over the ankles than this share of the most [-] (1.6 with 0.9, 2.1 with 0.7)."""


def levelled(
    capture: Capture, recognition: Recognition, axis: Floats, rule: CameraRule | None = None
) -> tuple[Capture, str]:
    """Return the capture turned about a level axis so that its vertical is the camera's up axis, and a sentence about it.

    Args:
        capture: in the frame of a camera that stands still.
        axis: (3,) the camera's up axis.
        rule: how far each kind of evidence strays; None takes the defaults.
    """
    up, sigma, stances = find_vertical(recognition, capture.positions, capture.fps, axis, rule or CameraRule())
    turn = Rotation.align_vectors(axis, up)[0]
    positions = turn.apply(capture.positions.reshape(-1, 3)).reshape(capture.positions.shape)
    rotations = capture.rotations
    if rotations is not None:
        flat = Rotation.from_quat(rotations.reshape(-1, 4), scalar_first=True)
        rotations = (turn * flat).as_quat(scalar_first=True).reshape(rotations.shape)
    tilt, spread = np.degrees([float(np.arccos(np.clip(up @ axis, -1, 1))), sigma])
    note = (
        f"The camera is tilted by {tilt:.0f}° ± {spread:.0f}°, from {stances} planted feet, balance and posture: "
        "the motion was levelled."
    )
    return replace(capture, positions=positions, rotations=rotations), note


def find_vertical(
    recognition: Recognition, positions: Floats, fps: float, axis: Floats, rule: CameraRule
) -> tuple[Floats, float, int]:
    """Return the up direction (3,) of joints (T, J, 3) over time, its standard deviation [rad] and the number of planted feet.

    Args:
        positions: (T, J, 3) [any unit].
        fps: frames per second [1/s].
        axis: (3,) the camera's up axis.
        rule: how far each kind of evidence strays.
    """
    leg = leg_length(recognition, positions)
    x = dict(zip(recognition.keypoints, recognition.place(positions / leg).swapaxes(0, 1), strict=True))
    ankles = (x["l_ankle"] + x["r_ankle"]) / 2
    chest = (x["l_shoulder"] + x["r_shoulder"]) / 2
    body = x.get("head", 2 * chest - x["pelvis"]) - ankles
    tall = np.linalg.norm(body, axis=1)
    stands = tall >= rule.upright * tall.max()
    ahead = SOLE_AHEAD * unit(np.cross(x["l_hip"] - x["r_hip"], chest - x["pelvis"]))
    toes = [x.get(f"{side}_toe", x[f"{side}_ankle"] + 2 * ahead) for side in "lr"]
    over = centre_of_mass(recognition, recognition.place(positions / leg)) - (2 * ankles + toes[0] + toes[1]) / 4
    balance, posture = (unit(unit(way[stands]).mean(axis=0)) for way in (over, body))
    ways = ((balance, rule.balance), (posture, rule.posture), (axis, rule.camera))
    prior = sum(((np.eye(3) - np.outer(way, way)) / sigma**2 for way, sigma in ways), np.zeros((3, 3)))
    up, values, stances = balance, np.linalg.eigvalsh(prior), np.zeros((0, 3))
    for _ in range(VERTICAL_ROUNDS):
        stances = _planted([x[f"{side}_ankle"] for side in "lr"], up, fps)
        spread = stances - stances.mean(axis=0) if len(stances) else stances
        values, vectors = np.linalg.eigh(prior + spread.T @ spread / rule.floor**2)
        up = vectors[:, 0] * np.sign(vectors[:, 0] @ balance)
    sigma = float(np.sqrt(np.mean(1 / np.maximum(values[1:] - values[0], 1e-9))))
    return up, sigma, len(stances)


def _planted(feet: list[Floats], up: Floats, fps: float) -> Floats:
    """(S, 3) the median place of every foot in every stance [leg lengths]."""
    places = []
    for foot in feet:
        height = foot @ up
        stands = standing(foot, height - JOINTS.floor_height(height), fps)
        places += [np.median(foot[start:stop], axis=0) for start, stop in intervals(stands)]
    return np.array(places).reshape(-1, 3)
