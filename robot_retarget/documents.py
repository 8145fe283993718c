"""Text documents from files: TOML and JSON, with one error class for every fault."""

import json
import tomllib
from pathlib import Path
from typing import Any

from robot_retarget.errors import RobotRetargetError

Error = type[RobotRetargetError]


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
        error: The text is not TOML, or its values are nested too deeply.
    """
    try:
        return tomllib.loads(text)
    except ValueError as problem:
        raise error(f"{path}: not TOML: {problem}") from problem
    except RecursionError:
        raise error(f"{path}: not TOML that can be read: its values are nested too deeply") from None


def parse_json(text: str, path: str | Path, error: Error) -> Any:
    """Parse the text of a JSON file.

    Raises:
        error: The text is not JSON, or its values are nested too deeply.
    """
    try:
        return json.loads(text)
    except ValueError as problem:
        raise error(f"{path}: not JSON: {problem}") from problem
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
