"""Scenes from files: MJCF or URDF, or TOML with one table `[[body]]` per body, with its shape and pose.

[[body]]
name = "box"
shape = "box"                # box, cylinder, sphere, plane, mesh, height field
size = [0.4, 0.3, 0.3]       # whole edges [m]
carrier = "Prop1"            # a joint of the motion file; or position = [x, y, z]; or poses = "file.npz"
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import FileError, SceneError, known
from robot_retarget.base.untrusted.arrays import load_arrays
from robot_retarget.base.untrusted.documents import parse_toml, read_text
from robot_retarget.base.untrusted.limits import refusing
from robot_retarget.scene import mjcf
from robot_retarget.scene.geoms import read_mesh
from robot_retarget.scene.poses import ORDERS, PoseTable, read_poses
from robot_retarget.scene.scene import FRICTION, RigidBody, Scene
from robot_retarget.scene.shape import EDGES, BodyShape, ShapeKind, height_field, solid

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "Meters": 1.0, "Centimeters": 0.01, "Millimeters": 0.001}
"""Metres in each unit, by the names of this format and of OptiTrack."""
TURNS = {"x": [1, 2, 0], "y": [2, 0, 1], "z": [0, 1, 2]}
"""Axes of a file that become x, y, z, per axis that points up: as for motions."""
KEYS = {
    "name", "shape", "size", "file", "model", "position", "quaternion", "carrier", "poses", "order", "fps", "unit", "up",
    "mass", "friction",
}  # fmt: skip
Choice = TypeVar("Choice")
EXCLUSIVE = (("carrier", "poses"), ("position", "poses"), ("model", "shape"), ("model", "size"), ("model", "file"))
"""Pairs of keys that contradict each other."""


def read_toml_scene(path: Path) -> Scene:
    """Read a scene file.

    Raises:
        SceneError: an unknown key, a missing or wrong value, or a file that a body names and that cannot be read.
    """
    text = read_text(path, SceneError)
    tables = parse_toml(text, path, SceneError)
    entries = tables.get("body")
    if set(tables) != {"body"} or not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise SceneError(f"{path}: a scene is a list of tables [[body]], got {', '.join(tables) or 'nothing'}")
    lines = [number for number, line in enumerate(text.splitlines(), 1) if line.lstrip().startswith("[[")]
    places = [f"{path}:{line}" for line in lines] if len(lines) == len(entries) else [str(path)] * len(entries)
    bodies = [
        _Entry(path, place, k, entry).body() for k, (place, entry) in enumerate(zip(places, entries, strict=True))
    ]
    return Scene(tuple(bodies), str(path))


class _Entry:
    """One table of a scene file."""

    def __init__(self, path: Path, place: str, number: int, table: Mapping[str, Any]):
        self.path, self.place, self.table = path, place, table
        self.name = table.get("name", f"body {number + 1}")

    def body(self) -> RigidBody:
        """Return the body of the table; errors begin with its line and its name."""
        try:
            self._check()
            return self._made()
        except (FileError, SceneError) as error:
            title = f"{self.place}: body {self.name!r}"
            raise SceneError(str(error) if str(error).startswith(title) else f"{title}: {error}") from error

    def _check(self) -> None:
        table = self.table
        unknown = next((key for key in table if key not in KEYS), None)
        if unknown is not None:
            raise SceneError(f"unknown key {unknown!r}; {known(sorted(KEYS), typed=unknown)}")
        if not isinstance(self.name, str) or not self.name.strip():
            raise SceneError("name is a text that is not empty")
        both = next((pair for pair in EXCLUSIVE if set(pair) <= set(table)), None)
        if both is not None:
            raise SceneError(f"{' and '.join(both)} contradict each other: give one")

    def _made(self) -> RigidBody:
        table, found = self.table, self._poses()
        return RigidBody(
            self.name,
            self._shape(),
            self._own_pose() if found is None else _in_metres(found, self._stated(found)),
            fps=self._number("fps") or (found.fps if found else None),
            carrier=self._text("carrier") if "carrier" in table else "",
            mass=self._number("mass"),
            friction=self._number("friction") or FRICTION,
            source=self.place,
        )

    def _shape(self) -> BodyShape:
        if "model" in self.table:
            return mjcf.single(self._file("model"))
        kind = ShapeKind(self._chosen("shape", {str(each): each for each in ShapeKind}))
        if kind in EDGES:
            return solid(kind, self._numbers("size", EDGES[kind]))
        if kind is ShapeKind.MESH and "size" in self.table:
            raise SceneError("a mesh has the size of its file: leave size out, or state its unit")
        if kind is ShapeKind.MESH:
            return read_mesh(self._file("file"), self._unit)
        length, width = self._numbers("size", 2)
        file = self._file("file")
        with refusing(file, "array of heights"):
            heights = self._unit * next(iter(load_arrays(file).values()))
        return height_field(heights, length, width)

    def _poses(self) -> PoseTable | None:
        if "poses" not in self.table:
            return None
        order = self._chosen("order", {each: each for each in ORDERS}) if "order" in self.table else None
        return read_poses(self.path.parent / self._text("poses"), self.name, order)

    def _stated(self, found: PoseTable) -> tuple[float, str]:
        """Return metres per unit and the up axis: those of the table, or else those of the file."""
        unit = self._unit if "unit" in self.table or found.unit is None else UNITS.get(found.unit, 1.0)
        return unit, self._up if "up" in self.table else found.up

    @property
    def _unit(self) -> float:
        return self._chosen("unit", UNITS, "m")

    @property
    def _up(self) -> str:
        return self._chosen("up", {axis: axis for axis in TURNS}, "z")

    def _own_pose(self) -> Floats:
        place = self._numbers("position", 3) if "position" in self.table else (0.0, 0.0, 0.0)
        turn = self._numbers("quaternion", 4, "w x y z", 1.0) if "quaternion" in self.table else (1.0, 0.0, 0.0, 0.0)
        return _turned(np.array([*place, *turn])[None], self._up)[0]

    def _numbers(self, key: str, count: int, what: str = "[m]", unit: float | None = None) -> tuple[float, ...]:
        values = self.table.get(key, [])
        values = values if isinstance(values, list) else [values]
        if len(values) != count or not all(map(_is_number, values)):
            raise SceneError(f"{key} has {count} number{'s' * (count != 1)} {what}, got {values or 'none'}")
        return tuple((self._unit if unit is None else unit) * float(v) for v in values)

    def _number(self, key: str) -> float | None:
        value = self.table.get(key)
        if value is not None and not (_is_number(value) and value > 0):
            raise SceneError(f"{key} is a positive number, got {value!r}")
        return None if value is None else float(value)

    def _chosen(self, key: str, choices: Mapping[str, Choice], default: str = "") -> Choice:
        value = self.table.get(key, default)
        if not isinstance(value, str) or value not in choices:
            raise SceneError(f"no {key} {value!r}; {known(choices, typed=value)}")
        return choices[value]

    def _text(self, key: str) -> str:
        value = self.table.get(key)
        if not isinstance(value, str) or not value:
            raise SceneError(f"{key} is a name, got {value!r}")
        return value

    def _file(self, key: str) -> Path:
        file = self.path.parent / self._text(key)
        if not file.is_file():
            raise SceneError(f"no such file: {file}")
        return file


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _in_metres(found: PoseTable, stated: tuple[float, str]) -> Floats:
    """Return poses (T, 7) in metres, z up."""
    unit, up = stated
    poses = np.array(found.poses)
    poses[:, :3] *= unit
    return _turned(poses, up)


def _turned(poses: Floats, up: str) -> Floats:
    """Return poses (T, 7) of a world with another axis up in a world with z up; the body's frame turns along."""
    axes = TURNS[up]
    return np.concatenate([poses[:, :3][:, axes], poses[:, 3:4], poses[:, 4:][:, axes]], axis=1)


READERS = {".toml": read_toml_scene, ".xml": mjcf.read, ".urdf": mjcf.read}
"""By the ending of the file name."""
POSES = (".npz", ".pt", ".pkl", ".p", ".csv")
"""Endings of files that hold poses without shapes."""


def read_scene(path: str | Path) -> Scene:
    """Read the bodies around a human, in metres, z up.

    Args:
        path: a TOML of bodies (see `read_toml_scene`), or an MJCF or URDF, whose geoms that no joint moves are the bodies.

    Raises:
        SceneError: the file cannot be read, or a body is not as it should be; names the file and the body.
    """
    file = Path(path)
    if not file.is_file():
        raise SceneError(f"{file}: no such file")
    ending = file.suffix.lower()
    if ending in POSES:
        raise SceneError(
            f'{file} may hold poses, but no shapes: name it in a TOML, [[body]] name = "box" shape = "box" '
            f'size = [0.4, 0.4, 0.4] poses = "{file.name}"'
        )
    if ending not in READERS:
        raise SceneError(f"{file}: no kind of scene file ends in {ending!r}; {known(READERS)}")
    return READERS[ending](file)
