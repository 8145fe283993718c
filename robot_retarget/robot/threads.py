"""Work on the rows of an array in threads: MuJoCo's functions release the interpreter lock."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

LEAST = 8
"""Rows of a part at least: a thread begins in the time of one row."""

Done = TypeVar("Done")


def in_parts(work: Callable[[int, slice], Done], count: int, threads: int) -> list[Done]:
    """Return what `work` returns for the parts of `count` rows, in order; every part has its own number and thread.

    Args:
        work: receives the number of a part and its rows.
        count: number of rows.
        threads: number of parts at most.
    """
    parts = max(min(threads, count // LEAST), 1)
    rows = [slice(*ends) for ends in pairwise(count * k // parts for k in range(parts + 1))]
    if parts == 1:
        return [work(0, rows[0])]
    with ThreadPoolExecutor(parts) as pool:
        return list(pool.map(work, range(parts), rows))
