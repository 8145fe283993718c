"""The header of a file, from which its format is recognised: its first bytes, and the members of an archive."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from robot_retarget.base.untrusted.arrays import shape_of
from robot_retarget.base.untrusted.limits import zip_names

HEAD = 8192
"""Length of the examined beginning [bytes]."""


@dataclass(frozen=True)
class FileHeader:
    """The parts of a file that identify its format."""

    path: Path

    @cached_property
    def head(self) -> bytes:
        """The first bytes of the file."""
        with self.path.open("rb") as file:
            return file.read(HEAD)

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
