"""Compile a specification, or load its model from the user's cache: hulls of large meshes take long to compute."""

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import mujoco

from robot_retarget.base.cache import cache_folder, drop_oldest, is_sound, keeping, private_cache
from robot_retarget.base.errors import OutputError
from robot_retarget.robot import source

LEAST = 5e6
"""Models with smaller assets compile about as fast as they load [bytes]."""
MOST = 1e9
"""The kept models take no more: one of a robot with detailed meshes takes .1 of it [bytes]."""


def compiled(spec: mujoco.MjSpec, path: Path, freed: source.Quaternion | None = None) -> mujoco.MjModel:
    """Return the model of a specification that `source.read_spec` read from a file.

    Args:
        spec: the specification, unchanged since it was read.
        path: the file.
        freed: as in `source.read_spec`.

    Raises:
        ValueError: MuJoCo does not compile it.
    """
    kept = _place(spec, path, freed)
    try:
        if kept is not None and is_sound(kept):
            return mujoco.MjModel.from_binary_path(str(kept))
    except (OSError, ValueError):
        pass  # it is compiled again
    model = spec.compile()
    if kept is not None:
        _keep(model, kept)
    return model


def _keep(model: mujoco.MjModel, place: Path) -> None:
    """Write a model to the cache, if that is writable."""
    try:
        private_cache()
        with keeping(place) as scratch:
            mujoco.mj_saveModel(model, str(scratch))
        drop_oldest("*.mjb", MOST)
    except (OutputError, OSError):
        return


def _place(spec: mujoco.MjSpec, path: Path, freed: source.Quaternion | None) -> Path | None:
    """Return where a model is kept, by a hash of all that determines it; None for one with small or unknown files."""
    try:
        assets = _assets(spec)
        if sum(asset.stat().st_size for asset in assets) < LEAST:
            return None
        digest = hashlib.sha256(
            repr((mujoco.__version__, freed, assets)).encode()
        )  # a model holds the paths of its assets
        for file in (Path(source.__file__), *_documents(path), *assets):
            digest.update(file.read_bytes())
    except (OSError, KeyError, ET.ParseError):
        return None
    return cache_folder() / f"{digest.hexdigest()}.mjb"


def _documents(path: Path) -> Iterator[Path]:
    """Yield a model file and those that it includes.

    Raises:
        FileNotFoundError: it attaches a whole model, whose assets are not listed.
    """
    yield path
    for element in ET.parse(path).iter():
        if element.tag == "include":
            yield from _documents(path.parent / element.attrib["file"])
        elif element.tag == "model":
            raise FileNotFoundError(element.get("file"))


def _assets(spec: mujoco.MjSpec) -> list[Path]:
    """Return the files of meshes, textures, height fields and skins."""
    folder = Path(spec.modelfiledir)
    textures = [name for texture in spec.textures for name in (texture.file, *texture.cubefiles)]
    shapes = [asset.file for asset in (*spec.meshes, *spec.hfields, *spec.skins)]
    placed = [(spec.texturedir, name) for name in textures] + [(spec.meshdir, name) for name in shapes]
    return [folder / where / name for where, name in placed if name]
