"""The JSON file next to a file whose columns have no names: `dance.csv` has `dance.csv.json`."""

import hashlib
import json
from pathlib import Path
from typing import Any

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.documents import read_json
from robot_retarget.formats.robot_motion import RobotMotion

KEYS = ("format", "robot", "joint_names", "quaternion", "fps", "sha256")


def sidecar_path(path: Path) -> Path:
    """Where the JSON file of a file stands."""
    return path.with_name(path.name + ".json")


def sidecar_text(motion: RobotMotion, format: str, quaternion: str, written: Path) -> str:
    """The JSON text about a file just written."""
    return (
        json.dumps(
            {
                "format": format,
                "robot": motion.robot.name,
                "joint_names": list(motion.joints),
                "quaternion": quaternion,
                "fps": motion.fps,
                "frames": len(motion),
                "sha256": _hash(written),
            },
            indent=1,
        )
        + "\n"
    )


def read_sidecar(path: Path) -> dict[str, Any] | None:
    """The description in the JSON file next to a file; None if absent, or of another program.

    Raises:
        TrajectoryError: it is broken, or its sha256 is that of another content.
    """
    where = sidecar_path(path)
    if not (path.is_file() and where.is_file()):
        return None
    facts = read_json(where, TrajectoryError)
    try:
        complete = all(key in facts for key in KEYS) and all(isinstance(name, str) for name in facts["joint_names"])
    except TypeError as error:
        raise TrajectoryError(f"{where}: not the description of a motion file: {error}") from error
    if not complete:
        return None
    if facts["sha256"] != _hash(path):
        raise TrajectoryError(
            f"{path} is not the file that {where.name} describes: it was cut or changed since. "
            f"Remove {where.name} to read it all the same"
        )
    return facts


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
