"""The trajectory: the result of a retargeting, and the input of every later stage."""

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.goals import FILE_FIELDS as GOAL_FIELDS
from robot_retarget.actuators.goals import Goals, read_goals, require_angles
from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.errors import SceneError, TrajectoryError
from robot_retarget.base.files import replacing, require_suffix
from robot_retarget.base.pages import card, data_frame
from robot_retarget.base.untrusted.arrays import FARTHEST, RATES, Field, read_fields
from robot_retarget.scene.scene import FIELDS as SCENE_FIELDS
from robot_retarget.scene.scene import Scene, arrays_of, scene_from

FORMAT_VERSION = 3
"""1: without `source_time` and goals. 2: without `source_sha256`, and `source_time` counts from the first frame used. Both are read."""
FIELDS = {
    "qpos": Field("number", ("T", "nq")),
    "fps": Field("number"),
    "joint_names": Field("text", ("n",)),
    "robot": Field("text"),
    "source": Field("text"),
    "format_version": Field("integer", bounds=(1, FORMAT_VERSION)),
    "source_time": Field("number", ("T",), required=False),
    "source_sha256": Field("text", required=False),
    "likeness": Field("text", required=False),
    "balance": Field("text", required=False),
    **GOAL_FIELDS,
    **SCENE_FIELDS,
}
"""Of the trajectory file."""
KEYS = tuple(name for name, field in FIELDS.items() if field.required)
SUFFIX = ".npz"
"""Of a trajectory file."""
FREE_ROOT = 7
"""Coordinates of a free joint, as in MuJoCo: xyz and a quaternion."""
LARGEST_FIGURE = 1e9
"""A larger figure of likeness is a mistake."""
UNIT = 0.01
"""Norms of quaternions differ from 1 by at most this; others are refused."""


