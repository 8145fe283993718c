"""Whether a trajectory's goals may be sent: they were judged, they passed, on these servos, and nothing changed since."""

import shlex
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.documents import read_json
from robot_retarget.errors import ServoError
from robot_retarget.servo.map import ServoMap
from robot_retarget.servo.plan import goal_plan
from robot_retarget.servo.scale import Scale
from robot_retarget.trajectory import Trajectory, fingerprint

FORMAT_VERSION = 2
"""Of reports: earlier ones are of trajectories that do not hold the goals that were judged."""


def require_judged(
    path: str | Path, trajectory: Trajectory, servo_map: ServoMap, servos: str, report: str | Path | None = None
) -> str:
    """See to it that the goals in a trajectory file are those that passed; in which mode they did.

    Args:
        path: the file that the trajectory was read from.
        servos: what the servo map is called on the command line.
        report: its `report.json`; by default beside it.

    Raises:
        ServoError: why not, and the command that judges it anew.
    """
    where = Path(report) if report is not None else Path(path).with_name("report.json")
    content, found = _content(where)
    figures = content.get("figures")
    mode = figures.get("mode", "free") if isinstance(figures, dict) else "free"
    why = found or _objection(content, path, trajectory, servo_map, servos, where)
    if why is None:
        return str(mode)
    command = ["robot-retarget", "simulate", path, "--robot", trajectory.robot, "--mode", mode]
    command += ["--servos", servos, *(["--report", report] if report is not None else [])]
    raise ServoError(f"{why}; judge it anew: {shlex.join(map(str, command))}")


def _content(where: Path) -> tuple[dict[str, Any], str | None]:
    """A report, and what is wrong with it as a file."""
    try:
        content = read_json(where, ServoError) if where.exists() else None
    except ServoError as error:
        return {}, f"no report: {error}"
    if content is None:
        return {}, f"no report at {where}"
    return (content, None) if isinstance(content, dict) else ({}, f"{where} is no report")


def _objection(
    content: dict[str, Any], path: str | Path, trajectory: Trajectory, servo_map: ServoMap, servos: str, where: Path
) -> str | None:
    """What speaks against sending the goals, or None."""
    if content.get("format_version") != FORMAT_VERSION:
        return f"{where} is a report of another version ({content.get('version', 'unknown')}), which judged no stored goals"
    if content.get("trajectory_sha256") != fingerprint(path):
        return f"{where} is about another trajectory than {path}, or it was edited since"
    if content.get("verdict") != "pass":
        reasons = "; ".join(map(str, content.get("reasons", ()))) or str(content.get("verdict"))
        return f"{path} did not pass: {reasons}"
    if trajectory.goals is None:
        return f"{path} holds no goals"
    if trajectory.goals.servos != servo_map.fingerprint:
        return f"{path} was judged on other servos than those of {servos}: models, gears, ranges, speed or jump differ"
    return _cut(trajectory, servo_map, servos)


def _cut(trajectory: Trajectory, servo_map: ServoMap, servos: str) -> str | None:
    """Zeros may differ from robot to robot, and with them where a servo's turn ends."""
    plan, scale = goal_plan(trajectory, servo_map), Scale(servo_map)
    excess = np.maximum(plan.angles - scale.upper, scale.lower - plan.angles).max(axis=0)
    worst = int(excess.argmax())
    if excess[worst] <= scale.tick[worst]:
        return None
    return f"the zero of {servo_map.joints[worst]} in {servos} cuts off {excess[worst]:.3f} rad of its goals"
