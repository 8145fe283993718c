"""Bounds of a robot's file, checked before MuJoCo reads it: few bytes of MJCF can ask for gigabytes."""

import math
import re
from html import unescape
from pathlib import Path

from robot_retarget.base.errors import RobotError

BODIES = 2000
"""Largest number of bodies, or of links of a URDF, replicas included; the models of MuJoCo Menagerie have up to 100."""
ELEMENTS = 100_000
"""Largest number of elements, replicas included; the models of Menagerie have up to 5,000."""
DEPTH = 200
"""Largest depth of elements in each other: MuJoCo and readers of XML descend by recursion."""
VALUES = 6 * 4096**2
"""Largest number of pixels of a texture, a cube of six faces, and of heights of a field."""
MEMORY = 1 << 30
"""Largest arena of the simulation [bytes]; MuJoCo's default is 100 times the model."""
BYTES = 64 << 20
"""Largest model file without its meshes [bytes]."""
COUNTED = ("replicate", "composite", "flexcomp")
"""Elements whose `count` multiplies their content."""
TAG = re.compile(
    r"""<!--(?:.*?-->|.*)|<!\[CDATA\[(?:.*?\]\]>|.*)|<(/?)([\w:.-]+)((?:[^<>"'/]|"[^"]*"|'[^']*'|/(?!>))*)(/?)>?""",
    re.DOTALL,
)
"""A tag, with what MuJoCo's reader forgives: files that are read need not be well-formed."""
ATTRIBUTE = re.compile(r"""([\w:.-]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
UNITS = {"K": 10, "M": 20, "G": 30, "T": 40, "P": 50, "E": 60}
"""Suffixes of a size in memory, as powers of two."""


def require_bounded_model(path: Path) -> None:
    """Require that a model file and the files that it includes stay within the bounds of this module.

    Raises:
        RobotError: a file does not, or is no XML in UTF-8; names the line, the value and the bound.
        OSError: it cannot be read.
    """
    left, seen, total = [path], set[Path](), _Total()
    while left:
        file = left.pop()
        if file in seen or not file.is_file():
            continue  # MuJoCo names an included file that is absent
        seen.add(file)
        if file.stat().st_size > BYTES:
            raise RobotError(f"{file} has {file.stat().st_size >> 20} MB without its meshes, more than {BYTES >> 20}")
        try:
            left += total.add(file)
        except UnicodeDecodeError as error:
            raise RobotError(f"{file}: MuJoCo does not load it: no text in UTF-8: {error.reason}") from error


class _Total:
    """Sums over the files of a model: bodies and elements."""

    def __init__(self) -> None:
        self.elements, self.bodies = 0.0, 0.0

    def add(self, file: Path) -> list[Path]:
        """Add a file, and return the files that it includes."""
        text, times, included = file.read_bytes().decode("utf-8-sig"), [1.0], list[Path]()
        for found in TAG.finditer(text):
            closing, tag, written, empty = found.groups()
            if tag is None:
                continue
            if closing:
                times = times[: max(len(times) - 1, 1)]
                continue
            attributes = {name: unescape(a or b or "") for name, a, b in ATTRIBUTE.findall(written)}
            self.elements += times[-1]
            self.bodies += times[-1] * (tag in ("body", "link"))
            inside = times[-1] * (_product(attributes, "count") if tag in COUNTED else 1)
            asked = {
                "bodies": (self.bodies, BODIES),
                "elements": (max(self.elements, inside), ELEMENTS),
                "elements in each other": (len(times), DEPTH),
                "pixels of a texture": (_product(attributes, "width", "height") * (tag == "texture"), VALUES),
                "heights of a field": (_product(attributes, "nrow", "ncol") * (tag == "hfield"), VALUES),
                "bytes of memory": (_bytes(attributes.get("memory", "")) * (tag == "size"), MEMORY),
            }
            for what, (count, most) in asked.items():
                if count > most:
                    line = 1 + text.count("\n", 0, found.start())
                    raise RobotError(f"{file}: line {line}: {count:.4g} {what}, more than {most:,}")
            if not empty:
                times.append(inside)
            if tag in ("include", "model") and "file" in attributes:
                included.append(file.parent / attributes["file"])
        return included


def _product(attributes: dict[str, str], *names: str) -> float:
    """Return the product of all numbers of some attributes, 1 without them."""
    return math.prod(max(_number(word), 1.0) for name in names for word in attributes.get(name, "1").split())


def _bytes(memory: str) -> float:
    """Return a size in memory as MuJoCo writes it, such as `64M`."""
    word = memory.strip().upper()
    return _number(word.rstrip("KMGTPE")) * 2.0 ** UNITS.get(word[-1:], 0)


def _number(word: str) -> float:
    """Return a number; 0 for any other word, which MuJoCo refuses."""
    try:
        return float(word)
    except ValueError:
        return 0.0
