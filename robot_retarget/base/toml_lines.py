"""On which line of a TOML document a key stands: `tomllib` reads values and forgets where they were."""

import tomllib
from collections.abc import Iterator
from typing import Any


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
