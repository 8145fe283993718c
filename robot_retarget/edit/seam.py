"""The seam of two performers' motions: where one passes into the next, and what speaks against it.

During a seam of n frames, frame l − n + k of the motion before and frame e + k of the motion after show at once. Places on
the floor and headings are complex numbers, so that multiplication turns them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import JERK_PEAK, Bools, Floats, Ints
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.human.recognition.recognise import leg_length
from robot_retarget.solver.balance.playback import Pacing

SLIP = 0.04
"""A foot may be this far from its place at a seam without a step [leg lengths]: a centimetre on a leg of 25 cm."""
GRIP = Pacing.friction * g
"""Largest horizontal acceleration of the body [m/s²]: that of the friction of balanced playback."""
SOUGHT = 1.0
"""Better frames are sought this far from the requested ones [s]."""
NAMES = {"l": "left", "r": "right"}
Places = NDArray[np.complex128]


@dataclass(frozen=True)
class Seam:
    """The frames at which a motion passes into the next."""

    leave: int
    """Last frame of the motion before."""
    enter: int
    """First frame of the motion after."""
    frames: int
    """n, the length of the seam in frames."""

    @property
    def middle(self) -> tuple[int, int]:
        """The frames of both motions that show in the middle of the seam."""
        return self.leave - self.frames + self.frames // 2, self.enter + self.frames // 2


@dataclass(frozen=True)
class Stances:
    """A performer on the floor, frame by frame: feet and root as complex places and headings."""

    motion: Motion

    @property
    def down(self) -> Bools:
        """(T, F) whether each foot is on the ground, at any speed; F = 0 for a body without soles."""
        return np.zeros((len(self.motion), 0), bool) if self.motion.contacts is None else self.motion.contacts.down

    @cached_property
    def leg(self) -> float:
        """Length of the leg [m]."""
        return (
            leg_length(self.motion.recognition, self.motion.skeleton.rest()[None])
            if self.motion.contacts is not None
            else 1.0
        )

    @cached_property
    def places(self) -> Places:
        """(T, F + 1) places of ankles and root [m]."""
        spots = self.motion.positions[:, self._joints]
        return np.asarray(spots[..., 0] + 1j * spots[..., 1])

    @cached_property
    def headings(self) -> Places:
        """(T, F + 1) headings of feet and root, of length 1."""
        assert self.motion.rotations is not None
        turns = self.motion.rotations[:, self._joints].reshape(-1, 4)
        ahead = Rotation.from_quat(turns, scalar_first=True).apply([1.0, 0.0, 0.0])
        flat = (ahead[:, 0] + 1j * ahead[:, 1]).reshape(len(self.motion), -1)
        return np.asarray(flat / np.maximum(np.abs(flat), 1e-9))

    @cached_property
    def _joints(self) -> list[int]:
        feet = [f"{side}_ankle" for side in NAMES] if self.down.size else []
        return [*map(self.motion.skeleton.names.index, feet), 0]

    @cached_property
    def shape(self) -> Floats:
        """(T, 3 K) keypoints relative to the root, in its heading [m]."""
        flat = self.motion.positions[..., 0] + 1j * self.motion.positions[..., 1]
        flat = (flat - self.places[:, -1:]) / self.headings[:, -1:]
        return np.concatenate([flat.real, flat.imag, self.motion.positions[..., 2]], axis=1)


@dataclass(frozen=True)
class Spans:
    """The frames of one motion in S seams."""

    stances: Stances
    first: Ints
    """(S,) the frames at which they begin."""
    frames: int

    @cached_property
    def all(self) -> Ints:
        """(S, n + 1) frames."""
        return self.first[:, None] + np.arange(self.frames + 1)

    @property
    def middle(self) -> Ints:
        """(S,) frames in the middle."""
        return self.first + self.frames // 2

    @cached_property
    def down(self) -> Bools:
        """(S, F) whether a foot stands throughout."""
        return np.asarray(np.all(self.stances.down[self.all], axis=1))

    @cached_property
    def velocity(self) -> Places:
        """(S,) mean velocity of the root in its first heading [m/s]."""
        places, ends = self.stances.places[:, -1], self.all[:, [0, -1]]
        way = places[ends[:, 1]] - places[ends[:, 0]]
        return np.asarray(way / self.stances.headings[self.first, -1] * self.stances.motion.fps / self.frames)

    @cached_property
    def pace(self) -> Floats:
        """(S, 3 K) displacement of the keypoints relative to the root [m]."""
        return np.asarray(self.stances.shape[self.all[:, -1]] - self.stances.shape[self.first])

    def beside(self, foot: int) -> Places:
        """Return (S,) the place of the other foot in the frame of a foot [m]."""
        apart = self.stances.places[self.middle, 1 - foot] - self.stances.places[self.middle, foot]
        return np.asarray(apart / self.stances.headings[self.middle, foot])

    @property
    def lost(self) -> str:
        """The reason against the first span if both feet are in the air."""
        flying = np.flatnonzero(~np.any(self.stances.down[self.all[0]], axis=1)) if self.stances.down.size else []
        if not len(flying):
            return ""
        motion = self.stances.motion
        return f"both feet are in the air at {self.all[0, flying[0]] / motion.fps:.2f} s of {motion.source or 'a clip'}"

    @property
    def standing(self) -> str:
        """The feet that stand throughout the first span."""
        return " and ".join(NAMES[side] for k, side in enumerate(NAMES) if self.down[0, k]) or "none"


@dataclass(frozen=True)
class SeamTable:
    """The differences that seams at L × E pairs of frames bridge."""

    before: Spans
    after: Spans
    balanced: bool = True
    """Whether balance plans new steps and a new pace: then distant feet and different speeds do not refuse a seam."""

    @cached_property
    def supports(self) -> Bools:
        """(L, E, F) whether a foot is in stance in every frame of both motions."""
        return np.asarray(self.before.down[:, None] & self.after.down[None])

    @cached_property
    def anchors(self) -> Ints:
        """(L, E) foot that places the second motion; column F is the root, if the motions share no standing foot."""
        feet = self.supports.shape[2]
        if not feet:
            return np.zeros(self.supports.shape[:2], dtype=np.int64)
        return np.where(np.any(self.supports, axis=2), self.supports.argmax(axis=2), feet)

    @cached_property
    def gaps(self) -> Floats:
        """(L, E) distance between the places of the foot that is not the anchor, where both feet stand [m]."""
        if self.supports.shape[2] < 2:
            return np.zeros(self.anchors.shape)
        apart = [np.abs(self.before.beside(foot)[:, None] - self.after.beside(foot)[None]) for foot in range(2)]
        return np.where(np.all(self.supports, axis=2), np.where(self.anchors == 0, *apart), 0.0)

    @cached_property
    def least(self) -> Floats:
        """(L, E) least duration of a seam in which friction changes the root's velocity [s]."""
        return np.abs(self.before.velocity[:, None] - self.after.velocity[None]) * JERK_PEAK / GRIP

    @property
    def duration(self) -> float:
        """Of a seam [s]."""
        return self.before.frames / self.before.stances.motion.fps

    @property
    def slip(self) -> float:
        """Largest gap without a step [m]."""
        return SLIP * self.before.stances.leg

    @cached_property
    def fits(self) -> Bools:
        """(L, E) whether no reason is against a seam."""
        feet = self.supports.shape[2]
        held = np.any(self.supports, axis=2) if feet else np.ones(self.anchors.shape, bool)
        same = (self.gaps <= self.slip) & (self.least <= self.duration)
        return np.asarray(held & (self.balanced | same))

    def best(self) -> tuple[int, int] | None:
        """Return the pair of frames (leave, enter) that fits and has the nearest poses and speeds, or None.

        The measure is the rms distance of the keypoints, plus the distance that their speeds add in half a seam, plus the gap of the feet.
        """
        if not self.fits.any():
            return None
        poses = (spans.stances.shape[spans.middle] for spans in (self.before, self.after))
        apart = distances(*poses) + distances(self.before.pace, self.after.pace) / 2 + self.gaps
        row, column = np.unravel_index(np.where(self.fits, apart, np.inf).argmin(), apart.shape)
        return int(self.before.all[row, -1]), int(self.after.first[column])

    def reasons(self) -> list[str]:
        """Return the reasons against the first pair, a sentence each."""
        found = [spans.lost for spans in (self.before, self.after) if spans.lost]
        if not found and self.supports.shape[2] and not self.supports[0, 0].any():
            stand = f"{self.before.standing} before, {self.after.standing} after"
            found.append(f"the clips share no stance foot throughout the seam: {stand}")
        if not self.balanced and self.gaps[0, 0] > self.slip:
            found.append(f"feet {100 * self.gaps[0, 0]:.0f} cm apart (balance plans a step)")
        if not self.balanced and self.least[0, 0] > self.duration:
            speed = self.least[0, 0] * GRIP / JERK_PEAK
            found.append(f"speeds {speed:.2f} m/s apart: the seam must last {self.least[0, 0]:.2g} s or more")
        return found


