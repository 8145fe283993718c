"""Messages of MCAP files and columns of Parquet tables (extras `formats` and `tables`)."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import FileError, install_line
from robot_retarget.base.untrusted.limits import LIMITS, one_line, refusing, too_large

NUMBER = 8
"""Of a number in memory [bytes]; equal ones take next to nothing in a file."""


def parquet() -> Any:
    """Return pyarrow with its module `parquet`.

    Raises:
        FileError: it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise FileError(f"Parquet needs pyarrow: {install_line('tables')}") from None
    return pyarrow


def parquet_columns(path: Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Read those of the named columns that the table has, lists of equal length as rows of numbers (T, n).

    Raises:
        FileError: it is no Parquet, unpacks to more than the limit, or a column is not of numbers.
    """
    arrow = parquet()
    with refusing(path, "Parquet table"):
        try:
            file = arrow.parquet.ParquetFile(path)
            groups = [file.metadata.row_group(k) for k in range(file.num_row_groups)]
            numbers = sum(group.column(k).num_values for group in groups for k in range(group.num_columns))
            if max(numbers * NUMBER, sum(group.total_byte_size for group in groups)) > LIMITS.unpacked(path):
                raise too_large(path, LIMITS.unpacked(path))
            table = file.read(columns=[name for name in names if name in file.schema_arrow.names])
        except arrow.ArrowException as error:
            raise ValueError(str(error)) from error
        return {name: np.array(table[name].to_pylist(), dtype=float) for name in table.column_names}


MAGIC = b"\x89MCAP0\r\n"


def bag_messages(path: Path, decoders: Sequence[Any] = ()) -> Iterator[tuple[Any, Any, Any, Any]]:
    """Yield schema, channel, message and content of every message in the order of time; without decoders the bytes.

    Raises:
        FileError: it is broken, unpacks to more than the limit, or mcap is not installed.
    """
    try:
        import mcap.reader
    except ImportError:
        raise FileError(f"MCAP needs mcap: {install_line('formats')}") from None
    try:
        with path.open("rb") as stream:
            reader: Any = mcap.reader.make_reader(stream, decoder_factories=decoders)
            summary, limit = reader.get_summary(), LIMITS.unpacked(path)
            if summary and sum(chunk.uncompressed_size for chunk in summary.chunk_indexes) > limit:
                raise too_large(path, limit)
            if decoders:
                yield from reader.iter_decoded_messages()
            else:
                yield from ((*found, found[2].data) for found in reader.iter_messages())
    except FileError:
        raise
    except Exception as error:
        raise FileError(f"{path}: broken bag: {one_line(str(error))}") from error
