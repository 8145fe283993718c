"""Footholds: where on the floor each foot of the robot stands, and for how long."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats, leftward, unit
from robot_retarget.describe.contacts import intervals
from robot_retarget.robot import Anatomy, Points, Robot
from robot_retarget.robot.kinematics import carrying

HOLD = 1e4
"""Weight of a held coordinate, over the squared leg length: it gives way by a tenth of a millimetre."""
LANDING = 0.1
"""A foot is led to its foothold for so long before it stands, as a touch is; away from it, and until it has settled there, as
long after [s]."""
CORNERS = 4
"""A sole is held by its corners: front left, front right, rear left, rear right."""
LEAST = 0.01
"""A sole is held as if it were at least so long and wide [m]; shorter ones do not tell where they point."""
_TOE, _HEEL = [0, 1], [2, 3]
_LEFT, _RIGHT = [0, 2], [1, 3]


@dataclass(frozen=True)
class Grip:
    """How strongly corners are held, over the squared leg length; one weight along the floor and one across it."""

    along: float = HOLD
    across: float = HOLD
    swing: float = 4.0
    """Of a foot in the air on its way between footholds ..."""
    step: float = 40.0
    """... and of one that has just stood or is about to."""
    landing: float = 400.0
    """Along the floor, of a foot in the air that is about to stand."""

    def land(self, held: np.ndarray, places: Floats, near: Floats) -> tuple[Floats, Floats]:
        """h and p of a frame (3 · 4 F each), as `Problem.model` takes them: corners (F, 4) held at places (F, 4, 3).

        Feet that stand on no corner are drawn to their places along the floor, the more the nearer (F,) to standing, 0 … 1.
        """
        return self._weights(held, near[:, None, None] * [self.landing, self.landing, 0.0]).ravel(), places.ravel()

    def lead(self, held: np.ndarray, places: Floats, near: Floats, doubt: float = 1.0) -> tuple[Floats, Floats]:
        """As `land`, but softly, by a share `doubt`, in height too, and all the way between two stances."""
        free = doubt * np.maximum(self.step * near, self.swing)
        return self._weights(held, free[:, None, None]).ravel(), places.ravel()

    def lay_down(self, held: np.ndarray) -> tuple[Floats, Floats]:
        """h and p by which held corners (F, 4) touch the floor, wherever that is."""
        return np.where(held[..., None], [0.0, 0.0, self.across], 0.0).ravel(), np.zeros(3 * held.size)

    def _weights(self, held: np.ndarray, free: Floats) -> Floats:
        """(F, 4, 3) of held corners, and of those of feet in the air."""
        weight = np.where(held[..., None], [self.along, self.along, self.across], 0.0)
        return np.where(np.asarray(held.any(axis=-1))[:, None, None], weight, free)


def grip_of(robot: Robot, anatomy: Anatomy) -> Grip:
    """A sole can be laid flat anywhere by six hinges; with fewer it is held along the floor and gives way across."""
    dofs = carrying(robot.model)
    pelvis = dofs[anatomy.spots["pelvis"].body] if "pelvis" in anatomy.spots else dofs[robot.root_body]
    legs = [int((dofs[sole.bodies[0]] & ~pelvis).sum()) for sole in anatomy.soles.values()]
    return Grip() if min(legs, default=6) >= 6 else Grip(across=20.0)


def sole_corners(anatomy: Anatomy, foot: str) -> Points:
    """The corners of what a foot stands on, in `CORNERS` order.

    A foot that stands on a point or a line has the heading of its frame: it is held by a small rectangle along it.
    """
    body, axes = anatomy.frames[f"{foot}_foot"]
    along = anatomy.treads[foot].offsets @ axes
    low, middle, half = along[:, 2].min(), (along.min(0) + along.max(0)) / 2, np.ptp(along, axis=0) / 2
    (back, right, _), (front, left, _) = (middle + way * np.maximum(half, LEAST / 2) for way in (-1, 1))
    corners = np.array([[front, left, low], [front, right, low], [back, left, low], [back, right, low]])
    return Points(np.full(CORNERS, body), corners @ axes.T)


def held_corners(stances: dict[str, np.ndarray], feet: tuple[str, ...], frames: int) -> np.ndarray:
    """(T, F, 4): the front corners while the toe stands, the rear ones while the heel does."""
    held = np.zeros((frames, len(feet), CORNERS), dtype=bool)
    for k, foot in enumerate(feet):
        if foot in stances:
            held[:, k, _TOE] = stances[foot][:, :1]
            held[:, k, _HEEL] = stances[foot][:, 1:]
    return held


def lengths(corners: Floats) -> Floats:
    """(…, 2) from the middle of the heel to the middle of the toes of soles (…, 4, 3), along the floor [m]."""
    return corners[..., _TOE, :2].mean(axis=-2) - corners[..., _HEEL, :2].mean(axis=-2)


def laid(corners: Floats, whole: np.ndarray) -> Floats:
    """Corners (…, 4, 3) on the floor: the sole flat where it stands `whole` (…), else each edge where it is."""
    front, rear = _edge_down(corners[..., _TOE, :]), _edge_down(corners[..., _HEEL, :])
    return np.where(whole[..., None, None], flattened(corners), np.concatenate([front, rear], axis=-2))


def _edge_down(edge: Floats) -> Floats:
    """The two corners (…, 2, 3) of an edge on the floor, as far apart as they are."""
    width = np.linalg.norm(edge[..., 0, :] - edge[..., 1, :], axis=-1)[..., None] / 2
    across = (edge[..., 0, :] - edge[..., 1, :]) * [1.0, 1.0, 0.0]
    middle, half = edge.mean(axis=-2) * [1.0, 1.0, 0.0], width * unit(across)
    return np.stack([middle + half, middle - half], axis=-2)


def flattened(corners: Floats) -> Floats:
    """Corners (…, 4, 3) laid flat on the floor: same middle, same heading, same shape."""
    middle = corners.mean(axis=-2, keepdims=True)
    ahead = unit(lengths(corners))[..., None, :]
    left = leftward(ahead)
    length, width = (
        np.linalg.norm(corners[..., one, :] - corners[..., other, :], axis=-1).mean(axis=-1)[..., None, None] / 2
        for one, other in ((_TOE, _HEEL), (_LEFT, _RIGHT))
    )
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    flat = middle[..., :2] + signs[:, :1] * length * ahead + signs[:, 1:] * width * left
    return np.concatenate([flat, np.zeros((*flat.shape[:-1], 1))], axis=-1)


def nearing(stands: np.ndarray, frames: int) -> Floats:
    """(T, F) how near feet are to standing: 1 while they do, rising to that by squares from 0 so many frames before."""
    near = stands.astype(float)
    rise = np.square(np.arange(1, frames + 1) / (frames + 1))
    for foot in range(stands.shape[1]):
        for start, _ in intervals(stands[:, foot]):
            first = max(start - frames, 0)
            near[first:start, foot] = np.maximum(near[first:start, foot], rise[frames - (start - first) :])
    return near


def near_footholds(held: np.ndarray, fps: float) -> Floats:
    """(T, F) how near feet are to standing (`nearing`), coming or going."""
    stands, lead = np.asarray(held.any(axis=2)), round(LANDING * fps)
    return np.maximum(nearing(stands, lead), nearing(stands[::-1], lead)[::-1])


@dataclass(frozen=True, eq=False)
class Foothold:
    """Where the corners (4, 3) of a foot are to be [m], from frame `start` to before `stop`."""

    foot: int
    start: int
    stop: int
    corners: Floats
    known: bool = False
    """Whether it began among the frames that stay as they are."""


def footholds(held: np.ndarray, corners: Floats, fixed: int = 0) -> list[Foothold]:
    """A foothold for every stance, at the middle of where the draft put the foot.

    Args:
        held: (T, F, 4) what is held.
        corners: (T, F, 4, 3) of the draft.
        fixed: so many frames at the beginning stay as they are, and a stance that began in them where it was.
    """
    found = []
    for foot in range(held.shape[1]):
        for start, stop in intervals(np.asarray(held[:, foot].any(axis=1))):
            known = min(fixed, stop) if start < fixed else stop
            settled = _settled(np.asarray(held[start:stop, foot].all(axis=1)), corners[start:known, foot])
            found.append(Foothold(foot, start, stop, settled, start < fixed))
    return found


def _settled(whole: np.ndarray, corners: Floats) -> Floats:
    """Where the corners (known, 4, 3) of a foot are in the middle, if it can be while it stands `whole` (frames,)."""
    seen = whole[: len(corners)]
    return laid(np.median(corners[seen] if seen.any() else corners, axis=0), np.asarray(whole.any()))


def led(footholds: list[Foothold], held: np.ndarray, corners: Floats, fixed: int = 0) -> Floats:
    """(T, F, 4, 3) where the corners should be [m]: at their footholds, and in between along the draft.

    There each corner is shifted from the one foothold's offset to the next one's, so that a foot neither leaps away nor
    lands with a leap or a slap; one that is in the air in the first `fixed` frames goes on from where it is.
    """
    places = corners.copy()
    for hold in footholds:
        places[hold.start : hold.stop, hold.foot] = hold.corners
    for foot in range(held.shape[1]):
        stands = np.asarray(held[:, foot].any(axis=1))
        stands[:fixed] = True
        places[~stands, foot] += _shift_between(stands, _offsets(held[:, foot], (places - corners)[:, foot]))
    return places


def _offsets(held: np.ndarray, missing: Floats) -> Floats:
    """(T, 4, 3) what corners miss where they are held (T, 4); the others of a foot in the mean of those."""
    share = held[..., None] / np.maximum(held.sum(axis=1), 1)[:, None, None]
    return np.where(held[..., None], missing, (share * missing).sum(axis=1, keepdims=True))


def _shift_between(stands: np.ndarray, offset: Floats) -> Floats:
    """(swing frames, 4, 3) the corners' offsets at the stances on either side, blended with zero speed at both ends."""
    frames = np.arange(len(stands))
    known = frames[stands]
    if not known.size:
        return np.zeros((int((~stands).sum()), CORNERS, 3))
    after = np.searchsorted(known, frames[~stands])
    first, last = known[np.maximum(after - 1, 0)], known[np.minimum(after, len(known) - 1)]
    share = np.clip((frames[~stands] - first) / np.maximum(last - first, 1), 0.0, 1.0)[:, None, None]
    smooth = smoothstep(share)
    return (1 - smooth) * offset[first] + smooth * offset[last]


def smoothstep(share: Floats) -> Floats:
    """3 s² − 2 s³: from 0 to 1, at rest at both ends."""
    return share**2 * (3 - 2 * share)
