"""Scenes in TOML: one table `[[body]]` per body, with its shape and pose.

[[body]]
name = "box"
shape = "box"                # box, cylinder, sphere, plane, mesh, height field
size = [0.4, 0.3, 0.3]       # whole edges [m]
carrier = "Prop1"            # a joint of the motion file; or position = [x, y, z]; or poses = "file.npz"
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.errors import FileError, SceneError, known
from robot_retarget.scene.formats import mjcf
from robot_retarget.scene.formats.poses import PoseTable, read_poses
from robot_retarget.scene.geoms import read_mesh
from robot_retarget.scene.scene import FRICTION, RigidBody, Scene
from robot_retarget.scene.shape import EDGES, BodyShape, ShapeKind, height_field, solid
from robot_retarget.untrusted.arrays import load_arrays
from robot_retarget.untrusted.documents import read_toml

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "Meters": 1.0, "Centimeters": 0.01, "Millimeters": 0.001}
"""Metres in each unit, by the names of this format and of OptiTrack."""
TURNS = {"x": [1, 2, 0], "y": [2, 0, 1], "z": [0, 1, 2]}
"""Axes of a file that become x, y, z, per axis that points up: as for motions."""
KEYS = {
    "name", "shape", "size", "file", "model", "position", "quaternion", "carrier", "poses", "order", "fps", "unit", "up",
    "mass", "friction",
}  # fmt: skip


def read(path: Path) -> Scene:
    """Read a scene file.

    Raises:
        SceneError: an unknown key, a missing or wrong value, or a file that a body names and that cannot be read.
    """
    tables = read_toml(path, SceneError)
    entries = tables.get("body")
    if set(tables) != {"body"} or not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise SceneError(f"{path}: a scene is a list of tables [[body]], got {', '.join(tables) or 'nothing'}")
    return Scene(tuple(_Entry(path, k, entry).body() for k, entry in enumerate(entries)), str(path))


class _Entry:
    """One table of a scene file."""

    def __init__(self, path: Path, number: int, table: Mapping[str, Any]):
        self.path, self.table = path, table
        self.name = str(table.get("name", f"body {number + 1}"))
        unknown = next((key for key in table if key not in KEYS), None)
        if unknown is not None:
            self.refuse(f"unknown key {unknown!r}; {known(sorted(KEYS), typed=unknown)}")
        places = [key for key in ("position", "carrier", "poses") if key in table]
        if len({"carrier", "poses"} & set(places)) > 1 or {"position", "poses"} <= set(places):
            self.refuse(f"{' and '.join(places)} contradict each other: give one")
        self.unit = self._chosen("unit", UNITS)
        self.up = str(table.get("up", "z"))
        if self.up not in TURNS:
            self.refuse(f"no axis {self.up!r} points up; {known(TURNS)}")

    def refuse(self, message: str) -> None:
        raise SceneError(f"{self.path}: body {self.name!r}: {message}")

    def body(self) -> RigidBody:
        """Return the body of the table."""
        table, found = self.table, self._poses()
        return RigidBody(
            self.name,
            self._shape(),
            self._own_pose() if found is None else _in_metres(found, self._stated(found)),
            fps=self._number("fps") or (found.fps if found else None),
            carrier=str(table.get("carrier", "")),
            mass=self._number("mass"),
            friction=self._number("friction") or FRICTION,
        )

    def _shape(self) -> BodyShape:
        if "model" in self.table:
            return mjcf.single(self._file("model"))
        kind = self.table.get("shape")
        if kind not in list(ShapeKind):
            self.refuse(f"shape is {kind!r}; {known(list(ShapeKind), typed=kind)}")
        kind = ShapeKind(kind)
        try:
            if kind in EDGES:
                return solid(kind, self._numbers("size", EDGES[kind]))
            if kind is ShapeKind.MESH:
                return read_mesh(self._file("file"), self.unit)
            length, width = self._numbers("size", 2)
            heights = next(iter(load_arrays(self._file("file")).values()))
            return height_field(self.unit * heights, length, width)
        except FileError as error:
            raise SceneError(f"{self.path}: body {self.name!r}: {error}") from error
        except SceneError as error:
            self.refuse(str(error))
            raise

    def _poses(self) -> PoseTable | None:
        if "poses" not in self.table:
            return None
        return read_poses(self.path.parent / str(self.table["poses"]), self.name, self.table.get("order"))

    def _stated(self, found: PoseTable) -> tuple[float, str]:
        """Return metres per unit and the up axis: those of the table, or else those of the file."""
        unit = self.unit if "unit" in self.table or found.unit is None else UNITS.get(found.unit, 1.0)
        return unit, self.up if "up" in self.table else found.up

    def _own_pose(self) -> Floats:
        place = self._numbers("position", 3) if "position" in self.table else (0.0, 0.0, 0.0)
        turn = [float(v) for v in self.table.get("quaternion", (1, 0, 0, 0))]
        if len(turn) != 4:
            self.refuse(f"quaternion has 4 numbers w x y z, got {len(turn)}")
        return _turned(np.array([*place, *turn])[None], self.up)[0]

    def _numbers(self, key: str, count: int) -> tuple[float, ...]:
        values = self.table.get(key, [] if count else ())
        values = values if isinstance(values, list | tuple) else [values]
        if len(values) != count or not all(isinstance(v, int | float) for v in values):
            self.refuse(f"{key} has {count} numbers [m], got {values or 'none'}")
        return tuple(self.unit * float(v) for v in values)

    def _number(self, key: str) -> float | None:
        value = self.table.get(key)
        if value is not None and (not isinstance(value, int | float) or not value > 0):
            self.refuse(f"{key} is a positive number, got {value!r}")
        return None if value is None else float(value)

    def _chosen(self, key: str, choices: Mapping[str, float]) -> float:
        value = str(self.table.get(key, "m"))
        if value not in choices:
            self.refuse(f"no {key} {value!r}; {known(choices, typed=value)}")
        return choices[value]

    def _file(self, key: str) -> Path:
        if not isinstance(self.table.get(key), str):
            self.refuse(f"{key} names a file, got {self.table.get(key)!r}")
        file = self.path.parent / self.table[key]
        if not file.is_file():
            self.refuse(f"no such file: {file}")
        return file


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
