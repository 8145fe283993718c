"""Sources of robots: shipped ones, an MJCF or URDF file, or a `robot_descriptions` name."""

import importlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from robot_retarget.actuators.map import load_map
from robot_retarget.base.errors import MatchError, RobotError, did_you_mean, install_line, known
from robot_retarget.base.files import MODELS
from robot_retarget.base.keypoints import ARM
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.base.untrusted.limits import one_line
from robot_retarget.robot.anatomy import Anatomy
from robot_retarget.robot.limbs import ARM_WORDS, words
from robot_retarget.robot.links import Links
from robot_retarget.robot.model import Robot, robot_from_model, with_servos
from robot_retarget.robot.recognise import recognise
from robot_retarget.robot.source import (
    Quaternion,
    compiled,
    is_urdf,
    omission_notes,
    read_spec,
    require_finite,
    urdf_speeds,
)
from robot_retarget.robot.stand import with_arms_down
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.trajectory import Trajectory, load_trajectory

# Names that people type for robots of `robot_descriptions`: `g1`, `unitree_g1`, `t1`, `toddlerbot`.

KINDS = {"_mj_description": "MJCF_PATH", "_description": "URDF_PATH"}
"""How the package ends the names of its modules, and where each says its file is; MJCF goes first."""


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
            f"unknown robot {name!r}; {did_you_mean(name, shipped)}{choices}; robots of robot_descriptions (g1, h1, t1 …) need: {install_line('descriptions')}"
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
MODEL_FILES, XACRO = (".xml", ".mjcf", ".urdf"), ".xacro"
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
    names = robot.joint_names
    for joint in (joint for table in tables.values() for joint in table if joint not in ("*", *names)):
        raise RobotError(f"{side_file}: {path.name} has no joint {joint!r}; {known(names, 40, typed=joint)}")
    robot = _stood(robot, tables) if robot.floating or not robot.root_joints.size else robot
    own = path.with_name("servos.toml")
    found = servos if servos is not None else own if own.is_file() else None
    return robot if found is None else with_servos(robot, load_map(found, bare=True))


def as_robot(robot: Robot | str | Path) -> Robot:
    """Return a given robot, or load the one of a name or model file (`load_robot`)."""
    return robot if isinstance(robot, Robot) else load_robot(robot)


def _loaded(path: Path, tables: Limits, notes: tuple[str, ...] = (), freed: Quaternion | None = None) -> Robot:
    spec = read_spec(path, freed)
    try:
        model = compiled(spec, path, freed)
        require_finite(model)
        speeds = urdf_speeds(path) if is_urdf(path) else {}
    except ValueError as error:
        raise RobotError(f"{path}: MuJoCo does not load it: {one_line(str(error))}") from error
    tables = {**tables, "speed": {**speeds, **tables.get("speed", {})}}
    robot = robot_from_model(model, path, path.stem, tables, (*omission_notes(path), *notes), freed)
    return replace(robot, arms_down=with_arms_down)


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
        lay = "" if turn == UPRIGHT[0] else ", and stood up from where it lies"
        note = LYING if robot.floating else NO_ROOT + lay
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
    shipped, path = shipped_robots(), Path(name)
    if str(name).lower() in shipped:
        return shipped[str(name).lower()]
    if path.suffix.lower() in MODEL_FILES:
        if not path.is_file():
            raise RobotError(f"there is no file {path}")
        return path
    if path.suffix.lower() == XACRO:
        made = path.with_name(f"{path.name.partition('.')[0]}.urdf")
        raise RobotError(f"{path} is a template of URDFs; expand it, and give {made}: xacro {path} > {made}")
    return described(str(name), tuple(shipped))


def _beside(path: Path) -> Path | None:
    candidates = path.with_name(f"{path.stem}.limits.toml"), path.with_name("limits.toml")
    return next((candidate for candidate in candidates if candidate.is_file()), None)


# A trajectory with its robot, in the forms that the public functions accept.


class Retargeted(Protocol):
    """A result of `retarget`."""

    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def robot(self) -> Robot: ...


Played = Retargeted | Trajectory | str | Path
"""A result, a trajectory, or the path of its file."""


def on_robot(played: Played, robot: Robot | str | Path | None = None) -> tuple[Trajectory, Robot]:
    """Return a trajectory and its robot; by default the robot of the result, or the one that the trajectory names.

    Raises:
        TrajectoryError: the file cannot be read, or is of another robot.
        RobotError: no robot has the name, or its file does not load.
    """
    given = load_trajectory(played) if isinstance(played, str | Path) else played
    trajectory = given if isinstance(given, Trajectory) else given.trajectory
    found = as_robot(given.robot if robot is None else robot)
    require_same_robot(trajectory, found)
    return trajectory, found
