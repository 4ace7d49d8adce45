"""Reading and writing memories."""

from __future__ import annotations

import errno
import struct
from collections.abc import Callable
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from star_fleet.memory import READ, WRITE, Memories
from star_fleet.packet import Port

Start = Callable[..., Any]


def write(bench: Any, address: int, data: bytes, memory: int = 1) -> int:
    head = struct.pack("<BI", memory, address)
    (answer,) = bench.ask(Port.MEMORY, WRITE, head + data)
    assert answer[:5] == head
    assert len(answer) == 6
    return int(answer[5])


def read(bench: Any, address: int, count: int, memory: int = 1) -> tuple[int, bytes]:
    head = struct.pack("<BI", memory, address)
    (answer,) = bench.ask(Port.MEMORY, READ, head + bytes([count]))
    assert answer[:5] == head
    return answer[5], answer[6:]


def test_what_is_written_is_read(start: Start) -> None:
    bench = start()
    assert write(bench, 4072, b"x" * 24) == 0
    assert read(bench, 4072, 24) == (0, b"x" * 24)


def test_what_is_outside_a_memory_is_an_error(start: Start) -> None:
    bench = start()
    assert write(bench, 4090, b"x" * 24) == errno.EIO
    assert read(bench, 4090, 24) == (errno.EIO, b"")
    assert read(bench, 0, 25) == (errno.EIO, b"")
    assert read(bench, 0, 1, memory=7) == (errno.EIO, b"")
    assert read(bench, 4072, 24) == (0, bytes(24))


def test_the_configuration_holds_the_address_and_its_checksum(start: Start) -> None:
    bench = start(2)
    bench.fleet.handle(1, b"\0")
    head = struct.pack("<BI", 0, 0)
    (packet,) = bench.ask(Port.MEMORY, READ, head + b"\x15", 1)
    block = packet[6:]
    assert block[:4] == b"0xBC"
    version, channel, speed, _, _, high, low = struct.unpack_from("<BBBffBI", block, 4)
    assert (version, channel, speed) == (1, 80, 2)
    assert high << 32 | low == 0xE7E7E7E702
    assert block[20] == sum(block[:20]) % 256


@given(st.integers(0, 3), st.binary(max_size=30))
def test_no_question_breaks_it_or_is_answered_at_length(channel: int, payload: bytes) -> None:
    answer = Memories(0xE7E7E7E7E7).answer(channel, payload)
    assert answer is None or len(answer) <= 30
