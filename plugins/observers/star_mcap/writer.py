"""The MCAP writer, with memory that does not grow with the length of a recording."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from tempfile import TemporaryFile
from typing import IO, Final, Self

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

CHUNK: Final = 512 * 1024  # bytes


class ChunkIndexes:
    """Stores the indexes of chunks in an unnamed file, in place of the writer's list of them.

    Each has an entry for every channel: with 30 agents the list would grow by megabytes a minute.
    """

    def __init__(self) -> None:
        self._file = TemporaryFile()  # noqa: SIM115 -- see the next line
        weakref.finalize(self, self._file.close)

    def append(self, index: ChunkIndex) -> None:
        """Store an index."""
        record = RecordBuilder()
        index.write(record)
        self._file.write(record.end())  # type: ignore[no-untyped-call]

    def __iter__(self) -> Iterator[Self]:
        """Yield what the writer calls `write` of: one object for all indexes."""
        yield self

    def write(self, summary: RecordBuilder) -> None:
        """Write all indexes into the summary of the recording."""
        self._file.seek(0)
        while piece := self._file.read(CHUNK):
            summary.write(piece)


def begin(stream: IO[bytes]) -> Writer:
    """Return a writer of a recording with ROS 2 messages that has begun."""
    writer = Writer(stream, chunk_size=CHUNK, compression=CompressionType.ZSTD)
    writer._Writer__chunk_indices = ChunkIndexes()  # type: ignore[attr-defined]  # noqa: SLF001
    writer.start(profile="ros2", library="star-swarm")
    return writer
