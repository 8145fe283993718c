"""The results as tables: `summary.csv`, and `summary.parquet` if pyarrow is installed."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from robot_retarget.base.files import replacing, write_csv
from robot_retarget.scores.table import FIGURES
from robot_retarget.tools.batch.task import Row

FACTS = ("robot", "clip", "state", "message", "frames", "fps", "licence", "source", "path", "output_sha256")


def save_csv(rows: Iterable[Row], path: Path) -> Path:
    """A line for each clip on each robot: facts, then figures, in the order of the table."""
    lines = ([*(getattr(r, fact) for fact in FACTS), *(_cell(r, name) for name in FIGURES)] for r in rows)
    return write_csv(path, (*FACTS, *FIGURES), lines)


def save_parquet(rows: Sequence[Row], path: Path) -> Path | None:
    """The same table as Parquet; None if pyarrow is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return None
    columns: dict[str, Any] = {fact: [getattr(row, fact) for row in rows] for fact in FACTS}
    for name in FIGURES:
        values = [row.figures.get(name) for row in rows]
        columns[name] = pyarrow.array([None if v is None else float(v) for v in values], pyarrow.float64())
    with replacing(path) as scratch:
        pyarrow.parquet.write_table(pyarrow.table(columns), scratch)
    return path


def _cell(row: Row, figure: str) -> Any:
    value = row.figures.get(figure)
    return "" if value is None else value
