"""Attacks on ``star recover`` by recordings of others."""

from __future__ import annotations

import struct
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import pytest
import zstandard
from mcap.exceptions import McapError

from star_mcap import recovery
from star_mcap.messages import FILE
from star_mcap.recovery import Recovered, recover

MAGIC = b"\x89MCAP0\r\n"
HUGE = 1 << 40


def record(opcode: int, content: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(content) if length is None else length) + content


def text(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def message(size: int, channel: int = 1) -> bytes:
    return record(5, struct.pack("<HIQQ", channel, 0, 1, 1) + bytes(size))


def chunk(name: bytes, packed: bytes, size: int) -> bytes:
    head = struct.pack("<QQQI", 0, 1, size, 0) + text(name) + struct.pack("<Q", len(packed))
    return record(6, head + packed)


HEADER = MAGIC + record(1, text(b"ros2") + text(b"x"))
CHANNEL = record(4, struct.pack("<HH", 1, 0) + text(b"/x") + text(b"cdr") + text(b""))
WHOLE = HEADER + CHANNEL + message(3)
LARGE = message(1 << 22)
TRUNCATED = chunk(b"zstd", zstandard.compress(LARGE)[:50], len(LARGE))
HOSTILE = {
    "a bomb by its size": chunk(b"zstd", zstandard.compress(LARGE), HUGE),
    "a bomb that hides its size": chunk(b"zstd", zstandard.compress(LARGE), 100),
    "a bomb of LZ4": chunk(b"lz4", lz4.frame.compress(LARGE), 100),
    "an unknown compression": chunk(b"../x", LARGE, len(LARGE)),
    "a truncated chunk": TRUNCATED,
    "a chunk within a chunk": chunk(b"", TRUNCATED, len(TRUNCATED)),
    "a record longer than the file": record(5, b"x", HUGE),
    "a record longer than its chunk": chunk(b"", record(5, b"x", HUGE), 10),
    "a name longer than the file": record(4, struct.pack("<HHI", 2, 0, (1 << 32) - 1)),
    "a map longer than the file": record(12, text(b"x") + struct.pack("<I", (1 << 32) - 1)),
    "text that is none": record(4, struct.pack("<HH", 2, 0) + text(b"\xff\xfe")),
    "a channel of no schema": record(4, struct.pack("<HH", 2, 9) + text(b"") * 3) + message(1, 2),
    "a channel that changes": CHANNEL.replace(b"/x", b"/y"),
    "a hostile schema": record(3, struct.pack("<H", 7) + text(b"<script>") * 2 + text(b"\xff" * 9)),
    "an index of itself": record(8, struct.pack("<QQQQIQ", 0, 1, 8, 0, 0, 0) + text(b"")),
    "a footer that leads back": record(2, struct.pack("<QQI", 8, 8, 0)) + MAGIC,
}


@pytest.mark.parametrize("attack", HOSTILE)
def test_hostile_recordings_cost_their_own_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, attack: str
) -> None:
    unpacked: list[int] = []
    decompress = zstandard.decompress

    def note(data: bytes, *arguments: int) -> bytes:
        unpacked.append(len(content := decompress(data, *arguments)))
        return content

    monkeypatch.setattr(zstandard, "decompress", note)
    path = tmp_path / FILE
    path.write_bytes(WHOLE + HOSTILE[attack])
    recovery = recover(path)
    assert recovery.messages >= 1
    assert sum(unpacked) <= 100
    assert path.stat().st_size < 10_000
    assert recover(path) == recovery._replace(lost=0)
    assert [each.name for each in tmp_path.iterdir()] == [FILE]


def test_many_small_bombs_are_no_large_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recovery, "MAX_UNPACKED", 3 * len(LARGE))
    path = tmp_path / FILE
    bomb = chunk(b"zstd", zstandard.compress(LARGE), len(LARGE))
    path.write_bytes(WHOLE + 20 * bomb)
    assert recover(path) == Recovered(messages=4, seconds=0.0, lost=17)


def test_a_link_beside_a_recording_is_not_written_to(tmp_path: Path) -> None:
    private, path = tmp_path / "private", tmp_path / FILE
    private.write_text("private")
    path.with_suffix(".mcap.part").symlink_to(private)
    path.write_bytes(WHOLE)
    assert recover(path).messages == 1
    assert private.read_text() == "private"


@pytest.mark.parametrize("content", [b"", MAGIC, MAGIC * 2, b"\x00" * 4096, HEADER, WHOLE[:-40]])
def test_no_recording_is_refused_and_kept(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / FILE
    path.write_bytes(content)
    with pytest.raises(McapError):
        recover(path)
    assert path.read_bytes() == content
