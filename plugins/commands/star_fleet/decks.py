"""Decks that a drone of the fleet can carry, and what their own memories hold."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

VENDOR: Final = 0xBC
ONE_WIRE_MAGIC, CONTROL_MAGIC = 0xEB, 0xBCDC
BOARD, REVISION = 1, 2  # elements of a 1-wire memory


@dataclass(frozen=True, slots=True)
class Deck:
    """A deck.

    Attributes:
        board: Name in its memory.
        product: Its number.
        parameter: That is 1 where it is carried.
        controlled: Whether it has a controller that describes it, in place of a 1-wire memory.
    """

    board: str
    product: int
    parameter: str
    controlled: bool = False


AI_DECK: Final = Deck("bcAI", 0x12, "deck.bcAI")
LED_RING: Final = Deck("bcLedRing", 0x01, "deck.bcLedRing")
MULTIRANGER: Final = Deck("bcMultiranger", 0x0C, "deck.bcMultiranger")
OPTIONAL: Final[Mapping[str, Deck]] = {
    "multi-ranger": MULTIRANGER,
    "led-ring": LED_RING,
    "color-led-bottom": Deck("bcColorLedBot", 0x13, "deck.bcColorLedBot", controlled=True),
    "color-led-top": Deck("bcColorLedTop", 0x14, "deck.bcColorLedTop", controlled=True),
}
"""Decks that an option adds to all drones, by its value."""
DECKS: Final = (
    Deck("bcFlow2", 0x0F, "deck.bcFlow2"),
    AI_DECK,
    Deck("bcLighthouse4", 0x10, "deck.bcLighthouse4"),
    Deck("bcDWM1000", 0x06, "deck.bcLoco"),
    *OPTIONAL.values(),
)


@dataclass(frozen=True, slots=True)
class Equipment:
    """What a drone has beside its Flow deck and the decks of its conditions.

    Attributes:
        decks: More decks.
        stations: Geometries of the Lighthouse base stations that it knows, as they are stored.
        zones: Measures the distances in the zones of a Multi-ranger's forward sensor, mm.
    """

    decks: Sequence[Deck]
    stations: Sequence[bytes]
    zones: Callable[[], Sequence[int]]


def one_wire(deck: Deck) -> bytes:
    """Return what the 1-wire memory of a deck holds: a header, and elements with their checksum."""
    header = struct.pack("<BIBB", ONE_WIRE_MAGIC, 0, VENDOR, deck.product)
    elements = b"".join(
        bytes([kind, len(text)]) + text
        for kind, text in ((BOARD, deck.board.encode()), (REVISION, b"A"))
    )
    body = bytes([0, len(elements)]) + elements
    return header + _checksum(header) + body + _checksum(body)


def deck_information(deck: Deck) -> bytes:
    """Return the 32 bytes by which a deck with a controller describes itself; they add up to 0."""
    numbers = struct.pack(">H5B", CONTROL_MAGIC, 1, 0, VENDOR, deck.product, ord("A"))
    block = (numbers + deck.board.encode()).ljust(31, b"\0")
    return block + bytes([-sum(block) % 256])


def _checksum(data: bytes) -> bytes:
    return bytes([zlib.crc32(data) & 0xFF])
