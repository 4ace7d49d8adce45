"""Memories that a client reads and writes over the link."""

from __future__ import annotations

import errno
import operator
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from star_core import World
from star_core.toolkit import rotation_from_quaternion
from star_fleet.decks import (
    LED_RING,
    MULTIRANGER,
    Deck,
    Equipment,
    deck_information,
    one_wire,
)
from star_fleet.packet import read

EEPROM, ONE_WIRE, LED, TRAJECTORY, LIGHTHOUSE = 0x00, 0x01, 0x10, 0x12, 0x14  # types
TESTER, LED_TIMING, DECKS, ZONES, DECK_CONTROL = 0x15, 0x17, 0x19, 0x1A, 0x21
TRAJECTORY_BYTES: Final = 4096  # 31 pieces of poly4d
EEPROM_BYTES: Final = 112
ONE_WIRE_BYTES: Final = 112
LED_BYTES: Final = 24  # twelve colors of 16 bits
LED_TIMING_BYTES: Final = 2000
TESTER_BYTES: Final = 0x1000
DECKS_BYTES: Final = 1 + 8 * 32  # version, and what the firmware knows of eight memories of decks
DECKS_VERSION: Final = 3
ZONE_BYTES: Final = 128  # 8 x 8 distances
MAX_READ: Final = 24  # bytes in an answer

STATIONS: Final = 4  # base stations that the firmware keeps, if built with its defaults
PAGE: Final = 0x100  # of one base station
GEOMETRY_BYTES: Final = 49  # origin, rotation and whether it is valid
CALIBRATION: Final = 0x1000  # where the calibrations begin
CALIBRATION_BYTES: Final = 61  # two sweeps, serial number and whether it is valid

COUNT, DETAILS = 1, 2  # commands of the channel 0
INFO, READ, WRITE = 0, 1, 2  # channels


class Memory:
    """Bytes that a client can read, and not write."""

    def __init__(self, content: bytearray) -> None:
        self.content, self.size = content, len(content)

    def read(self, start: int, count: int) -> bytes | None:
        """Return bytes; None if they cannot be read."""
        return bytes(self.content[start : start + count]) if start + count <= self.size else None

    def write(self, start: int, data: bytes) -> bool:
        """Write bytes; return whether that is possible."""
        return False


class Stored(Memory):
    """Bytes that stay as they are written: what is written changes the content."""

    def write(self, start: int, data: bytes) -> bool:
        if start + len(data) > self.size:
            return False
        self.content[start : start + len(data)] = data
        return True


