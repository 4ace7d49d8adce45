"""Command ``star recover``: completes the recording of a run that was interrupted."""

from __future__ import annotations

import argparse
import os
import struct
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from zstandard import CONTENTSIZE_UNKNOWN, ZstdError, get_frame_parameters

from star_core import InputError, Registry
from star_core.toolkit import Progress
from star_mcap.messages import FILE
from star_mcap.writer import begin

MAX_RECORD: Final = 1 << 26  # bytes; a longer one is damaged
MAX_UNPACKED: Final = 1 << 30  # bytes of all chunks of a file that is small
MAX_RATIO: Final = 100  # of those of a larger file to the file
DAMAGE: Final = (
    McapError,
    struct.error,
    ZstdError,
    ValueError,
    LookupError,
    MemoryError,
    RuntimeError,
    OverflowError,
)
"""What the reader raises for a damaged file."""


def run(options: argparse.Namespace, _registry: Registry) -> int:
    """Complete a recording and return the exit status, 0.

    Raises:
        InputError: There is no recording, or it cannot be read or written.
    """
    folder = Path(options.run)
    path = folder / FILE if folder.is_dir() else folder
    if not path.is_file():
        raise InputError(f"{path}: no such recording; name the folder of a run", "no-record")
    try:
        with Progress(f"recovering {path}"):
            recovery = recover(path)
    except (OSError, McapError) as error:
        raise InputError(f"{path}: cannot be recovered: {error}", "unreadable-file") from error
    lost = f", without {recovery.lost} damaged records" if recovery.lost else ""
    sys.stdout.write(f"{path}: {recovery.messages} messages, {recovery.seconds:.1f} s{lost}\n")
    return 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Complete the recording of a run whose program was killed: everything up to "
        "the last second. A complete recording stays as it is."
    )
    line.add_argument("run", help=f"folder of a run, or an MCAP file ({FILE})")


class Recovered(NamedTuple):
    """What a recording holds.

    Attributes:
        messages: Number of messages.
        seconds: Time from the first to the last, s.
        lost: Number of damaged records: chunks of messages, and messages of unknown channels.
    """

    messages: int
    seconds: float
    lost: int


def recover(path: Path) -> Recovered:
    """Write the index and the end of a recording that lacks them, without its damaged records.

    The file is replaced once its copy is complete.

    Raises:
        OSError: A file cannot be read or written.
        McapError: It is no MCAP file, or none of its messages can be read.
    """
    copy = path.with_suffix(".mcap.part")
    times: list[int] = []
    lost = count = 0
    try:
        copy.unlink(missing_ok=True)  # it may be a link
        with path.open("rb") as source, copy.open("xb") as target:
            writer = begin(target)
            channels = _copy_channels(source, writer)
            source.seek(0)
            for record in _readable(source):
                if isinstance(record, Metadata):
                    writer.add_metadata(record.name, record.metadata)
                elif isinstance(record, Message) and record.channel_id in channels:
                    channel, at = channels[record.channel_id], record.log_time
                    writer.add_message(channel, at, record.data, record.publish_time)
                    times, count = [*times[:1], at], count + 1
                elif record is None or isinstance(record, Message):
                    lost += 1
            writer.finish()  # type: ignore[no-untyped-call]
        if not count:
            raise McapError("none of its messages can be read")
        copy.replace(path)
    finally:
        copy.unlink(missing_ok=True)
    return Recovered(count, (times[-1] - times[0]) / 1e9, lost)


def _copy_channels(source: BinaryIO, writer: Writer) -> dict[int, int]:
    """Register the channels of a file, some of which only its summary may have, and their schemas.

    Returns the new number of each channel by its old one.
    """
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    for record in _readable(source):
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif (
            isinstance(record, Channel)
            and record.id not in channels
            and record.schema_id in schemas
        ):
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schemas[record.schema_id]
            )
    return channels


def _readable(stream: BinaryIO) -> Iterator[McapRecord | None]:
    """Yield the records of a file, and None for each damaged one.

    Raises:
        McapError: Not even its header can be read.
    """
    records = StreamReader(stream, emit_chunks=True, record_size_limit=MAX_RECORD).records
    left = max(MAX_UNPACKED, MAX_RATIO * os.fstat(stream.fileno()).st_size)
    try:
        yield next(records)
    except (StopIteration, *DAMAGE) as error:
        raise McapError("it is no MCAP file") from error
    try:
        for record in records:
            if isinstance(record, Chunk):
                if record.uncompressed_size > min(left, MAX_RECORD):
                    yield None
                    continue
                left -= record.uncompressed_size
                yield from _unpacked(record)
            else:
                yield record
    except DAMAGE:  # where the next record begins is unknown
        if stream.read(1):  # it is not the end of an interrupted recording
            yield None


def _unpacked(chunk: Chunk) -> Iterable[McapRecord | None]:
    """Return the records of a chunk; None if they are damaged."""
    if chunk.compression not in {"", "zstd"}:
        return [None]
    try:
        if chunk.compression:
            size = get_frame_parameters(chunk.data).content_size
            if size not in {chunk.uncompressed_size, CONTENTSIZE_UNKNOWN}:
                return [None]
        return breakup_chunk(chunk, validate_crc=True)
    except DAMAGE:
        return [None]
