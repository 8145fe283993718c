"""Whether the goals of a trajectory may be sent: they were judged on these servos, they passed, and nothing changed since."""

import itertools
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.goals import TRACKING_RMS
from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.errors import LISTED, ServoError, known
from robot_retarget.base.files import MODELS
from robot_retarget.base.untrusted.documents import FORMAT_VERSION, NAMES, content_sha256, read_json, read_toml
from robot_retarget.servo.link import JointScale
from robot_retarget.servo.plan import ServoPlan, goal_plan, parting
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory

SEAM = 0.1
"""Largest distance between the stand of a clip and the first pose of the next [rad]: a sequence with a larger one is
refused."""
FAILED = "it did not pass: "
"""Begins the message of a failed simulation, which another one of the same file does not mend."""


def require_judged(
    path: str | Path,
    trajectory: Trajectory,
    servo_map: ServoMap,
    servos: str,
    report: str | Path | None = None,
    mode: str = "free",
    loose: bool = False,
) -> float:
    """Check that the goals in a trajectory file are those that passed.

    Args:
        path: file that the trajectory was read from.
        servos: name of the servo map on the command line.
        report: the report; by default that of the mode next to the trajectory, or for `pinned` the `report.json` that `run` writes.
        mode: `free`, or `pinned` for a robot whose pelvis is fixed.
        loose: accept a pass under thresholds above the defaults.

    Returns:
        The tracking error (rms) of the worst joint under which they passed [rad].

    Raises:
        ServoError: the goals may not be sent; the message gives the reason and the command that judges them again.
    """
    _require_joints(path, trajectory, servo_map, servos)
    where = Path(report) if report is not None else _beside(Path(path), mode)
    content, why = _content(where)
    why = (
        why
        or _unsuitable(content, mode, loose, where)
        or _mismatch(content, path, trajectory, servo_map, servos, where)
    )
    if why is None:
        return float(content["thresholds"].get("tracking_rms", {}).get("value", TRACKING_RMS))
    if content.get("verdict") == "fail" and why.startswith(FAILED):
        raise ServoError(f"{why}{_helping(content)}")
    robot = content.get("model") or trajectory.robot
    command = ["robot-retarget", "simulate", path, "--robot", robot, "--mode", mode]
    command += ["--servos", servos, *(["--report", report] if report is not None else [])]
    raise ServoError(f"{why}; judge it again: {shlex.join(map(str, command))}")


def _require_joints(path: str | Path, trajectory: Trajectory, servo_map: ServoMap, servos: str) -> None:
    """Check that a map has the joints of a trajectory: no simulation mends another robot's map.

    Raises:
        ServoError: it has others.
    """
    own, turned = set(trajectory.joint_names), {*servo_map.joints, *servo_map.passive}
    if other := sorted((own - turned) | (set(servo_map.joints) - own)):
        shipped = (MODELS / trajectory.robot / "servos.toml").is_file()
        right = (
            f"--servos {trajectory.robot}" if shipped else f"--servos MAP.toml with the joints of {trajectory.robot}"
        )
        named = ", ".join(other[:LISTED]) + (f" and {len(other) - LISTED} more joints" if len(other) > LISTED else "")
        raise ServoError(
            f"{path} is of the robot {trajectory.robot}, {servos} of {servo_map.robot}: only one has {named}; use {right}"
        )


def _helping(content: dict[str, Any]) -> str:
    """Return what helps against the reasons of a report, once each."""
    listed = content.get("cures")
    cures = [cure for cure in listed if isinstance(cure, dict)] if isinstance(listed, list) else []
    told = dict.fromkeys(f"{cure.get('what')}: {cure.get('command')}" for cure in cures)
    return f"; what helps: {'; '.join(told)}" if told else ""


def _beside(path: Path, mode: str) -> Path:
    """Return the report of a mode next to a trajectory; `run` writes `report.json` in either mode."""
    own = path.with_name(NAMES[mode])
    return own if own.exists() else path.with_name(NAMES["free"])


def _content(where: Path) -> tuple[dict[str, Any], str | None]:
    """Return a report's content, and an error message."""
    try:
        content = read_json(where, ServoError) if where.exists() else None
    except ServoError as error:
        return {}, f"no report: {error}"
    if content is None:
        return {}, f"no report at {where}"
    return (content, None) if isinstance(content, dict) else ({}, f"{where} is no report")


