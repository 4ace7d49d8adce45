"""Reading and writing memories."""

from __future__ import annotations

import errno
import struct
import zlib
from dataclasses import replace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from star_core.testing import scene
from star_core.world.world import Beacon
from star_fleet.decks import OPTIONAL, Equipment
from star_fleet.memory import READ, WRITE, Memories
from star_fleet.packet import Port
from tests.plugins.commands.star_fleet.conftest import Bench, Start


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


def test_what_is_written_is_read(bench: Bench) -> None:
    assert write(bench, 4072, b"x" * 24) == 0
    assert read(bench, 4072, 24) == (0, b"x" * 24)


def test_what_is_outside_a_memory_is_an_error(bench: Bench) -> None:
    assert write(bench, 4090, b"x" * 24) == errno.EIO
    assert read(bench, 4090, 24) == (errno.EIO, b"")
    assert read(bench, 0, 25) == (errno.EIO, b"")
    assert read(bench, 0, 1, memory=9) == (errno.EIO, b"")
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


def memories(bench: Any) -> dict[int, list[int]]:
    """Return the numbers of all memories, by type."""
    ((_, count),) = bench.ask(Port.MEMORY, 0, b"\x01")
    numbers: dict[int, list[int]] = {}
    for number in range(count):
        (answer,) = bench.ask(Port.MEMORY, 0, bytes([2, number]))
        numbers.setdefault(answer[2], []).append(number)
    return numbers


def test_decks_bring_memories(start: Start) -> None:
    assert memories(start()) == {0x00: [0], 0x12: [1], 0x14: [2], 0x15: [3], 0x19: [4], 0x01: [5]}
    full = memories(start(decks=[*OPTIONAL.values()]))
    assert {kind: len(numbers) for kind, numbers in full.items()} == {
        0x00: 1,
        0x12: 1,
        0x14: 1,
        0x15: 1,
        0x19: 1,
        0x01: 3,
        0x10: 1,
        0x17: 1,
        0x1A: 1,
        0x21: 2,
    }


def test_a_one_wire_memory_names_its_deck(start: Start) -> None:
    status, content = read(start(), 0, 24, memory=5)
    assert status == 0
    magic, _, vendor, product, checksum = struct.unpack_from("<BIBBB", content)
    assert (magic, vendor, product) == (0xEB, 0xBC, 0x0F)
    assert checksum == zlib.crc32(content[:7]) & 0xFF
    version, length = content[8:10]
    assert (version, content[10:12]) == (0, bytes([1, 7]))
    assert content[12:19] == b"bcFlow2"
    assert content[10 + length] == zlib.crc32(content[8 : 10 + length]) & 0xFF


def test_a_deck_with_a_controller_describes_itself(start: Start) -> None:
    bench = start(decks=[OPTIONAL["color-led-top"]])
    (number,) = memories(bench)[0x21]
    content = read(bench, 0, 24, number)[1] + read(bench, 24, 8, number)[1]
    assert content[:2] == b"\xbc\xdc"
    assert content[4:6] == b"\xbc\x14"
    assert content[7:21] == b"bcColorLedTop\0"
    assert sum(content) % 256 == 0
    assert write(bench, 0, b"x", number) == errno.EIO


def test_the_tester_reads_addresses_and_counts_errors(bench: Bench) -> None:
    assert read(bench, 250, 8, memory=3) == (0, bytes([250, 251, 252, 253, 254, 255, 0, 1]))
    assert write(bench, 254, b"\xfe\xff\0\x07", memory=3) == 0
    assert bench.log("memTst.errCntW") == (1,)
    bench.write("memTst.resetW", "B", 1)
    assert bench.log("memTst.errCntW") == (0,)
    assert write(bench, 4094, b"\xfe\xff\0", memory=3) == errno.EIO


def test_lighthouse_geometries_are_those_of_the_world(start: Start) -> None:
    world = replace(scene(1).world, base_stations=(Beacon("bs", (1.0, 2.0, 3.0)),))
    bench = start(world=world)
    content = b"".join(read(bench, at, 7, memory=2)[1] for at in range(0, 49, 7))
    assert struct.unpack("<12f?", content) == (1, 2, 3, 1, 0, 0, 0, 1, 0, 0, 0, 1, True)
    assert read(bench, 0x100, 24, memory=2) == (0, bytes(24))
    assert read(bench, 0x400, 24, memory=2) == (errno.EIO, b"")  # four stations
    assert read(bench, 40, 10, memory=2) == (errno.EIO, b"")
    assert write(bench, 0x1100, b"calibration", memory=2) == 0
    assert read(bench, 0x1100, 11, memory=2) == (0, b"calibration")
    assert bench.ask(Port.LOCALISATION, 1, b"\x0b\x01\0\0\0") == [b"\x0b\x01"]


@given(st.integers(0, 3), st.binary(max_size=30))
def test_no_question_breaks_it_or_is_answered_at_length(channel: int, payload: bytes) -> None:
    answer = Memories(0xE7E7E7E7E7, [], Equipment([], [], lambda: [0] * 64)).answer(
        channel, payload
    )
    assert answer is None or len(answer) <= 30
