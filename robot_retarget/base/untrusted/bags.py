"""Messages of MCAP files (extra `formats`)."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from robot_retarget.base.errors import FileError, install_line
from robot_retarget.base.untrusted.limits import LIMITS, one_line, too_large

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
