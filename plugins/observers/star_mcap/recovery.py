"""Command ``star recover``: completes the recording of a run that was interrupted."""

from __future__ import annotations

import argparse
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from star_core import InputError, Progress
from star_mcap.messages import FILE


def run(arguments: Sequence[str]) -> int:
    """Complete a recording and return the exit status, 0.

    Raises:
        InputError: There is no recording, or it cannot be read or written.
    """
    folder = Path(parser().parse_args(arguments).run)
    path = folder / FILE if folder.is_dir() else folder
    if not path.is_file():
        raise InputError([f"{path}: no such recording; name the folder of a run"])
    try:
        with Progress(f"recovering {path}"):
            messages, seconds = recover(path)
    except (OSError, McapError) as error:
        raise InputError([f"{path}: cannot be recovered: {error}"]) from error
    sys.stdout.write(f"{path}: {messages} messages, {seconds:.1f} s\n")
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the command-line parser; separate so that docs and tests can read it."""
    star = argparse.ArgumentParser(
        prog="star recover",
        description="Complete the recording of a run whose program was killed: everything up to "
        "the last second. A complete recording stays as it is.",
        allow_abbrev=False,
    )
    star.add_argument("run", help=f"folder of a run, or an MCAP file ({FILE})")
    return star


def recover(path: Path) -> tuple[int, float]:
    """Write the index and the end of a recording that lacks them.

    The file is replaced once its copy is complete.

    Returns:
        Number of messages, and the time from the first to the last, s.

    Raises:
        OSError: A file cannot be read or written.
        McapError: It is no MCAP file.
    """
    copy = path.with_suffix(".mcap.part")
    first = last = None
    count = 0
    try:
        with path.open("rb") as source, copy.open("wb") as target:
            writer = Writer(target, chunk_size=64 * 1024, compression=CompressionType.ZSTD)
            writer.start(profile="ros2", library="star-swarm")
            schemas: dict[int, int] = {0: 0}
            channels: dict[int, int] = {}
            for record in _readable(source):
                if isinstance(record, Schema) and record.id not in schemas:
                    schemas[record.id] = writer.register_schema(
                        record.name, record.encoding, record.data
                    )
                elif isinstance(record, Channel) and record.id not in channels:
                    channels[record.id] = writer.register_channel(
                        record.topic, record.message_encoding, schemas[record.schema_id]
                    )
                elif isinstance(record, Metadata):
                    writer.add_metadata(record.name, record.metadata)
                elif isinstance(record, Message):
                    channel, at = channels[record.channel_id], record.log_time
                    writer.add_message(channel, at, record.data, record.publish_time)
                    first, last, count = at if first is None else first, at, count + 1
            writer.finish()  # type: ignore[no-untyped-call]
        copy.replace(path)
    finally:
        copy.unlink(missing_ok=True)
    return count, 0.0 if first is None or last is None else (last - first) / 1e9


def _readable(stream: BinaryIO) -> Iterator[McapRecord]:
    """Yield the records of a file up to where it breaks off.

    Raises:
        McapError: Not even its header can be read.
    """
    records = StreamReader(stream).records
    try:
        yield next(records)
    except (StopIteration, struct.error) as error:
        raise McapError("it is no MCAP file") from error
    with suppress(McapError, struct.error):
        yield from records
