"""Files of models are compiled once in a process with limits, before MuJoCo reads them here."""

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from robot_retarget.base.cache import cache_folder, is_own, private_cache
from robot_retarget.base.errors import OutputError, RobotError
from robot_retarget.base.files import MODELS, SAMPLES, replacing
from robot_retarget.base.untrusted import child, models_child

BYTES = 64 << 20
"""Largest model file without its meshes [bytes]."""
KNOWN = "models.txt"
"""The file of the cache with the hashes of models that were compiled."""
KEPT_HASHES = 1000
"""Number of hashes that are kept."""


def require_bounded_model(path: Path, reader: Path | None = None) -> None:
    """Require that a model compiles with limited memory and time.

    Shipped models are trusted, and so are files that compiled before and whose text is the same.

    Args:
        path: the model.
        reader: a module whose `parsed` reads the model; by default MuJoCo reads it.

    Raises:
        RobotError: the file is too large, or the model takes more than it may.
        ValueError: MuJoCo refuses it.
        OSError: it cannot be read.
    """
    if any(path.resolve().is_relative_to(folder.resolve()) for folder in (MODELS, SAMPLES)):
        return
    if (size := path.stat().st_size) > BYTES:
        raise RobotError(f"{path} has {size >> 20} MB without its meshes, more than {BYTES >> 20}")
    key = _key(path, reader)
    known = _known()
    if key in known:
        return
    code, said = child.run(
        models_child.__file__, str(path.absolute()), str(models_child.SECONDS), *([] if reader is None else [str(reader)]),
        patience=2 * models_child.SECONDS,
    )  # fmt: skip
    if code == child.BROKEN:
        raise ValueError(said)
    if code != 0:
        most = f"more than {models_child.MEMORY >> 20} MB, {models_child.SECONDS} s or MuJoCo's stack"
        raise RobotError(f"{path}: the model asks for too much: {said if code == child.TOO_MUCH and said else most}")
    if key:
        _keep([*known, key][-KEPT_HASHES:])


def _key(path: Path, reader: Path | None) -> str:
    """Return the hash of a model's text, and of its folder if it has other files; it is empty for a text that only MuJoCo reads."""
    digest, outside = hashlib.sha256(repr((version("mujoco"), reader)).encode()), False
    try:
        for file in documents(path):
            digest.update(file.read_bytes())
            tags = ET.parse(file).iter()
            outside |= any(name.startswith("file") for tag in tags if tag.tag != "include" for name in tag.attrib)
    except (OSError, KeyError, ET.ParseError, RecursionError):
        return ""
    digest.update(str(path.resolve().parent).encode() if outside else b"")
    return digest.hexdigest()


def documents(path: Path) -> Iterator[Path]:
    """Yield a model file and those that it includes.

    Raises:
        FileNotFoundError: it attaches a whole model, whose assets are not listed.
    """
    yield path
    for element in ET.parse(path).iter():
        if element.tag == "include":
            yield from documents(path.parent / element.attrib["file"])
        elif element.tag == "model":
            raise FileNotFoundError(element.get("file"))


def _known() -> list[str]:
    """The hashes of models that were compiled before."""
    file = cache_folder() / KNOWN
    try:
        return file.read_text(encoding="ascii").split() if is_own(file) else []
    except (OSError, ValueError):
        return []


def _keep(hashes: list[str]) -> None:
    """Write the hashes to the cache, if that is writable."""
    try:
        private_cache()
        with replacing(cache_folder() / KNOWN, mode=0o600) as scratch:
            scratch.write_text("\n".join(hashes), encoding="ascii")
    except (OutputError, OSError):
        return
