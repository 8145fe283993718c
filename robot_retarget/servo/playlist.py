"""Several judged clips in one playback, with idle motion or a pause between them."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import ServoError, known
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.servo.plan import SEAM, ServoPlan

LONGEST = 3600.0
"""A longer pause, or more repetitions, is a mistake [s] or [-]."""


@dataclass(frozen=True)
class Piece:
    """A plan of a playback, with its branches into a stand."""

    plan: ServoPlan
    ways: Sequence[ServoPlan] = ()
    name: str = ""
    pause: float = 0.0
    """Time in its first pose before it begins [s]."""


@dataclass(frozen=True)
class Playlist:
    """Clips in order; the idle motion fills the pauses."""

    files: tuple[Path, ...]
    pauses: tuple[float, ...]
    """After each clip [s]."""
    idle: Path | None = None

    def pieces(self, of: Mapping[Path, Piece]) -> list[Piece]:
        """Return the pieces of a playback.

        Args:
            of: the piece of every file.
        """
        pieces, before = [], 0.0
        for file, pause in zip(self.files, self.pauses, strict=True):
            idle = None if self.idle is None else of[self.idle]
            times = 0 if idle is None or not before else max(1, round(before / max(idle.plan.duration, 1e-9)))
            pieces += [idle] * times if idle else []
            piece = of[file]
            pieces.append(piece if times else Piece(piece.plan, piece.ways, piece.name, before))
            before = pause
        return pieces


def read_playlist(path: str | Path) -> Playlist:
    """Read a playlist: a table [[clip]] with `file` and `pause` [s] for each clip, `idle` and `repeat` above them.

    Files are relative to the playlist.

    Raises:
        ServoError: the file is no playlist; the message names the key.
    """
    tables = read_toml(path, ServoError)
    _require(path, tables, ("idle", "repeat", "clip"), "a playlist")
    clips, repeat, idle = tables.get("clip"), tables.get("repeat", 1), tables.get("idle")
    if not isinstance(clips, list) or not clips or not all(isinstance(clip, dict) for clip in clips):
        raise ServoError(f"{path}: a playlist has a table [[clip]] for each clip")
    if not isinstance(repeat, int) or not 1 <= repeat <= LONGEST or not isinstance(idle, str | None):
        raise ServoError(f"{path}: repeat is a number from 1, idle a file")
    folder, files, pauses = Path(path).parent, list[Path](), list[float]()
    for k, clip in enumerate(clips, 1):
        _require(path, clip, ("file", "pause"), f"clip {k}")
        file, pause = clip.get("file"), clip.get("pause", 0.0)
        if not isinstance(file, str) or not isinstance(pause, int | float) or not 0 <= pause <= LONGEST:
            raise ServoError(f"{path}: clip {k}: file is a trajectory, pause a time in 0…{LONGEST:g} s")
        files.append(folder / file)
        pauses.append(float(pause))
    return Playlist(tuple(files * repeat), tuple(pauses * repeat), None if idle is None else folder / idle)


def _require(path: str | Path, table: Mapping[str, Any], keys: Sequence[str], what: str) -> None:
    strange = next((key for key in table if key not in keys), None)
    if strange is not None:
        raise ServoError(f"{path}: {what} has no {strange!r}; {known(keys, typed=strange)}")


def require_same_stands(pieces: Sequence[Piece], joints: Sequence[str]) -> None:
    """Check that each piece begins in the final stand of the previous piece: feet on a floor do not move.

    Raises:
        ServoError: two stands differ by more than `SEAM`, or two rates differ.
    """
    for before, after in itertools.pairwise(pieces):
        if before.plan.rate != after.plan.rate:
            raise ServoError(f"{before.name} has {before.plan.rate:g} goals a second, {after.name} {after.plan.rate:g}")
        apart = np.abs(before.plan.angles[-1] - after.plan.angles[0])
        if apart.max() > SEAM:
            joint = joints[int(apart.argmax())]
            raise ServoError(
                f"{after.name} begins {apart.max():.2f} rad ({joint}) from the stand in which {before.name} ends: "
                "`robot-retarget join` makes one trajectory of them"
            )