def distances(rows: Floats, columns: Floats) -> Floats:
    """Return (L, E) rms distances of the points in rows (L, 3 K) and (E, 3 K)."""
    return np.linalg.norm(rows[:, None] - columns[None], axis=2) / np.sqrt(rows.shape[1] / 3)


def table_of(before: Motion, after: Motion, seam: Seam, balanced: bool = True) -> SeamTable:
    """Return the differences at one seam."""
    here = Spans(Stances(before), np.array([seam.leave - seam.frames]), seam.frames)
    return SeamTable(here, Spans(Stances(after), np.array([seam.enter]), seam.frames), balanced)


def found_seam(
    before: Motion, after: Motion, leave: int, enter: int, frames: int, balanced: bool, best: bool = False
) -> Seam:
    """Return the seam at requested frames, or at the best ones within `SOUGHT` of them.

    Args:
        before: motion of a performer.
        after: another of the same performer and rate.
        leave: last frame of the first.
        enter: first frame of the second.
        frames: length of the seam.
        balanced: whether balance plans new steps and a new pace.
        best: look for the best frames.

    Raises:
        UsageError: a frame is beyond its motion, or the seam does not fit in.
        TrajectoryError: the motions do not fit together there; the message has the reasons and better frames.
    """
    frames = min(frames, leave, len(after) - 1 - enter)
    if not (0 <= leave < len(before) and 0 <= enter < len(after) and frames >= 1):
        raise UsageError(
            f"{leave / before.fps:.2f}:{enter / after.fps:.2f} s is no seam of clips of "
            f"{before.duration:.2f} and {after.duration:.2f} s"
        )
    asked = table_of(before, after, Seam(leave, enter, frames), balanced)
    if asked.fits[0, 0] and not best:
        return Seam(leave, enter, frames)
    reach = round(SOUGHT * before.fps)
    leaves = np.arange(max(leave - reach, frames), min(leave + reach, len(before) - 1) + 1)
    enters = np.arange(max(enter - reach, 0), min(enter + reach, len(after) - 1 - frames) + 1)
    near = replace(asked.before, first=leaves - frames), replace(asked.after, first=enters)
    pair = replace(asked, before=near[0], after=near[1]).best()
    if pair and best:
        return Seam(*pair, frames)
    raise TrajectoryError(_refusal(before, after, asked.reasons(), pair))


def _refusal(before: Motion, after: Motion, reasons: Iterable[str], pair: tuple[int, int] | None) -> str:
    """Return why two motions do not fit together, and which frames do."""
    named = f"{before.source or 'a clip'} cannot continue with {after.source or 'the next'}"
    if pair is None:
        return f"{named}: {'; '.join(reasons)}; no frames within {SOUGHT:g} s do"
    at = f"{pair[0] / before.fps:.2f}:{pair[1] / after.fps:.2f}"
    return f"{named}: {'; '.join(reasons)}; the best frames within {SOUGHT:g} s are --at {at}"
