"""A human motion: a skeleton over time."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.errors import MotionError, UsageError
from robot_retarget.base.pages import card, data_frame
from robot_retarget.contact.record import ContactRecord
from robot_retarget.human.recognition import Recognition, recognise
from robot_retarget.human.skeleton import Skeleton, backward, forward
from robot_retarget.scene.scene import Scene

RATES = (1.0, 1000.0)
"""Accepted frames per second [1/s]; others are mistakes."""


@dataclass(frozen=True)
class Motion:
    """A skeleton over time, in metres, z up, quaternions w x y z.

    `source` names its file; `notes` are sentences about the defects and repairs of the capture.
    """

    skeleton: Skeleton
    positions: Floats
    """(T, J, 3) of every joint [m]."""
    rotations: Floats | None
    """(T, J, 4) of every joint in the world frame, unit w x y z, or None when the source has positions only."""
    fps: float
    """Frames per second [1/s]."""
    source: str = ""
    notes: tuple[str, ...] = field(default=())
    contacts: ContactRecord | None = None
    """Which feet are on the ground, where the source says so."""
    whole: "Motion | None" = field(default=None, repr=False, compare=False)
    """The clip that contains this part; recognition and floor use the clip. None after a change of the frames."""
    start: int = field(default=0, compare=False)
    """Frame of the whole with which it begins."""
    start_time: float = 0.0
    """Time in the source file of the first frame [s]."""
    source_sha256: str = ""
    """The hash of the source file; empty for a motion made in memory."""
    known: Recognition | None = field(default=None, repr=False, compare=False)
    """The keypoints among the joints, where source or reader know them; None after a change of the names."""
    scrambled: str = field(default="", repr=False, compare=False)
    """A sentence where the file has further frames that are no poses: such a motion is not solved until a part of it is taken."""
    scene: Scene | None = field(default=None, repr=False, compare=False)
    """The bodies around the human, with a pose at every frame (`with_scene`)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", frozen(self.positions))
        if self.positions.ndim != 3 or self.positions.shape[1:] != (len(self.skeleton), 3) or not len(self.positions):
            raise MotionError(
                f"positions must be (T, {len(self.skeleton)}, 3), got {self.positions.shape}", self.source
            )
        if self.rotations is not None:
            object.__setattr__(self, "rotations", frozen(self.rotations))
            if self.rotations.shape != (*self.positions.shape[:2], 4):
                raise MotionError(f"rotations must be (T, J, 4), got {self.rotations.shape}", self.source)
        for values in (self.positions, self.rotations):
            if values is not None and not np.isfinite(values).all():
                frame, joint = np.argwhere(~np.isfinite(values))[0, :2]
                raise MotionError(f"frame {frame}, joint {self.skeleton.names[joint]!r} is not finite", self.source)
        if self.contacts is not None and len(self.contacts) != len(self):
            raise MotionError(f"contacts are of {len(self.contacts)} frames, the motion has {len(self)}", self.source)
        if self.scene is not None and self.scene.frames not in (None, len(self)):
            raise MotionError(f"the scene has {self.scene.frames} frames, the motion {len(self)}", self.source)
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise MotionError(f"frames per second must be positive, got {self.fps}", self.source)
        if self.whole is not None and not self._is_part(self.whole):
            object.__setattr__(self, "whole", None)
        if self.known is not None and self.known.names != self.skeleton.names:
            object.__setattr__(self, "known", None)

    def _is_part(self, whole: "Motion") -> bool:
        same = self.fps == whole.fps and self.skeleton is whole.skeleton
        turned = (self.rotations is None) == (whole.rotations is None)
        return same and turned and np.array_equal(self.positions, whole.positions[self.span])

    def __repr__(self) -> str:
        return f"<Motion {self.source or 'made'}: {', '.join(self._facts().values())}>"

    def _repr_html_(self) -> str:
        return card(self.source or "Motion", self._facts(), self.notes)

    def _facts(self) -> dict[str, str]:
        return {
            "length": f"{self.duration:.2f} s",
            "frames": f"{len(self)} at {self.fps:g}/s",
            "joints": f"{len(self.skeleton)} joints, {'positions only' if self.rotations is None else 'with rotations'}",
        }

    def to_frame(self) -> Any:
        """Positions of the joints [m] as a pandas DataFrame: columns (joint, axis), a row a frame.

        Raises:
            UsageError: pandas is not installed.
        """
        names = [(joint, axis) for joint in self.skeleton.names for axis in "xyz"]
        columns = dict(zip(names, self.positions.reshape(len(self), -1).T, strict=True))
        return data_frame(columns, np.arange(len(self)) / self.fps)

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def recognition(self) -> Recognition:
        """The keypoints among the joints: those that are known, else those that the whole clip shows.

        Raises:
            MatchError: the body is not human.
        """
        if self.whole is not None:
            return self.whole.recognition
        return self.known or recognise(self.skeleton, self.positions)

    @property
    def clip(self) -> "Motion":
        """What this is a part of: `whole`, or itself."""
        return self.whole or self

    @property
    def span(self) -> slice:
        """Its frames among those of `clip`."""
        first = self.start if self.whole is not None else 0
        return slice(first, first + len(self))

    @property
    def duration(self) -> float:
        """From the first frame to the last [s]."""
        return (len(self) - 1) / self.fps

    @property
    def source_time(self) -> Floats:
        """(T,) time in the source file of every frame [s]."""
        return self.start_time + np.arange(len(self)) / self.fps

    def at_source_time(self, times: Floats, fps: float) -> "Motion":
        """Return the motion at times (T,) in the source file [s], played at `fps`; times beyond it take its ends.

        Args:
            times: (N,) [s].
            fps: frames per second [1/s].
        """
        return at_frames(self, (times - self.start_time) * self.fps, fps)

    def frames(self, start: float = 0, stop: float | None = None) -> "Motion":
        """The frames start … stop − 1, a part that keeps the clip's map, floor and contacts.

        Args:
            start: first frame; as a float, its time [s].
            stop: frame after the last, or its time; by default the end.

        Raises:
            UsageError: the range is empty or leaves the clip.
        """
        start, stop = (
            round(end * self.fps) if isinstance(end, float) else int(end)
            for end in (start, len(self) if stop is None else stop)
        )
        if not 0 <= start < stop <= len(self):
            raise UsageError(f"frames {start}:{stop} are no part of the clip's 0:{len(self)}")
        rotations = None if self.rotations is None else self.rotations[start:stop]
        contacts = None if self.contacts is None else self.contacts[start:stop]
        return replace(
            self,
            positions=self.positions[start:stop],
            rotations=rotations,
            contacts=contacts,
            whole=self.clip,
            start=self.span.start + start,
            start_time=self.start_time + start / self.fps,
            scrambled="",
            scene=None if self.scene is None else self.scene.at(slice(start, stop)),
        )

    def poses_at(self, frame: int) -> dict[str, Floats]:
        """Return the poses (7,) of the moving bodies at a frame, by name: x y z [m], quaternion w x y z."""
        bodies = () if self.scene is None else self.scene.bodies
        return {body.name: body.poses[frame] for body in bodies if body.poses.ndim == 2}

    def resample(self, fps: float) -> "Motion":
        """The same motion at another frame rate, its duration kept to half a frame.

        With rotations, each joint's pose in its parent is interpolated (slerp, lerp) and put together again, so that bones
        keep their lengths; without, positions are interpolated linearly.

        Args:
            fps: from 1 to 1000 [1/s].

        Raises:
            UsageError: `fps` is out of range.
        """
        if not RATES[0] <= fps <= RATES[1]:
            raise UsageError(f"frames per second must be from {RATES[0]:g} to {RATES[1]:g}, got {fps}")
        if fps == self.fps or len(self.clip) == 1:
            return replace(self, fps=fps)
        count = max(1, round(self.duration * fps)) + 1 if len(self) > 1 else 1
        step, first = self.fps / fps, self.span.start
        before = int(first / step)
        after = max(0, int((len(self.clip) - 1 - first) / step) - count + 1)
        frames = first + step * np.arange(-before, count + after)
        resampled = at_frames(self.clip, frames, fps)
        return resampled if self.whole is None else resampled.frames(before, before + count)


