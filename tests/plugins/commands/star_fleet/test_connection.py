"""What a client asks before it is connected, in the order in which it asks."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from star_fleet import log, parameters
from star_fleet.packet import NULL, Port, described
from tests.plugins.commands.star_fleet.conftest import Bench, Start


def test_a_null_packet_is_answered_with_one(start: Start) -> None:
    assert start().fleet.handle(0, b"\xff") == [NULL]


def test_the_link_source_reports_what_it_is(start: Start) -> None:
    (answer,) = start().ask(Port.LINK, 1, b"\0")
    assert len(answer) == 30
    assert answer[:19] == b"Bitcraze Crazyflie\0"


def test_the_protocol_is_the_one_with_a_supervisor_port(start: Start) -> None:
    assert start().ask(Port.PLATFORM, 1, b"\0") == [struct.pack("<Bi", 0, 12)]


def test_an_echo_is_the_same_bytes(start: Start) -> None:
    payload = struct.pack("<Bd", 0, 1234.5)
    assert start().ask(Port.LINK, 0, payload) == [payload]


@pytest.mark.parametrize(
    ("port", "contents", "tail"),
    [(Port.LOG, log.CONTENTS, b"\x10\x80"), (Port.PARAMETERS, parameters.CONTENTS, b"")],
)
def test_a_table_has_its_size_and_every_entry(
    bench: Bench, port: int, contents: Any, tail: bytes
) -> None:
    (info,) = bench.ask(port, 0, b"\x03")
    command, count, _checksum = struct.unpack_from("<BHI", info)
    assert (command, count, info[7:]) == (3, len(contents.entries), tail)
    for i, entry in enumerate(contents.entries):
        (item,) = bench.ask(port, 0, struct.pack("<BH", 2, i))
        assert struct.unpack_from("<BHB", item) == (2, i, entry.code)
        assert item[4:] == entry.name.replace(".", "\0").encode() + b"\0"


def test_an_entry_that_is_not_there_is_answered_without_one(start: Start) -> None:
    assert start().ask(Port.LOG, 0, struct.pack("<BH", 2, 60000)) == [b"\x02"]


def test_the_checksums_of_the_tables_differ(bench: Bench) -> None:
    sums = {bench.ask(port, 0, b"\x03")[0][3:7] for port in (Port.LOG, Port.PARAMETERS)}
    assert len(sums) == 2


def test_every_name_is_unique_and_fits_into_a_packet() -> None:
    for contents in (log.CONTENTS, parameters.CONTENTS):
        assert len(contents.number) == len(contents.entries)
        assert all(len(described(entry)) <= 27 for entry in contents.entries)


def test_configuration_and_trajectory_are_the_first_memories(bench: Bench) -> None:
    assert bench.ask(Port.MEMORY, 0, b"\x01") == [b"\x01\x06"]
    (configuration,) = bench.ask(Port.MEMORY, 0, b"\x02\x00")
    assert struct.unpack("<BBBI8s", configuration) == (2, 0, 0x00, 112, bytes(8))
    (trajectory,) = bench.ask(Port.MEMORY, 0, b"\x02\x01")
    assert struct.unpack("<BBBI8s", trajectory) == (2, 1, 0x12, 4096, bytes(8))
    assert bench.ask(Port.MEMORY, 0, b"\x02\x09") == [b"\x02\x09"]


def test_a_vehicle_reports_that_it_runs_once_a_client_listens(bench: Bench) -> None:
    bench.fly(0.1)
    assert bench.streamed[0] == []
    bench.ask(Port.LINK, 0, b"hello")
    bench.fly(0.1)
    said = b"".join(packet[1:] for packet in bench.streamed[0])
    assert said == b"SYS: Crazyflie 2.1 is up and running!\n"
    assert all(packet[0] == 0 and len(packet) <= 31 for packet in bench.streamed[0])


def test_a_port_that_is_closed_is_not_answered(bench: Bench) -> None:
    for port in (1, 10, 11, 12, 14):
        assert bench.ask(port, 0, b"\0\0\0") == []
