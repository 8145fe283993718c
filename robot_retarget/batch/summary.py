"""The results as tables: `summary.csv`, and `summary.parquet` if pyarrow is installed."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from robot_retarget.batch.manifest import Row
from robot_retarget.files import replacing
from robot_retarget.score.table import FIGURES

FACTS = ("robot", "clip", "state", "message", "frames", "fps", "licence", "source", "path", "output_sha256")


def save_csv(rows: Iterable[Row], path: Path) -> Path:
    """A line for each clip on each robot: facts, then figures, in the order of the table."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*FACTS, *FIGURES])
    writer.writerows([*(getattr(row, fact) for fact in FACTS), *(_cell(row, name) for name in FIGURES)] for row in rows)
    with replacing(path) as scratch:
        scratch.write_text(text.getvalue(), encoding="utf-8")
    return path


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