# The poses between frames.


def at_frames(motion: Motion, frames: Floats, fps: float) -> Motion:
    """The motion at (T,) whole or broken numbers of its frames, in any order, the ends held beyond them; played at `fps`.

    Contacts are those of the nearest frame.

    Args:
        motion: the motion.
        frames: (N,) indices of frames, whole or not.
        fps: rate at which the result is played [1/s].
    """
    at = np.clip(frames, 0, len(motion) - 1)
    contacts = None if motion.contacts is None else motion.contacts[np.round(at).astype(int)]
    began = motion.start_time + float(frames[0]) / motion.fps if len(frames) else motion.start_time
    around = None if motion.scene is None else motion.scene.resampled(at)
    motion = replace(motion, contacts=None, scene=None, start_time=began)
    if len(motion) == 1:
        return replace(
            motion,
            positions=np.repeat(motion.positions, len(frames), axis=0),
            fps=fps,
            rotations=_held(motion, len(frames)),
            contacts=contacts,
            scene=around,
        )
    before = np.minimum(at.astype(int), len(motion) - 2)
    share = np.asarray(at - before, dtype=np.float64)[:, None]
    if motion.rotations is None:
        return replace(
            motion, positions=_lerp(motion.positions, before, share), fps=fps, contacts=contacts, scene=around
        )
    parents = motion.skeleton.parents
    translations, turns = backward(parents, motion.positions, motion.rotations)
    positions, rotations = forward(parents, _lerp(translations, before, share), _slerp(turns, before, share))
    return replace(motion, positions=positions, rotations=rotations, fps=fps, contacts=contacts, scene=around)


