"""TOML and JSON from files, with one error class for every fault; lines of TOML keys; the seal of `report.json`."""

import hashlib
import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.untrusted.limits import require_tree

Error = type[RobotRetargetError]
_DIGITS = 18
"""Of an integer that fits 64 bits, with its sign."""


def read_text(path: str | Path, error: Error) -> str:
    """Read a file as UTF-8.

    Raises:
        error: The file cannot be read, or is not text.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as problem:
        raise error(f"cannot read {path}: {problem.strerror or problem}") from problem
    except ValueError as problem:
        raise error(f"{path}: not a text file: {problem}") from problem


def parse_toml(text: str, path: str | Path, error: Error) -> dict[str, Any]:
    """Parse the text of a TOML file.

    Raises:
        error: The text is not TOML, its values are nested too deeply, or an integer has more than 64 bits.
    """
    try:
        tables = tomllib.loads(text)
        require_tree(tables, len(text))
        return tables
    except ValueError as problem:
        raise error(f"{path}: not TOML: {problem}") from problem
    except RecursionError:
        raise error(f"{path}: not TOML that can be read: its values are nested too deeply") from None


def parse_json(text: str, path: str | Path, error: Error) -> Any:
    """Parse the text of a JSON file; integers of more than 18 digits are floats, as in JavaScript.

    Raises:
        error: The text is not JSON, or its values are nested too deeply.
    """
    try:
        return json.loads(text, parse_int=_integer)
    except json.JSONDecodeError as problem:
        raise error(f"{path}:{problem.lineno}: not JSON: {problem.msg}") from problem
    except RecursionError:
        raise error(f"{path}: not JSON that can be read: its values are nested too deeply") from None


def read_toml(path: str | Path, error: Error) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        error: The file cannot be read, or is not TOML.
    """
    return parse_toml(read_text(path, error), path, error)


def read_json(path: str | Path, error: Error) -> Any:
    """Read a JSON file.

    Raises:
        error: The file cannot be read, or is not JSON.
    """
    return parse_json(read_text(path, error), path, error)


def _integer(digits: str) -> int | float:
    return int(digits) if len(digits) <= _DIGITS else float(digits)


def line_of(text: str, key: tuple[str, ...]) -> int | None:
    """The line, from 1, of a dotted key, or of the nearest key or table around it; None for one that is not there."""
    best, depth = None, 0
    for number, path in _keys(text):
        shared = len(path) if key[: len(path)] == path else 0
        if shared > depth:
            best, depth = number, shared
    return best


def _keys(text: str) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Lines that open a table or give a key, with the dotted key from the document's top."""
    table: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.strip()
        if bare.startswith("["):
            table = _path(bare) or table
            yield number, table
        elif "=" in bare and (key := _path(f"{bare.partition('=')[0]} = 0")):
            yield number, (*table, *key)


def _path(line: str) -> tuple[str, ...]:
    """Return the single key of a line of TOML; empty for a line that is no assignment."""
    try:
        value: Any = tomllib.loads(line)
    except ValueError:
        return ()
    path: tuple[str, ...] = ()
    while isinstance(value, dict) and len(value) == 1:
        name, value = next(iter(value.items()))
        path = (*path, name)
    return path


FORMAT_VERSION = 3
"""1: of trajectories without goals. 2: without mode, thresholds and seal. `play` accepts only this one."""
NAMES = {"free": "report.json", "pinned": "report.pinned.json"}
"""File that `simulate` writes in each mode, next to the trajectory."""
SEAL = "report_sha256"


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a report with its own sha256 under `SEAL`.

    Raises:
        ValueError: a number is not finite.
    """
    plain = json.loads(json.dumps(content, allow_nan=False))
    return {**plain, SEAL: content_sha256(plain)}


def content_sha256(content: Mapping[str, Any]) -> str:
    """Return the sha256 of a report's content without its seal: of its JSON with sorted keys and no spaces.

    The seal shows that a report was edited. It holds no secret, so it does not show who wrote it.
    """
    plain = {key: value for key, value in content.items() if key != SEAL}
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
