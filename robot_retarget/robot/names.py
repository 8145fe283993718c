"""Names that people type for robots of `robot_descriptions`: `g1`, `unitree_g1`, `t1`, `toddlerbot`."""

import importlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from robot_retarget.base.errors import RobotError, did_you_mean, install_line, known

KINDS = {"_mj_description": "MJCF_PATH", "_description": "URDF_PATH"}
"""How the package ends the names of its modules, and where each says its file is; MJCF goes first."""
EXTRA = install_line("descriptions")


def described(name: str, shipped: tuple[str, ...]) -> Path:
    """The MJCF of a robot by any of its names, its URDF where the package has no MJCF; fetched once by the package.

    Args:
        shipped: The robots that ship, for the message.

    Raises:
        RobotError: the name is unknown, the package is not installed, or it cannot fetch the robot.
    """
    choices = f"{known(shipped)}; or a path to an MJCF (.xml) or URDF"
    try:
        from robot_descriptions._descriptions import DESCRIPTIONS
    except ImportError:
        raise RobotError(
            f"unknown robot {name!r}; {did_you_mean(name, shipped)}{choices}; robots of robot_descriptions (g1, h1, t1 …) need: {EXTRA}"
        ) from None
    entries = humanoids(DESCRIPTIONS)
    module = resolved(name, entries)
    if not module:
        stems = dict.fromkeys(_stem(key)[0] for key in entries)
        near = did_you_mean(name, (*shipped, *stems))
        raise RobotError(f"unknown robot {name!r}; {near}{choices}; or one of robot_descriptions, {known(stems, 60)}")
    kind = _stem(module)[1]
    try:
        return Path(getattr(importlib.import_module(f"robot_descriptions.{module}"), KINDS[kind]))
    except Exception as error:  # the package clones with git and lets any of its errors through
        reason = " ".join(str(error).split())[:200]
        line = f'python -c "import robot_descriptions.{module}"'
        raise RobotError(
            f"{name} is {module} of robot_descriptions, which is not here: {reason}. With git and a network, this gets it: {line}"
        ) from error


def humanoids(descriptions: Mapping[str, Any]) -> dict[str, str]:
    """The package's humanoids: module → the first word of the maker's name, small."""
    return {
        key: (entry.maker or "").split()[0].lower() if entry.maker else ""
        for key, entry in descriptions.items()
        if "humanoid" in entry.tags and _stem(key)[1]
    }


def resolved(name: str, entries: Mapping[str, str]) -> str | None:
    """The module that a name means: its own name, its stem, with or without the maker, or the first of a family.

    Args:
        name: as typed.
        entries: module → maker.
    """
    typed = name.lower().replace("-", "_").replace(" ", "_")
    if typed in entries:
        return typed
    ordered = sorted(entries, key=lambda key: list(KINDS).index(_stem(key)[1]))
    whole = [key for key in ordered if typed in _called(key, entries[key])]
    family = [key for key in ordered if _stem(key)[0].startswith(f"{typed}_")]
    return next(iter([*whole, *family]), None)


def _called(module: str, maker: str) -> Iterable[str]:
    """Return the names of a robot: `booster_t1`, `t1`."""
    stem = _stem(module)[0]
    bare = stem.removeprefix(f"{maker}_") if maker else stem
    return {stem, bare, f"{maker}_{bare}"}


def _stem(module: str) -> tuple[str, str]:
    """A module's name without its ending, and the ending."""
    kind = next((kind for kind in KINDS if module.endswith(kind)), "")
    return module.removesuffix(kind), kind
