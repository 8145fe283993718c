"""Sources of robots: shipped ones, an MJCF or URDF file, or a `robot_descriptions` name."""

from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.map import load_map
from robot_retarget.base.errors import MatchError, RobotError, known
from robot_retarget.base.files import MODELS
from robot_retarget.base.keypoints import ARM
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.base.untrusted.limits import one_line
from robot_retarget.robot.anatomy import Anatomy
from robot_retarget.robot.compile import compiled
from robot_retarget.robot.limbs import ARM_WORDS, words
from robot_retarget.robot.links import Links
from robot_retarget.robot.model import Robot, robot_from_model
from robot_retarget.robot.names import described
from robot_retarget.robot.recognise import recognise
from robot_retarget.robot.servos import with_servos
from robot_retarget.robot.source import (
    Quaternion,
    is_urdf,
    omission_notes,
    read_spec,
    require_finite,
    urdf_notes,
    urdf_speeds,
)

Limits = dict[str, dict[str, Any]]
LARGEST_ANGLE = 2 * np.pi
"""A range beyond a turn either way is a mistake, most often of the unit [rad]."""
FASTEST = 1000.0
"""A faster joint is a mistake [rad/s]."""
LIMIT_TABLES = {
    "range": ("[lower, upper]", f"radians within ±{LARGEST_ANGLE:.2f}; more looks like degrees"),
    "speed": ("a number", f"over 0, at most {FASTEST:g} rad/s"),
    "torque": ("a number", "over 0 N m; inf for no limit"),
}
"""The tables of a limits file, with the form and the bounds of their values."""
UPRIGHT: tuple[Quaternion, ...] = (
    (1, 0, 0, 0),
    *((0.5**0.5, *(sign * 0.5**0.5 * axis for axis in way)) for way in ((1, 0, 0), (0, 1, 0)) for sign in (1, -1)),
    (0, 1, 0, 0),
)
"""Turns after which z, ±y, ±x and −z of a model point up."""
MODEL_FILES = (".xml", ".mjcf", ".urdf")
NO_ROOT = "the model has no root joint: a free joint added, since it has legs"
LYING = "the model lies in its reference pose: stood up"


def shipped_robots() -> dict[str, Path]:
    """Return the shipped robots: name → MJCF file."""
    return {folder.name: folder / f"{folder.name}.xml" for folder in sorted(MODELS.iterdir()) if folder.is_dir()}


def load_robot(name: str | Path, limits: str | Path | None = None, servos: str | Path | None = None) -> Robot:
    """Load a robot by a shipped name, an MJCF or URDF path, or a `robot_descriptions` name (extra `descriptions`).

    Args:
        name: `op3`, `path/to/robot.xml`, or `g1`, `unitree_g1`, `g1_mj_description`.
        limits: a TOML file of joint limits that fill or replace the model's, tables `range` [rad], `speed` [rad/s] and
            `torque` [N m] by joint name (`"*"` = every joint). By default `limits.toml` or `STEM.limits.toml` next to
            the MJCF applies, if it exists.
        servos: the map of the servos that turn its joints (`actuators.map.load_map`); by default `servos.toml` next to the
            MJCF, if it exists. Planned motions keep the servos' ranges and speed.

    Raises:
        RobotError: the name is unknown (the message lists the known ones), the MJCF does not load, the model has no
        hinges or has a ball joint, the limits name an absent joint, or a joint has no servo in the map.
        ServoError: the servo map cannot be read.
    """
    path = _find(name)
    side_file = Path(limits) if limits is not None else _beside(path)
    tables = read_limits(side_file) if side_file is not None else {}
    robot = _loaded(path, tables)
    robot = _stood(robot, tables) if robot.floating or not robot.root_joints.size else robot
    own = path.with_name("servos.toml")
    found = servos if servos is not None else own if own.is_file() else None
    return robot if found is None else with_servos(robot, load_map(found, bare=True))


def as_robot(robot: Robot | str | Path) -> Robot:
    """Return a robot as it is, or the one of a name or model file (`load_robot`)."""
    return robot if isinstance(robot, Robot) else load_robot(robot)