def _held(motion: Motion, count: int) -> Floats | None:
    return None if motion.rotations is None else np.repeat(motion.rotations, count, axis=0)


def _lerp(values: Floats, before: np.ndarray, share: Floats) -> Floats:
    return values[before] + share[..., None] * (values[before + 1] - values[before])


def _slerp(values: Floats, before: np.ndarray, share: Floats) -> Floats:
    """q (q⁻¹ r)^u of (T, J, 4) unit quaternions, every joint by its own shortest way."""
    shape = (len(before), *values.shape[1:])
    start, end = (
        Rotation.from_quat(values[frames].reshape(-1, 4), scalar_first=True) for frames in (before, before + 1)
    )
    part = np.broadcast_to(share, shape[:2]).reshape(-1, 1)
    turned = start * Rotation.from_rotvec(part * (start.inv() * end).as_rotvec())
    return turned.as_quat(scalar_first=True).reshape(shape)


# Parts of a clip in words: frames or seconds.


def part_of(motion: Motion, frames: tuple[float, float | None] | str | None) -> Motion:
    """Return the part of a motion between two frames or times (`Motion.frames`), or as `START:STOP`; the whole for None.

    Raises:
        UsageError: the text is not of this form, or leaves the clip.
    """
    if frames is None:
        return motion
    return motion.frames(*(span_of(frames, len(motion), motion.fps) if isinstance(frames, str) else frames))


def span_of(text: str, count: int, fps: float) -> tuple[int, int]:
    """The frames `START:STOP` of a clip; each end is a frame (`30`) or a time (`1.5s`); a single frame selects itself, and a single time is an error.

    Raises:
        UsageError: The text is not of this form.
    """

    def frame(end: str) -> int:
        return round(float(end[:-1]) * fps) if end.endswith("s") else int(end)

    start, colon, stop = (part.strip() for part in text.partition(":"))
    try:
        first = int(start) if start and not colon else frame(start) if start else 0
        return first, frame(stop) if stop else count if colon else first + 1
    except (ValueError, OverflowError):
        raise UsageError(f"--frames takes START:STOP in frames (30:90) or seconds (1s:3s), got {text!r}") from None
