"""The content of a motion file, before units and axes are converted."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import MatchError, MotionError, UsageError, known
from robot_retarget.base.keypoints import SIDES
from robot_retarget.base.untrusted.arrays import RATES, shape_of
from robot_retarget.base.untrusted.limits import zip_names
from robot_retarget.base.untrusted.rotations import UNIT_NORM
from robot_retarget.human.recognition.limbs import LIMBS
from robot_retarget.human.recognition.recognise import recognise
from robot_retarget.human.skeleton import Skeleton

MOST_FAR = 1e7
"""A joint farther from the origin is a mistake [file units]: 10 km in millimetres."""


@dataclass(frozen=True)
class Capture:
    """A skeleton over time in the unit and the axes of its file. `upright.upright` makes a `Motion` of it."""

    skeleton: Skeleton
    positions: Floats
    """(T, J, 3) of every joint [file units]."""
    rotations: Floats | None
    """(T, J, 4) of every joint in the file's world frame, unit w x y z, or None."""
    fps: float
    """Frames per second [1/s]."""
    source: str
    notes: tuple[str, ...] = ()
    contacts: Bools | None = None
    """(T, 4) whether left heel, left toe, right heel and right toe stand, where the file says them."""
    up: str | None = None
    """The signed axis that points up, such as `+y`, where the format fixes it; else it is inferred from the poses."""
    camera: bool = False
    """Whether positions may be in the frame of a camera: x right, y down, z away, and the up axis −y tilted."""

    def __post_init__(self) -> None:
        for values in (self.positions, self.rotations):
            if values is not None:
                self._refuse(np.asarray(~np.isfinite(values).all(axis=2)), " is not finite")
        lost = ~(np.abs(self.skeleton.offsets) <= MOST_FAR).all(axis=1)
        if lost.any():
            name, offset = self.skeleton.names[int(lost.argmax())], self.skeleton.offsets[lost.argmax()]
            raise MotionError(
                f"the offset of joint {name!r} is {offset}, not within {MOST_FAR:g} of its parent", self.source
            )
        if self.rotations is not None:
            norms = np.sqrt(np.vecdot(self.rotations, self.rotations))
            self._refuse(np.abs(norms - 1) > UNIT_NORM, ": the quaternion is not unit")
        if not np.ptp(self.positions, axis=1).any() and len(self.skeleton) > 1:
            raise MotionError("all joints are at one place in every frame", self.source)
        far = np.abs(self.positions).max(axis=2)
        self._refuse(far > MOST_FAR, f" is at {far.max():.3g}, farther than {MOST_FAR:g} from the origin")

    def _refuse(self, wrong: Bools, what: str) -> None:
        """Name the first frame and joint (T, J) that are wrong."""
        if wrong.any():
            frame, joint = np.argwhere(wrong)[0]
            raise MotionError(f"frame {frame}, joint {self.skeleton.names[joint]!r}{what}", self.source)

    def part(self, frames: slice) -> "Capture":
        """Some of the frames."""
        rotations, contacts = (None if v is None else v[frames] for v in (self.rotations, self.contacts))
        return replace(self, positions=self.positions[frames], rotations=rotations, contacts=contacts)


# Options of a caller for the reading of a motion file.

USUAL_FPS = 30.0
"""Default for files without a frame rate, of formats without a usual one [1/s]: 30 of most cameras."""


@dataclass(frozen=True)
class Request:
    """Options of a caller; each reader uses those of its format."""

    fps: float | None = None
    """Frames per second, in place of those in the file [1/s]."""
    names: Sequence[str] | None = None
    """Joint names, for arrays that carry none."""
    clip: str | None = None
    """Which of several motions in the file."""
    body_model: Path | None = None
    """The body model of SMPL parameters."""
    listed: list[str] = field(default_factory=list, compare=False)
    """Names of the motions or people of the file; empty for a single one."""

    def rate(self, stored: float | None = None, usual: float = USUAL_FPS) -> tuple[float, tuple[str, ...]]:
        """Return frames per second: the caller's, else the stored, else the usual ones, with a note unless they are stored.

        Raises:
            MotionError: the rate is out of `RATES`.
        """
        for rate in (self.fps, stored if self.fps is None else None):
            if rate is not None and not RATES[0] <= rate <= RATES[1]:
                raise MotionError(f"frames per second must be from {RATES[0]:g} to {RATES[1]:g}, got {rate:g}")
        if self.fps is not None:
            differs = stored is not None and stored != self.fps
            note = f"Read at {self.fps:g} frames per second; the file says {stored:.4g}." if differs else ""
            return self.fps, (note,) if note else ()
        if stored is None:
            return usual, (f"The file says no frame rate; {usual:g} frames per second were taken.",)
        return stored, ()

    def choose(self, clips: Sequence[str], path: str | Path) -> tuple[int, tuple[str, ...]]:
        """Return the index of the requested clip, or of the first with a note about the others.

        Raises:
            MotionError: no clip has that name; lists those there are.
        """
        if len(clips) > 1 and not self.listed:
            self.listed.extend(clips)
        if self.clip is not None:
            called = [k for k, name in enumerate(clips) if name.lower() == self.clip.lower()]
            if not called:
                raise MotionError(f"holds no motion {self.clip!r}; {known(clips, 100)}", path)
            return called[0], ()
        if len(clips) < 2:
            return 0, ()
        listed = ", ".join(clips[:8]) + (", …" if len(clips) > 8 else "")
        ask = f"{Path(path).name}#{clips[1]}"
        return 0, (f"The first of {len(clips)} motions was read ({listed}); ask for another as {ask!r}.",)


