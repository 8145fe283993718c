"""Whether the goals of a trajectory may be sent: they were judged on these servos, they passed, and nothing changed since."""

import shlex
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.goals import TRACKING_RMS
from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.errors import ServoError
from robot_retarget.base.untrusted.documents import FORMAT_VERSION, NAMES, content_sha256, read_json
from robot_retarget.servo.link import JointScale
from robot_retarget.servo.plan import goal_plan
from robot_retarget.trajectory import Trajectory, fingerprint


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
    where = Path(report) if report is not None else _beside(Path(path), mode)
    content, why = _content(where)
    why = (
        why
        or _unsuitable(content, mode, loose, where)
        or _mismatch(content, path, trajectory, servo_map, servos, where)
    )
    if why is None:
        return float(content["thresholds"].get("tracking_rms", {}).get("value", TRACKING_RMS))
    robot = content.get("model") or trajectory.robot
    command = ["robot-retarget", "simulate", path, "--robot", robot, "--mode", mode]
    command += ["--servos", servos, *(["--report", report] if report is not None else [])]
    raise ServoError(f"{why}; judge it again: {shlex.join(map(str, command))}")


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
        return f"it did not pass: {listed or content.get('verdict')}"
    if content.get("mode") != mode:
        hint = "; --mode pinned plays it on a robot held by its pelvis" if mode == "free" else ""
        return f"it passed in mode {content.get('mode')} ({where}), not {mode}{hint}"
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
