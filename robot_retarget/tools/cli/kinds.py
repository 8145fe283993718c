"""Kinds of files, and the commands that take them, checked before any heavy library is loaded."""

from pathlib import Path

from robot_retarget.base.errors import UsageError
from robot_retarget.base.untrusted.limits import zip_names

MODELS = (".xml", ".mjcf", ".urdf")
MOTIONS = (".bvh", ".amc", ".asf", ".c3d", ".mvnx", ".trc", ".glb", ".gltf", ".vrma", ".fbx")
TRAJECTORY_MEMBERS = {"qpos.npy", "joint_names.npy", "format_version.npy"}
STDIN = "-"
TAKEN_BY = {
    "robot": "robot-retarget info {0} shows it; other commands take it as --robot {0}",
    "motion": "robot-retarget run {0} makes a trajectory of it",
    "trajectory": "robot-retarget view, simulate, export and play take it",
    "settings": "commands take it by an option: --map, --limits, --edges, --servos",
}
"""Which command takes a file of a kind."""


def kind_of(path: Path) -> str:
    """A key of `TAKEN_BY`, by the suffix or the names in an archive; empty for what may be several kinds."""
    suffix = path.suffix.lower()
    if suffix in MODELS:
        return "robot"
    if suffix in MOTIONS:
        return "motion"
    if suffix == ".toml":
        return "settings"
    return "trajectory" if suffix == ".npz" and _is_trajectory(path) else ""


def _is_trajectory(path: Path) -> bool:
    return set(zip_names(path)) >= TRAJECTORY_MEMBERS


def require_motion(path: Path) -> Path:
    """Refuse a robot, a trajectory, a settings file or stdin where a motion is expected."""
    return _require("motion", path)


def require_trajectory(path: Path) -> Path:
    """Refuse a robot, a motion, a settings file or stdin where a trajectory is expected."""
    return _require("trajectory", path)


def require_trajectories(paths: list[Path]) -> list[Path]:
    """Apply `require_trajectory` to each of several files."""
    return [require_trajectory(path) for path in paths]


def require_playable(path: Path) -> Path:
    """Apply `require_trajectory` to all but playlists."""
    return path if path.suffix.lower() == ".toml" else require_trajectory(path)


def _require(wanted: str, path: Path) -> Path:
    if str(path) == STDIN:
        raise UsageError(f"a {wanted} is read from a file, not from stdin: its name decides how it is read")
    found = kind_of(path)
    if found and found != wanted:
        article = "" if found == "settings" else "a "
        raise UsageError(f"{path}: {article}{found}, not a {wanted}; {TAKEN_BY[found].format(path)}")
    return path
