"""Text documents from files: TOML and JSON, with one error class for every fault."""

import json
import tomllib
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