def _loaded(path: Path, tables: Limits, notes: tuple[str, ...] = (), freed: Quaternion | None = None) -> Robot:
    spec = read_spec(path, freed)
    try:
        model = compiled(spec, path, freed)
        require_finite(model)
        speeds = urdf_speeds(path) if is_urdf(path) else {}
    except ValueError as error:
        raise RobotError(f"{path}: MuJoCo does not load it: {one_line(str(error))}") from error
    notes = (*omission_notes(path), *notes)
    if is_urdf(path):
        notes = (*urdf_notes(path), *notes)
        tables = {**tables, "speed": {**speeds, **tables.get("speed", {})}}
    return robot_from_model(model, path, path.stem, tables, notes, freed)


def _stood(robot: Robot, tables: Limits) -> Robot:
    """Return the robot upright on a free joint if it has legs to stand on; otherwise return it unchanged.

    A model without a root joint does not define which way is up, and a floating one may lie in its reference pose. A
    model that gains legs only after a turn, with named arms over them, lies in its file.
    """
    if not robot.floating and robot.model.body_jntnum[robot.root_body]:  # it turns against the world
        return robot
    if robot.floating and _legged(robot):
        return robot
    for turn in UPRIGHT[1:] if robot.floating else UPRIGHT:
        note = (
            LYING
            if robot.floating
            else NO_ROOT
            if turn == UPRIGHT[0]
            else f"{NO_ROOT}, and stood up from where it lies"
        )
        upright = _loaded(robot.path, tables, (note,), turn)
        found = _legged(upright)
        if found and (turn == UPRIGHT[0] or _has_named_arms(upright, found)):
            return upright
    return robot


def _legged(robot: Robot) -> Anatomy | None:
    """Return the anatomy of a robot with legs; None without legs."""
    try:
        found = recognise(robot)
    except MatchError:
        return None
    return found if found.soles else None


def _has_named_arms(robot: Robot, found: Anatomy) -> bool:
    links = Links(robot)
    arms = [found.sites[f"{side}_{k}"].body for side in "lr" for k in ARM if f"{side}_{k}" in found.sites]
    return any(words(links.words(int(links.weld[body]))) & ARM_WORDS for body in arms)


def read_limits(path: Path) -> Limits:
    """Return the tables of a limits file.

    Raises:
        RobotError: the file is no TOML, has an unknown table, or a value of the wrong shape.
    """
    tables = read_toml(path, RobotError)
    for key, table in tables.items():
        if key not in LIMIT_TABLES:
            raise RobotError(f"{path}: unknown table [{key}]; {known(LIMIT_TABLES, typed=key)}")
        if not isinstance(table, dict):
            raise RobotError(f"{path}: {key} must be a table, [{key}], got {table!r}")
        for joint, value in table.items():
            if not _is_limit(key, value):
                form, bounds = LIMIT_TABLES[key]
                raise RobotError(f"{path}: [{key}] {joint} must be {form}, got {value!r} ({bounds})")
    return tables


def _is_limit(table: str, value: Any) -> bool:
    """Whether a value of a limits file has the form that `LIMIT_TABLES` states."""
    values: list[Any] = value if isinstance(value, list) and table == "range" else [value]
    if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        return False
    if table == "range":
        return len(values) == 2 and all(abs(v) <= LARGEST_ANGLE for v in values)
    return all(0 < v <= (FASTEST if table == "speed" else np.inf) for v in values)


def _find(name: str | Path) -> Path:
    shipped = shipped_robots()
    path = Path(name)
    if str(name).lower() in shipped:
        return shipped[str(name).lower()]
    if path.suffix.lower() in MODEL_FILES:
        if not path.is_file():
            raise RobotError(f"there is no file {path}")
        return path
    return described(str(name), tuple(shipped))


def _beside(path: Path) -> Path | None:
    for candidate in (path.with_name(f"{path.stem}.limits.toml"), path.with_name("limits.toml")):
        if candidate.is_file():
            return candidate
    return None
