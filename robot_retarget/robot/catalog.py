"""Where robots come from: those that ship, an MJCF file, or a `robot_descriptions` name."""

import tomllib
from pathlib import Path
from typing import Any

import mujoco

from robot_retarget.errors import RobotError, known
from robot_retarget.robot.model import Robot, robot_from_model
from robot_retarget.shipped import MODELS

LIMIT_TABLES = ("range", "speed", "torque")


def shipped_robots() -> dict[str, Path]:
    """The robots that ship: name → MJCF file."""
    return {folder.name: folder / f"{folder.name}.xml" for folder in sorted(MODELS.iterdir()) if folder.is_dir()}


def load_robot(name: str | Path, limits: str | Path | None = None) -> Robot:
    """Load a robot by a shipped name, an MJCF path, or a `robot_descriptions` name (extra `descriptions`).

    Args:
        name: `op3`, `path/to/robot.xml`, or `g1_mj_description`.
        limits: a TOML file of joint limits that fill or replace the model's, tables `range` [rad], `speed` [rad/s]
            and `torque` [N m] by joint name (`"*"` = every joint). Without it, `limits.toml` or `STEM.limits.toml`
            beside the MJCF is read where it is there.

    Raises:
        RobotError: the name is unknown (the known ones are listed), the MJCF does not load, the model has no hinges or
            has a ball joint, or the limits name a joint that is not there.
    """
    path = _find(name)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise RobotError(f"{path}: MuJoCo does not load it: {' '.join(str(error).split())}") from error
    side_file = Path(limits) if limits is not None else _beside(path)
    tables = read_limits(side_file) if side_file is not None else None
    return robot_from_model(model, path, path.stem, tables)


def read_limits(path: Path) -> dict[str, dict[str, Any]]:
    """The tables of a limits file.

    Raises:
        RobotError: not TOML, a table that is not known, or a value of the wrong shape.
    """
    tables = read_toml(path)
    for key, table in tables.items():
        if key not in LIMIT_TABLES:
            raise RobotError(f"{path}: unknown table [{key}]; {known(LIMIT_TABLES)}")
        for joint, value in table.items():
            pair = isinstance(value, list) and len(value) == 2 and all(isinstance(v, int | float) for v in value)
            if not (pair if key == "range" else isinstance(value, int | float)):
                wanted = "[lower, upper]" if key == "range" else "a number"
                raise RobotError(f"{path}: [{key}] {joint} must be {wanted}, got {value!r}")
    return tables


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file as a dictionary; RobotError when it cannot be read."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RobotError(f"cannot read {path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RobotError(f"{path}: not TOML: {error}") from error


def _find(name: str | Path) -> Path:
    shipped = shipped_robots()
    path = Path(name)
    if str(name) in shipped:
        return shipped[str(name)]
    if path.suffix.lower() in (".xml", ".mjcf"):
        if not path.is_file():
            raise RobotError(f"there is no file {path}")
        return path
    return _description(str(name), list(shipped))


def _description(name: str, shipped: list[str]) -> Path:
    """The MJCF of a `robot_descriptions` entry; the package downloads it once."""
    choices = f"{known(shipped)}; or a path to an MJCF (.xml)"
    try:
        from robot_descriptions import DESCRIPTIONS  # pyright: ignore[reportMissingImports]
        from robot_descriptions._descriptions import Format  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise RobotError(
            f"unknown robot {name!r}; {choices}; or a robot_descriptions name, with the extra "
            "robot-retarget[descriptions] installed"
        ) from None
    entries = [key for key, entry in DESCRIPTIONS.items() if Format.MJCF in entry.formats]
    if name not in entries:
        raise RobotError(f"unknown robot {name!r}; {choices}; or a robot_descriptions name, {known(entries)}")
    import importlib

    try:
        return Path(importlib.import_module(f"robot_descriptions.{name}").MJCF_PATH)
    except Exception as error:  # the package clones with git and lets any of its errors through
        raise RobotError(f"robot_descriptions could not fetch {name!r}: {error}") from error


def _beside(path: Path) -> Path | None:
    for candidate in (path.with_name(f"{path.stem}.limits.toml"), path.with_name("limits.toml")):
        if candidate.is_file():
            return candidate
    return None
