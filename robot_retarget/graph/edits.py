"""Edits of a graph in a file: edges to add, kinds and pairs to weigh or to drop, in the order they stand.

    [[edge]]                       [[weigh]]                          [[drop]]
    a = "l_hand"                   between = ["l_hand", "head"]       kind = "touch"
    b = "head"                     factor = 2.0
    at = 0.05                      # or kind = "posture"
    frames = [30, 90]
    hard = true                    # or priority = 200.0

An end is a keypoint, a point on a body `["l_el_link", 0.0, 0.1, 0.0]`, or a place in the world `[0.2, 0.0, 0.5]` [m].
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import GraphError, known
from robot_retarget.base.files import write_text
from robot_retarget.base.untrusted.documents import parse_toml, read_text
from robot_retarget.graph.added import End
from robot_retarget.graph.describe import RobotGraph

KEYS = {
    "edge": ("a", "b", "at", "frames", "priority", "hard"),
    "weigh": ("kind", "between", "factor"),
    "drop": ("kind", "between"),
}


@dataclass(frozen=True)
class Edit:
    """One table of an edits file."""

    action: str
    """`edge`, `weigh` or `drop`."""
    values: Mapping[str, Any]
    line: int = 0
    """Line of its header in the file; 0 without a file."""
    path: str = ""
    """Name of the file; empty without one."""

    @property
    def where(self) -> str:
        """`EDITS.toml:2: `, the head of a message; empty without a file."""
        return f"{self.path}:{self.line}: " if self.path else ""


def read_edits(path: str | Path) -> list[Edit]:
    """The edits of a file, tables in the order they stand.

    Raises:
        GraphError: it cannot be read, is not TOML, or has a table or key that is unknown (with its line).
    """
    text = read_text(path, GraphError)
    tables = parse_toml(text, path, GraphError)
    lines = text.splitlines()
    for name, rows in tables.items():
        if name not in KEYS or not isinstance(rows, list) or len(rows) != len(_headers(lines, name)):
            raise GraphError(
                f"{path}:{_line(lines, name)}: unknown table [{name}]; {known([f'[[{k}]]' for k in KEYS], typed=name)}"
            )
    found = [
        Edit(name, values, line, str(path))
        for name, rows in tables.items()
        for values, line in zip(rows, _headers(lines, name), strict=True)
    ]
    for edit in found:
        for key in edit.values:
            if key not in KEYS[edit.action]:
                at = _line(lines, key, edit.line)
                raise GraphError(
                    f"{path}:{at}: unknown key {key!r} in [[{edit.action}]]; {known(KEYS[edit.action], typed=key)}"
                )
    return sorted(found, key=lambda edit: edit.line)


def edited(graph: RobotGraph, edits: Iterable[Edit]) -> RobotGraph:
    """Apply edits to a graph, in order.

    Args:
        graph: of a robot.
        edits: in the order of their application.

    Raises:
        GraphError: the graph refuses an edit; the message begins with its file and line.
    """
    for edit in edits:
        try:
            graph = _made(graph, edit.action, edit.values)
        except (GraphError, TypeError, ValueError, KeyError) as error:
            reason = f"[[{edit.action}]] needs {error}" if isinstance(error, KeyError) else str(error)
            raise GraphError(edit.where + reason) from error
    return graph


def write_edits(edits: Iterable[Edit], path: str | Path) -> Path:
    """Write edits as a file that `read_edits` reads, completely or not at all.

    Args:
        edits: in the order of their tables.
        path: of the new file.

    Raises:
        OutputError: the file cannot be written.
    """
    import tomlkit

    return write_text(path, "\n".join(tomlkit.dumps({edit.action: [_plain(edit.values)]}) for edit in edits))


def _made(graph: RobotGraph, action: str, values: Mapping[str, Any]) -> RobotGraph:
    if action == "edge":
        at = values["at"]
        interval = (float(at[0]), float(at[1])) if isinstance(at, list) else float(at)
        frames = values.get("frames")
        return graph.with_edge(
            end_of(values["a"]),
            end_of(values["b"]),
            interval,
            frames=None if frames is None else (int(frames[0]), int(frames[1])),
            priority=values.get("priority"),
            hard=bool(values.get("hard", False)),
        )
    what = values["kind"] if "kind" in values else tuple(values["between"])
    return graph.without(what) if action == "drop" else graph.with_priority(what, float(values["factor"]))


def end_of(value: Any) -> End:
    """Return the end that a value of a table names."""
    if isinstance(value, str):
        return value
    if isinstance(value, list) and value and isinstance(value[0], str):
        return value[0], np.array(value[1:], dtype=float)
    return np.array(value, dtype=float)


def _plain(value: Any) -> Any:
    """Return a value without NumPy's types."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _headers(lines: list[str], name: str) -> list[int]:
    """Return the lines at which tables of a name begin, counted from 1."""
    return [k + 1 for k, line in enumerate(lines) if line.split("#")[0].strip() == f"[[{name}]]"]


def _line(lines: list[str], word: str, start: int = 0) -> int:
    """Return the first line, from a line on, that begins with a key or header."""
    for k in range(start, len(lines)):
        if lines[k].strip().lstrip("[").startswith(word):
            return k + 1
    return start