def _unsuitable(content: dict[str, Any], mode: str, loose: bool, where: Path) -> str | None:
    """Return the reason against playback that a report alone gives, or None."""
    if content.get("format_version") != FORMAT_VERSION:
        return f"{where} is a report of another version ({content.get('version', 'unknown')})"
    if content.get("report_sha256") != content_sha256(content):
        return f"{where} was edited since it was written"
    if content.get("verdict") != "pass":
        reasons = content.get("reasons")
        listed = "; ".join(map(str, reasons)) if isinstance(reasons, list) else ""
        return f"{FAILED}{listed or content.get('verdict')}"
    if content.get("mode") != mode:
        hint = "; --mode pinned plays it on a robot held by its pelvis" if mode == "free" else ""
        return f"it passed in mode {content.get('mode')} ({where}), not {mode}{hint}"
    figures = content.get("figures")
    if isinstance(figures, dict) and "policy" in figures:
        return f"it was judged under the policy {figures['policy']}, which playback does not run ({where})"
    if mode == "free" and isinstance(figures, dict) and figures.get("draws") == 0:
        return f"it was simulated once, without other mass, friction, servos and tilt (--draws 0): a preview ({where})"
    raised = _raised(content)
    if raised and not loose:
        return f"it passed under thresholds above the defaults ({', '.join(raised)}); --loose-thresholds accepts them"
    return None


def _raised(content: dict[str, Any]) -> list[str]:
    """Return the thresholds above their defaults, as `name value, default value`."""
    try:
        changed = {name: (float(line["value"]), float(line["default"])) for name, line in content["thresholds"].items()}
    except (AttributeError, KeyError, TypeError, ValueError):
        return ["not recorded as numbers"]
    return [f"{name} {own:g}, default {usual:g}" for name, (own, usual) in changed.items() if not own <= usual]


def _mismatch(
    content: dict[str, Any], path: str | Path, trajectory: Trajectory, servo_map: ServoMap, servos: str, where: Path
) -> str | None:
    """Return how trajectory, report and servo map disagree."""
    if content.get("trajectory_sha256") != fingerprint(path):
        return f"{where} is about another trajectory than {path}, or it was edited since"
    if content.get("robot") != trajectory.robot:
        return f"{path} is of the robot {trajectory.robot!r}, {where} of {content.get('robot')!r}"
    if trajectory.goals is None:
        return f"{path} holds no goals"
    if trajectory.goals.servos != servo_map.fingerprint:
        return f"{path} was judged on other servos than those of {servos}: robot, models, gears, ranges, speed or jump differ"
    return _cut(trajectory, servo_map, servos)


def _cut(trajectory: Trajectory, servo_map: ServoMap, servos: str) -> str | None:
    """Return the joint whose goals the end of its servo's turn cuts off: zeros differ from robot to robot."""
    plan, scale = goal_plan(trajectory, servo_map), JointScale(servo_map)
    excess = np.maximum(plan.angles - scale.upper, scale.lower - plan.angles).max(axis=0)
    worst = int(excess.argmax())
    if excess[worst] <= scale.tick[worst]:
        return None
    return f"the zero of {servo_map.joints[worst]} in {servos} cuts off {excess[worst]:.3f} rad of its goals"


# Ways out of a plan: judged branches that end in a stand, for a playback that is to stop.

FOLDER = "stops"
"""Folder next to a trajectory; it has a folder for each branch, named by its moment [s]."""
AHEAD = 0.3
"""A branch that has not the goals of its trajectory until this long before its moment is refused as that of another
[s]."""


def judged_ways(
    path: str | Path, plan: ServoPlan, servo_map: ServoMap, servos: str, mode: str = "free", loose: bool = False
) -> tuple[list[ServoPlan], list[str]]:
    """Return the branches in `FOLDER` next to a trajectory that passed, and the reasons against the others.

    Args:
        path: file of the trajectory.
        plan: its judged goals.
        servo_map: as for `require_judged`.
        servos: as for `require_judged`.
        mode: as for `require_judged`.
        loose: as for `require_judged`.
    """
    ways, refused = [], []
    for file in sorted(Path(path).parent.glob(f"{FOLDER}/*/trajectory.npz")):
        try:
            branch = load_trajectory(file)
            require_judged(file, branch, servo_map, servos, None, mode, loose)
            way = goal_plan(branch, servo_map)
            lead_in = 0.0 if branch.goals is None else branch.goals.lead_in
            if parting(plan, way) / plan.rate < lead_in + float(file.parent.name) - AHEAD:
                raise ServoError(f"{file} belongs to another trajectory than {path}")
        except (ServoError, ValueError) as error:
            refused.append(str(error))
        else:
            ways.append(way)
    return ways, refused