@dataclass(frozen=True)
class Trajectory:
    """Configurations of one robot over time, in MuJoCo's order: root xyz [m], quaternion w x y z, hinges [rad]."""

    qpos: Floats
    """(T, nq)."""
    fps: float
    """Frames per second [1/s]."""
    joint_names: tuple[str, ...]
    """The hinges, in the model's order."""
    robot: str
    """The robot's name."""
    source: str = ""
    """The motion it came from."""
    notes: tuple[str, ...] = field(default=())
    source_time: Floats = field(default_factory=lambda: np.zeros(0))
    """(T,) time in the source file of each frame [s]; k / fps by default."""
    goals: Goals | None = None
    """Goals of the servos, once it is simulated."""
    source_sha256: str = ""
    """The hash of the source file (`Motion.source_sha256`); empty if unknown."""
    likeness: Mapping[str, Any] = field(default_factory=dict)
    """Figures of its likeness to the human's motion, for the verdict; empty if it was not compared with one."""
    balance: str = ""
    """The balance that it was planned with (`static`, `dynamic`); empty for none."""
    scene: Scene | None = None
    """The bodies around the robot, the moving ones with a pose at every frame."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "qpos", frozen(self.qpos))
        object.__setattr__(self, "fps", float(self.fps))
        object.__setattr__(self, "joint_names", tuple(map(str, self.joint_names)))
        if not RATES[0] <= self.fps <= RATES[1]:
            raise TrajectoryError(f"fps must be in {RATES[0]:g} … {RATES[1]:g}, got {self.fps:g}")
        self._require_configurations()
        given = np.asarray(self.source_time)
        object.__setattr__(self, "source_time", frozen(given if given.size else np.arange(len(self)) / self.fps))
        self._require_fitting()

    def _require_configurations(self) -> None:
        """Each configuration is finite, near the origin, of a unit quaternion and has one angle for each joint."""
        names, root = self.joint_names, self.qpos.shape[-1] - len(self.joint_names)
        if self.qpos.ndim != 2 or not self.qpos.size:
            raise TrajectoryError(f"qpos must be (T, nq) with at least one frame, got {self.qpos.shape}")
        if root < 0:
            raise TrajectoryError(f"qpos has {self.qpos.shape[1]} columns for {len(names)} joints")
        repeated = next((name for k, name in enumerate(names) if name in names[:k]), None)
        if repeated is not None:
            raise TrajectoryError(f"joint_names has {repeated!r} twice")
        require_angles("qpos", "frame", self.qpos[:, root:], root)
        self._require_root(self.qpos[:, :root])

    def _require_root(self, root: Floats) -> None:
        wrong = np.argwhere(~(np.abs(root) <= FARTHEST))
        if wrong.size:
            frame, column = wrong[0]
            what = f"is {root[frame, column]:g}" if np.isfinite(root[frame, column]) else "is not finite"
            raise TrajectoryError(f"qpos {what} at frame {frame}, column {column}")
        norms = np.linalg.norm(root[:, 3:], axis=1) if root.shape[1] == FREE_ROOT else np.ones(len(root))
        frame = int(np.abs(norms - 1).argmax())
        if abs(norms[frame] - 1) > UNIT:
            raise TrajectoryError(f"the root's quaternion has norm {norms[frame]:.3g} at frame {frame}, not 1")

    def _require_fitting(self) -> None:
        """The source's times are one for each frame and never go back; goals have the joints and last as long."""
        times, goals = self.source_time, self.goals
        if times.shape != (len(self),):
            raise TrajectoryError(f"source_time must be ({len(self)},) as there are frames, got {times.shape}")
        if not (np.isfinite(times).all() and (np.diff(times) >= 0).all()):
            raise TrajectoryError("source_time must be finite and must not go back")
        if self.scene is not None and self.scene.frames not in (None, len(self)):
            raise TrajectoryError(f"the scene has {self.scene.frames} frames, the trajectory {len(self)}")
        if goals is None:
            return
        if goals.angles.shape[1] != len(self.joint_names):
            raise TrajectoryError(
                f"goals are of {goals.angles.shape[1]} joints, the trajectory has {len(self.joint_names)}"
            )
        if abs(goals.duration - goals.lead_in - self.duration - goals.lead_out) > 1.5 / goals.rate:
            raise TrajectoryError(f"goals last {goals.duration:.3f} s, not as long as the trajectory and its settling")

    def altered(self, **changes: Any) -> "Trajectory":
        """Return the trajectory with other values, without goals and likeness, which belong to the present ones."""
        return replace(self, **{"goals": None, "likeness": {}} | changes)

    def __repr__(self) -> str:
        return f"<Trajectory {self.source or 'made'} on {self.robot}: {', '.join(self._facts().values())}>"

    def _repr_html_(self) -> str:
        return card(f"{self.source or 'A trajectory'} on {self.robot}", self._facts(), self.notes)

    def _facts(self) -> dict[str, str]:
        facts = {"length": f"{self.duration:.2f} s", "frames": f"{len(self)} at {self.fps:g}/s"}
        return facts | {"joints": f"{len(self.joint_names)} joints"}

    def to_frame(self) -> Any:
        """Configurations as a pandas DataFrame: the root's columns, then hinges by name [rad], a row a frame.

        Raises:
            UsageError: pandas is not installed.
        """
        root = self.qpos.shape[1] - len(self.joint_names)
        free = ["x", "y", "z", "qw", "qx", "qy", "qz"]
        names = [*(free if root == len(free) else [f"root {k}" for k in range(root)]), *self.joint_names]
        return data_frame(dict(zip(names, self.qpos.T, strict=True)), np.arange(len(self)) / self.fps)

    def __len__(self) -> int:
        return len(self.qpos)

    @property
    def angles(self) -> Floats:
        """(T, n) angles of the hinges [rad]."""
        return self.qpos[:, -len(self.joint_names) :]

    def require_source(self, source: str, sha256: str) -> None:
        """Require that this trajectory comes from a motion, by its hash, or by its name if the hash is unknown.

        Raises:
            TrajectoryError: it is another one.
        """
        hashed = bool(self.source_sha256 and sha256)
        own, given = Path(self.source).name, Path(source).name
        if self.source_sha256 != sha256 if hashed else own and Path(own).stem != Path(given).stem:
            why = "their contents differ" if hashed else "their names differ"
            raise TrajectoryError(f"the trajectory comes from {own or 'another motion'}, not from {given}: {why}")

    @property
    def duration(self) -> float:
        """From the first frame to the last [s]."""
        return (len(self) - 1) / self.fps

    def save(self, path: str | Path) -> Path:
        """Write the `.npz` file of the contract (no pickles), whole or not at all.

        Raises:
            OutputError: the file cannot be written, or has the suffix of another format.
        """
        target = Path(path)
        require_suffix(target, SUFFIX, "`export` writes trajectories in other formats")
        with replacing(target) as scratch:
            scratch.write_bytes(self.serialised())
        return target

    def serialised(self) -> bytes:
        """What `save` writes, byte for byte: the same trajectory always gives the same bytes."""
        stream = io.BytesIO()
        np.savez_compressed(
            stream,
            qpos=self.qpos,
            fps=self.fps,
            joint_names=np.array(self.joint_names, dtype=np.str_),
            robot=self.robot,
            source=self.source,
            format_version=FORMAT_VERSION,
            source_time=self.source_time,
            source_sha256=self.source_sha256,
            **({"likeness": json.dumps(dict(self.likeness), allow_nan=False)} if self.likeness else {}),
            **({"balance": self.balance} if self.balance else {}),
            **(self.goals.arrays() if self.goals else {}),
            **(arrays_of(self.scene, len(self)) if self.scene else {}),
        )
        return stream.getvalue()


