"""Format `lerobot`: a LeRobot data set (version 3.0) of one episode, a folder of Parquet tables and JSON.

A row is a frame: `observation.state` (n) joints and `action` (n) joints of the next frame [rad], `NAME.pos` in the order of the
robot; `observation.root` (7) x y z [m] and quaternion w x y z; `timestamp` [s] and indices. Single precision. Extra `tables`.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import shaped
from robot_retarget.base.untrusted.documents import read_json
from robot_retarget.base.untrusted.tables import parquet, parquet_columns
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared

VERSION = "v3.0"
INFO, STATISTICS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
FIRST = FILE.format(chunk_index=0, file_index=0)
STATE, ROOT, ACTION, EPISODE, POS = "observation.state", "observation.root", "action", "episode_index", ".pos"
ROOT_AXES = ("x", "y", "z", "qw", "qx", "qy", "qz")
INDICES = ("frame_index", EPISODE, "index", "task_index")


def write(motion: RobotMotion, path: Path) -> None:
    """Fill the folder."""
    count, names = len(motion), [joint + POS for joint in motion.joints]
    ahead = motion.angles[np.minimum(np.arange(count) + 1, count - 1)]
    rows: dict[str, Floats] = {STATE: motion.angles, ACTION: ahead}
    features: dict[str, Any] = {name: _feature("float32", len(names), names) for name in rows}
    if motion.robot.floating:
        rows[ROOT] = np.concatenate([motion.position, motion.quaternion], axis=1)
        features[ROOT] = _feature("float32", len(ROOT_AXES), list(ROOT_AXES))
    features |= {name: _feature("int64", 1, None) for name in INDICES} | {"timestamp": _feature("float32", 1, None)}
    statistics = {name: _statistics(values) for name, values in rows.items()}
    _write_rows(path, rows, motion.fps)
    _write_episode(path, count, statistics, Path(motion.trajectory.source).stem or motion.robot.name)
    (path / STATISTICS).write_text(json.dumps(statistics), encoding="utf-8")
    info = {
        "codebase_version": VERSION, "robot_type": motion.robot.name, "total_episodes": 1, "total_frames": count,
        "total_tasks": 1, "chunks_size": 1000, "fps": int(motion.fps) if motion.fps.is_integer() else motion.fps,
        "splits": {"train": "0:1"}, "data_path": f"data/{FILE}", "video_path": None, "features": features,
    }  # fmt: skip
    (path / INFO).write_text(json.dumps(info, indent=1), encoding="utf-8")


def _feature(dtype: str, width: int, names: list[str] | None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [width], "names": names}


def _statistics(values: Floats) -> dict[str, list[float]]:
    found = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    listed: dict[str, list[float]] = {name: value.tolist() for name, value in found.items()}
    listed["count"] = [len(values)]
    return listed


def _write_rows(path: Path, rows: dict[str, Floats], fps: float) -> None:
    arrow, frames = parquet(), np.arange(len(rows[STATE]))
    table = {
        name: arrow.array(list(values.astype("f4")), arrow.list_(arrow.float32(), values.shape[1]))
        for name, values in rows.items()
    }
    table["timestamp"] = arrow.array((frames / fps).astype("f4"))
    table |= {name: arrow.array(frames if name in ("frame_index", "index") else 0 * frames) for name in INDICES}
    _save(path / "data" / FIRST, arrow.table(table))


def _write_episode(path: Path, count: int, statistics: dict[str, dict[str, list[float]]], task: str) -> None:
    """Write the table of episodes and that of tasks, whose text is the table's index."""
    arrow = parquet()
    episode: dict[str, Any] = {
        EPISODE: [0], "tasks": [[task]], "length": [count], "dataset_from_index": [0], "dataset_to_index": [count],
        "data/chunk_index": [0], "data/file_index": [0], "meta/episodes/chunk_index": [0], "meta/episodes/file_index": [0],
    }  # fmt: skip
    episode |= {f"stats/{name}/{key}": [v] for name, found in statistics.items() for key, v in found.items()}
    _save(path / "meta/episodes" / FIRST, arrow.table(episode))
    column = {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    index = json.dumps({"index_columns": ["task"], "columns": [column], "column_indexes": []})
    tasks = arrow.table({"task_index": arrow.array([0], arrow.int64()), "task": [task]})
    _save(path / TASKS, tasks.replace_schema_metadata({"pandas": index}))


def _save(path: Path, table: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet().parquet.write_table(table, path)


def read(source: TrajectorySource) -> Columns:
    """Read the first episode.

    Raises:
        TrajectoryError: `observation.state` is missing, or its names are.
    """
    info = read_json(source.path / INFO, TrajectoryError)
    state = info["features"].get(STATE, {})
    if not isinstance(state.get("names"), list):
        raise TrajectoryError(f"{INFO}: no names of {STATE}")
    columns = parquet_columns(source.path / "data" / FIRST, (STATE, ROOT, EPISODE))
    if STATE not in columns:
        raise TrajectoryError(f"data/{FIRST}: no column {STATE!r}")
    episodes = columns.get(EPISODE, np.zeros(len(columns[STATE])))
    first = episodes == episodes[0]
    angles = shaped(columns[STATE], (None, None), STATE)[first]
    names = tuple(str(name).removesuffix(POS) for name in state["names"])
    total = info.get("total_episodes", 1)
    notes = (f"The first of {total} episodes was read.",) if total != 1 else ()
    if ROOT not in columns:
        return Columns(angles, names, fps=float(info["fps"]), notes=notes)
    root = shaped(columns[ROOT], (None, len(ROOT_AXES)), ROOT)[first]
    return Columns(angles, names, root[:, :3], root[:, 3:], float(info["fps"]), notes=notes)


def read_actions(path: Path) -> tuple[tuple[str, ...], float, Floats, Floats]:
    """Read the first episode as goals and states.

    Returns:
        The joints, frames per second, `action` (T, n) and `observation.state` (T, n), in the units of the file.

    Raises:
        TrajectoryError: a column or its names are missing, or the two have different names.
    """
    features = read_json(path / INFO, TrajectoryError)["features"]
    action, state = (features.get(name, {}).get("names") for name in (ACTION, STATE))
    if not isinstance(action, list) or action != state:
        raise TrajectoryError(f"{path}: {ACTION} and {STATE} need the same names")
    columns = parquet_columns(path / "data" / FIRST, (ACTION, STATE, EPISODE))
    if missing := {ACTION, STATE} - set(columns):
        raise TrajectoryError(f"{path}: no column {min(missing)!r}")
    first = columns[EPISODE] == columns[EPISODE][0] if EPISODE in columns else slice(None)
    goals, states = (shaped(columns[name], (None, len(action)), name)[first] for name in (ACTION, STATE))
    fps = float(read_json(path / INFO, TrajectoryError)["fps"])
    return tuple(str(name).removesuffix(POS) for name in action), fps, goals, states


FORMAT = declared("lerobot", write, read, lambda source: (source.path / INFO).is_file())