# The header of a file, from which its format is recognised: its first bytes, and the members of an archive.

EXAMINED = 8192
"""Length of the examined beginning [bytes]."""


@dataclass(frozen=True)
class FileHeader:
    """The parts of a file that identify its format."""

    path: Path

    @cached_property
    def head(self) -> bytes:
        """The first bytes of the file."""
        with self.path.open("rb") as file:
            return file.read(EXAMINED)

    @cached_property
    def text(self) -> str:
        """The first bytes as text; empty for a binary file."""
        if self.head.startswith((b"\xff\xfe", b"\xfe\xff")):
            return self.head.decode("utf-16", errors="ignore")
        return "" if b"\0" in self.head else self.head.decode("utf-8-sig", errors="ignore")

    @cached_property
    def members(self) -> tuple[str, ...]:
        """The members of a zip; empty for any other file."""
        return zip_names(self.path) if self.head.startswith(b"PK") else ()

    @cached_property
    def arrays(self) -> frozenset[str]:
        """The names of the arrays in an `.npz`."""
        return frozenset(name.removesuffix(".npy") for name in self.members if name.endswith(".npy"))

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The shape of the array in an `.npy`; empty for any other file."""
        return shape_of(self.path) if self.head.startswith(b"\x93NUMPY") else ()


# Several people in one file: each is a subtree of joints that is a complete human body.

FEWEST = len(SIDES) * sum(map(len, LIMBS.values()))
"""Joints of two legs and two arms."""


def one_performer(capture: Capture, request: Request) -> tuple[Capture, tuple[str, ...]]:
    """The requested one of several people, or the first with a note that lists them; the capture itself if it holds one.

    Raises:
        UsageError: one of several is requested, and it holds one.
        MotionError: no person has the requested name.
    """
    roots = performers(capture)
    if len(roots) < 2:
        if request.clip is not None:
            raise UsageError(
                f"{capture.source}: it holds one motion: none is called {request.clip!r}; leave out its name"
            )
        return capture, ()
    which, notes = request.choose([capture.skeleton.names[root] for root in roots], capture.source)
    return subtree(capture, roots[which]), notes


def performers(capture: Capture) -> list[int]:
    """The root joints of the people, where siblings are human bodies; nothing where fewer than two are.

    A level with one large branch and otherwise single joints is the wrapper of a scene: the search continues below it.
    """
    level = np.flatnonzero(capture.skeleton.parents < 0).tolist()
    while level:
        sizes = [len(capture.skeleton.below(joint)) for joint in level]
        large = [joint for joint, size in zip(level, sizes, strict=True) if size >= FEWEST]
        if len(large) > 1:
            return [joint for joint in large if is_human(subtree(capture, joint))]
        if not large or sorted(sizes)[:-1] != [1] * (len(sizes) - 1):
            return []
        level = np.flatnonzero(capture.skeleton.parents == large[0]).tolist()
    return []


def is_human(capture: Capture) -> bool:
    """Whether the joints are those of a human body."""
    try:
        recognise(capture.skeleton, capture.positions)
    except MatchError:
        return False
    return True


def subtree(capture: Capture, joint: int) -> Capture:
    """The capture of a joint and all that it carries.

    Args:
        joint: index of the joint.
    """
    kept = capture.skeleton.below(joint)
    place = {old: new for new, old in enumerate(kept)}
    old = capture.skeleton
    parents = np.array([place.get(int(old.parents[k]), -1) for k in kept])
    skeleton = Skeleton(tuple(old.names[k] for k in kept), parents, old.offsets[kept])
    rotations = None if capture.rotations is None else capture.rotations[:, kept]
    return replace(capture, skeleton=skeleton, positions=capture.positions[:, kept], rotations=rotations)