def fingerprint(trajectory: Trajectory | str | Path) -> str:
    """The sha256 by which a report refers to its trajectory file.

    Of a path, the hash of the file as it lies there; of a trajectory, that of the file `save` writes: both agree for
    a file just saved.

    Raises:
        TrajectoryError: the file cannot be read.
    """
    if isinstance(trajectory, Trajectory):
        return hashlib.sha256(trajectory.serialised()).hexdigest()
    try:
        return hashlib.sha256(Path(trajectory).read_bytes()).hexdigest()
    except OSError as error:
        raise TrajectoryError(f"cannot read {trajectory}: {error.strerror or error}") from error


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory file.

    Raises:
        TrajectoryError: The file cannot be read, is not a trajectory file, lacks a key, has a value that no trajectory
            has, or is of a later format.
    """
    if Path(path).suffix.lower() not in ("", SUFFIX) and Path(path).is_file():
        raise TrajectoryError(
            f"{path}: not a trajectory ({SUFFIX}); `retarget` makes one of a human's motion, and `load_trajectory` with a robot "
            "reads the formats of other tools"
        )
    values = read_fields(path, FIELDS, TrajectoryError)
    try:
        return Trajectory(
            values["qpos"],
            float(values["fps"]),
            tuple(values["joint_names"].tolist()),
            str(values["robot"]),
            str(values["source"]),
            source_time=values.get("source_time", np.zeros(0)),
            goals=read_goals(values),
            source_sha256=str(values.get("source_sha256", "")),
            likeness=_read_likeness(str(values.get("likeness", "{}"))),
            balance=str(values.get("balance", "")),
            scene=scene_from(values),
        )
    except (TrajectoryError, SceneError) as error:
        raise TrajectoryError(f"{path}: {error}") from None


def _is_figure(value: object) -> bool:
    return value is None or isinstance(value, str) or (isinstance(value, int | float) and abs(value) <= LARGEST_FIGURE)


def _read_likeness(text: str) -> dict[str, Any]:
    """Return figures from JSON: finite numbers, texts and nothings by name, and rows of them under `attempts`.

    Raises:
        TrajectoryError: it is something else.
    """
    try:
        found = json.loads(text, parse_constant=float)
    except (ValueError, RecursionError):
        found = None
    rows = found.get("attempts", []) if isinstance(found, dict) else None
    if not isinstance(found, dict) or not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise TrajectoryError("likeness is not a table of figures")
    if not all(_is_figure(value) for table in ({**found, "attempts": None}, *rows) for value in table.values()):
        raise TrajectoryError("likeness is not a table of figures")
    return found