# Several judged clips in one playback, with idle motion or a pause between them.

LONGEST_PAUSE = 3600.0
"""A longer pause, or more repetitions, is a mistake [s] or [-]."""


@dataclass(frozen=True)
class Piece:
    """A plan of a playback, with its branches into a stand."""

    plan: ServoPlan
    ways: Sequence[ServoPlan] = ()
    name: str = ""
    pause: float = 0.0
    """Time in its first pose before it begins [s]."""


@dataclass(frozen=True)
class Playlist:
    """Clips in order; the idle motion fills the pauses."""

    files: tuple[Path, ...]
    pauses: tuple[float, ...]
    """After each clip [s]."""
    idle: Path | None = None

    def pieces(self, of: Mapping[Path, Piece]) -> list[Piece]:
        """Return the pieces of a playback.

        Args:
            of: the piece of every file.
        """
        pieces, before = [], 0.0
        for file, pause in zip(self.files, self.pauses, strict=True):
            idle = None if self.idle is None else of[self.idle]
            times = 0 if idle is None or not before else max(1, round(before / max(idle.plan.duration, 1e-9)))
            pieces += [idle] * times if idle else []
            piece = of[file]
            pieces.append(piece if times else Piece(piece.plan, piece.ways, piece.name, before))
            before = pause
        return pieces


def read_playlist(path: str | Path) -> Playlist:
    """Read a playlist: a table [[clip]] with `file` and `pause` [s] for each clip, `idle` and `repeat` above them.

    Files are relative to the playlist.

    Raises:
        ServoError: the file is no playlist; the message names the key.
    """
    tables = read_toml(path, ServoError)
    _require(path, tables, ("idle", "repeat", "clip"), "a playlist")
    clips, repeat, idle = tables.get("clip"), tables.get("repeat", 1), tables.get("idle")
    if not isinstance(clips, list) or not clips or not all(isinstance(clip, dict) for clip in clips):
        raise ServoError(f"{path}: a playlist has a table [[clip]] for each clip")
    if not isinstance(repeat, int) or not 1 <= repeat <= LONGEST_PAUSE or not isinstance(idle, str | None):
        raise ServoError(f"{path}: repeat is a number from 1, idle a file")
    folder, files, pauses = Path(path).parent, list[Path](), list[float]()
    for k, clip in enumerate(clips, 1):
        _require(path, clip, ("file", "pause"), f"clip {k}")
        file, pause = clip.get("file"), clip.get("pause", 0.0)
        if not isinstance(file, str) or not isinstance(pause, int | float) or not 0 <= pause <= LONGEST_PAUSE:
            raise ServoError(f"{path}: clip {k}: file is a trajectory, pause a time in 0…{LONGEST_PAUSE:g} s")
        files.append(folder / file)
        pauses.append(float(pause))
    return Playlist(tuple(files * repeat), tuple(pauses * repeat), None if idle is None else folder / idle)


def _require(path: str | Path, table: Mapping[str, Any], keys: Sequence[str], what: str) -> None:
    strange = next((key for key in table if key not in keys), None)
    if strange is not None:
        raise ServoError(f"{path}: {what} has no {strange!r}; {known(keys, typed=strange)}")


def require_same_stands(pieces: Sequence[Piece], joints: Sequence[str]) -> None:
    """Check that each piece begins in the final stand of the previous piece: feet on a floor do not move.

    Raises:
        ServoError: two stands differ by more than `SEAM`, or two rates differ.
    """
    for before, after in itertools.pairwise(pieces):
        if before.plan.rate != after.plan.rate:
            raise ServoError(f"{before.name} has {before.plan.rate:g} goals a second, {after.name} {after.plan.rate:g}")
        apart = np.abs(before.plan.angles[-1] - after.plan.angles[0])
        if apart.max() > SEAM:
            joint = joints[int(apart.argmax())]
            raise ServoError(
                f"{after.name} begins {apart.max():.2f} rad ({joint}) from the stand in which {before.name} ends: "
                "`robot-retarget edit join` makes one trajectory of them"
            )
