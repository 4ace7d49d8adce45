"""Reading, writing and keeping parameters."""

from __future__ import annotations

import errno
import struct
from dataclasses import replace
from typing import Any

from star_core import Camera
from star_core.testing import scene
from star_fleet.packet import Port, join
from star_fleet.parameters import CONTENTS, PARAMETERS
from tests.plugins.commands.star_fleet.conftest import Bench
from tests.simulators import ideal_fleet

DEVIATION = CONTENTS.number["locSrv.extPosStdDev"]
DECK = CONTENTS.number["deck.bcFlow2"]
RING = CONTENTS.number["ring.effect"]


def read(bench: Any, number: int) -> bytes:
    (answer,) = bench.ask(Port.PARAMETERS, 1, struct.pack("<H", number))
    return bytes(answer)


def test_every_parameter_can_be_read(bench: Bench) -> None:
    for number, parameter in enumerate(PARAMETERS):
        answer = read(bench, number)
        assert answer[:3] == struct.pack("<HB", number, 0)
        (value,) = struct.unpack(parameter.layout, answer[3:])
        assert struct.pack(parameter.layout, value) == struct.pack(
            parameter.layout, parameter.first
        )


def test_a_vehicle_with_a_camera_has_an_ai_deck() -> None:
    room = scene(2)
    agents = (room.agents[0], replace(room.agents[1], camera=Camera()))
    fleet = ideal_fleet(replace(room, agents=agents))
    asked = struct.pack("<H", CONTENTS.number["deck.bcAI"])
    for row in (0, 1):
        answer = join(Port.PARAMETERS, 1, asked + bytes([0, row]))
        assert fleet.handle(row, join(Port.PARAMETERS, 1, asked)) == [answer]
    fleet.close()


def test_a_write_is_answered_with_the_same_bytes_and_stays(bench: Bench) -> None:
    payload = struct.pack("<Hf", DEVIATION, 0.25)
    assert bench.ask(Port.PARAMETERS, 2, payload) == [payload]
    assert read(bench, DEVIATION)[3:] == struct.pack("<f", 0.25)


def test_writes_to_read_only_parameters_are_not_answered(bench: Bench) -> None:
    assert bench.ask(Port.PARAMETERS, 2, struct.pack("<HB", DECK, 0)) == []
    assert read(bench, DECK)[3:] == b"\x01"


def test_a_parameter_that_is_not_there_has_no_entry(bench: Bench) -> None:
    unknown = struct.pack("<H", 5000)
    for channel in (1, 2):
        answer = bench.ask(Port.PARAMETERS, channel, unknown + b"\0")
        assert answer == [unknown + bytes([errno.ENOENT])]


def test_a_value_that_is_too_short_or_no_number_is_not_written(bench: Bench) -> None:
    for value in (b"\0\0\0", struct.pack("<f", float("nan"))):
        assert bench.ask(Port.PARAMETERS, 2, struct.pack("<H", DEVIATION) + value) == []
    assert read(bench, DEVIATION)[3:] == struct.pack("<f", 0.01)


def test_a_parameter_can_be_written_by_its_name(bench: Bench) -> None:
    head = b"\0locSrv\0extPosStdDev\0"
    payload = head + struct.pack("<Bf", 0x06, 0.5)
    assert bench.ask(Port.PARAMETERS, 3, payload) == [head + b"\0"]
    assert read(bench, DEVIATION)[3:] == struct.pack("<f", 0.5)
    assert bench.ask(Port.PARAMETERS, 3, b"\0no\0such\0\x08\x01") == [
        b"\0no\0such\0" + bytes([errno.ENOENT])
    ]
    assert bench.ask(Port.PARAMETERS, 3, head + b"\x08\x01") == [head + bytes([errno.EINVAL])]
    assert bench.ask(Port.PARAMETERS, 3, b"\0deck\0bcFlow2\0\x08\x01") == [
        b"\0deck\0bcFlow2\0" + bytes([errno.EACCES])
    ]


def test_the_first_value_is_reported(bench: Bench) -> None:
    bench.write("locSrv.extPosStdDev", "f", 3.0)
    asked = struct.pack("<BH", 8, DEVIATION)
    assert bench.ask(Port.PARAMETERS, 3, asked) == [asked + b"\0" + struct.pack("<f", 0.01)]
    asked = struct.pack("<BH", 8, DECK)
    assert bench.ask(Port.PARAMETERS, 3, asked) == [asked + bytes([errno.ENOENT])]


def test_a_persistent_parameter_is_stored_sent_and_forgotten(bench: Bench) -> None:

    def ask(command: int, number: int = RING) -> bytes:
        head = struct.pack("<BH", command, number)
        (answer,) = bench.ask(Port.PARAMETERS, 3, head)
        assert answer[:3] == head
        return bytes(answer[3:])

    assert ask(7) == b"\0\x01"
    assert ask(7, DEVIATION) == b"\0\0"
    assert ask(4) == b"\0\x06"
    bench.write("ring.effect", "B", 9)
    assert ask(3) == b"\0"
    assert ask(4) == b"\x01\x06\x09"
    assert ask(5) == b"\0"
    assert ask(5) == bytes([errno.ENOENT])
    assert ask(3, DEVIATION) == bytes([errno.ENOENT])