class Tester(Memory):
    """Bytes that are their own addresses, for tests of the link.

    Attributes:
        errors: Bytes written that were not.
    """

    def __init__(self) -> None:
        super().__init__(bytearray(range(256)) * (TESTER_BYTES // 256))
        self.errors = 0

    def write(self, start: int, data: bytes) -> bool:
        expected = self.read(start, len(data))
        if expected is None:
            return False
        self.errors += sum(map(operator.ne, data, expected))
        return True


class Stations(Memory):
    """Geometries and calibrations of Lighthouse base stations, a page each.

    Args:
        geometries: Of the first ones, as they are stored.
    """

    def __init__(self, geometries: Iterable[bytes]) -> None:
        super().__init__(bytearray(2 * CALIBRATION))
        self._pages = {
            start + PAGE * i: Stored(bytearray(count))
            for start, count in ((0, GEOMETRY_BYTES), (CALIBRATION, CALIBRATION_BYTES))
            for i in range(STATIONS)
        }
        for i, geometry in enumerate(geometries):
            self.write(PAGE * i, geometry)

    def read(self, start: int, count: int) -> bytes | None:
        page = self._pages.get(start // PAGE * PAGE)
        return None if page is None else page.read(start % PAGE, count)

    def write(self, start: int, data: bytes) -> bool:
        page = self._pages.get(start // PAGE * PAGE)
        return page is not None and page.write(start % PAGE, data)


class Zones(Memory):
    """Distances that a sensor measures in 8 x 8 directions, measured as the first is read.

    Args:
        measure: Returns them, mm, row by row from above.
    """

    def __init__(self, measure: Callable[[], Sequence[int]]) -> None:
        super().__init__(bytearray(ZONE_BYTES))
        self._measure = measure

    def read(self, start: int, count: int) -> bytes | None:
        if start == 0:
            self.content[:] = struct.pack("<64H", *self._measure())
        return super().read(start, count)


class Entry(NamedTuple):
    """A memory in the list that clients read.

    Attributes:
        kind: Its type.
        memory: What is in it.
        serial: Of the chip, of a 1-wire memory.
    """

    kind: int
    memory: Memory
    serial: bytes = bytes(8)


class Memories:
    """All memories of one vehicle, whose address on the radio has five bytes."""

    def __init__(self, address: int, decks: Sequence[Deck], equipment: Equipment) -> None:
        self.trajectory: Final = bytearray(TRAJECTORY_BYTES)
        self.tester: Final = Tester()
        self._memories = (
            Entry(EEPROM, Stored(bytearray(_configuration(address).ljust(EEPROM_BYTES, b"\xff")))),
            Entry(TRAJECTORY, Stored(self.trajectory)),
            Entry(LIGHTHOUSE, Stations(equipment.stations)),
            Entry(TESTER, self.tester),
            Entry(DECKS, Memory(bytearray([DECKS_VERSION]).ljust(DECKS_BYTES, b"\0"))),
            *_of_decks(decks, equipment.zones),
        )

    def answer(self, channel: int, payload: bytes) -> bytes | None:
        """Return the answer to a question or an order; None for other packets."""
        if channel == INFO:
            return self._info(payload)
        head = read("BI", payload)
        if head is None or (channel == READ and len(payload) <= 5):  # noqa: PLR2004 -- no length
            return None
        number, start = head
        memory = self._memories[number].memory if number < len(self._memories) else None
        data: bytes | None = None
        if channel == READ:
            count = payload[5]
            data = memory.read(start, count) if memory and count <= MAX_READ else None
        elif channel == WRITE:
            data = b"" if memory and memory.write(start, payload[5:]) else None
        else:
            return None
        return payload[:5] + (bytes([errno.EIO]) if data is None else b"\0" + data)

    def _info(self, payload: bytes) -> bytes | None:
        if payload[:1] == bytes([COUNT]):
            return bytes([COUNT, len(self._memories)])
        if payload[:1] == bytes([DETAILS]) and len(payload) > 1:
            number = payload[1]
            if number >= len(self._memories):
                return payload[:2]
            kind, memory, serial = self._memories[number]
            return struct.pack("<BBBI", DETAILS, number, kind, memory.size) + serial
        return None


def geometries(world: World) -> list[bytes]:
    """Return the geometries of a world's base stations, as the memory of drones has them."""
    return [
        struct.pack(
            "<12f?",
            *station.position,
            *rotation_from_quaternion(station.rotation).ravel().tolist(),
            True,  # noqa: FBT003 -- it is valid
        )
        for station in world.base_stations
    ]


def _of_decks(decks: Sequence[Deck], zones: Callable[[], Sequence[int]]) -> Iterator[Entry]:
    """Yield the memories that decks bring with them."""
    for i, deck in enumerate(decks):
        if deck.controlled:
            yield Entry(DECK_CONTROL, Memory(bytearray(deck_information(deck))))
        else:
            content = bytearray(one_wire(deck).ljust(ONE_WIRE_BYTES, b"\xff"))
            yield Entry(ONE_WIRE, Stored(content), bytes([0x0D, *([0] * 5), i + 1, deck.product]))
    if LED_RING in decks:
        yield Entry(LED, Stored(bytearray(LED_BYTES)))
        yield Entry(LED_TIMING, Stored(bytearray(LED_TIMING_BYTES)))
    if MULTIRANGER in decks:
        yield Entry(ZONES, Zones(zones))


def _configuration(address: int) -> bytes:
    """Return the block at the start of the EEPROM: channel 80, 2 Mbit/s, no trim, the address."""
    block = b"0xBC" + struct.pack(
        "<BBBffBI", 1, 80, 2, 0.0, 0.0, address >> 32, address & 0xFFFFFFFF
    )
    return block + bytes([sum(block) % 256])
