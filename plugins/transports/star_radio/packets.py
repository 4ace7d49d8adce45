"""CRTP packets of the connection: what asks a Crazyflie for its tables, and starts its reports.

A packet is its header byte and up to 30 bytes, little-endian, as it goes onto the link. The
protocol's own names stand in capitals; the formats are those of the firmware of protocol version 4
(2018) and later.
"""

from __future__ import annotations

import struct
from typing import Final

from star_core import PluginError

MOST: Final = 30  # bytes that a packet carries
FARTHEST: Final = 32.767  # what 16 bits of thousandths hold: m along each axis, and the like

CONSOLE, PARAMETER, MEMORY, LOG, PLATFORM, LINK = 0, 2, 4, 5, 13, 15
TABLE, SETTINGS, DATA = 0, 1, 2  # channels of LOG; of PARAMETER: TABLE, read, WRITE
WRITE: Final = 2
VERSION: Final = 1  # channel of PLATFORM
PROTOCOL: Final = bytes([0])
RESET, CREATE, APPEND = bytes([5]), bytes([6]), bytes([7])
DELETE, START = bytes([2]), bytes([3])
TABLE_SIZE, TABLE_ITEM = bytes([3]), bytes([2])
MEMORY_INFO, MEMORY_WRITE = 0, 2  # channels of MEMORY
MEMORY_PIECE: Final = 24  # bytes of a memory that one packet writes

_ERRORS: Final = {2: "no such variable", 7: "it is too large", 12: "it has no memory left"}
_EXISTS: Final = 17  # the same was asked before, and only the answer was lost
_LEGACY: Final = 0x0C  # two bits that are set on the way up, and mean nothing on the way down


def packet(port: int, channel: int, payload: bytes = b"") -> bytes:
    """Return a packet.

    >>> packet(LOG, SETTINGS, RESET).hex()
    '5d05'

    Raises:
        ValueError: The payload is too long.
    """
    if len(payload) > MOST:
        raise ValueError(f"a packet carries {MOST} bytes, got {len(payload)}")
    return bytes([port << 4 | _LEGACY | channel]) + payload


def address(header: int) -> tuple[int, int]:
    """Return port and channel of a header byte, whose other two bits mean nothing.

    >>> address(0x5E), address(0x52)
    ((5, 2), (5, 2))
    """
    return header >> 4, header & 0x03


def is_null(header: int) -> bool:
    """Whether a header byte is that of a packet that only keeps the link alive."""
    return header & 0xF3 == 0xF3  # noqa: PLR2004 -- port 15, channel 3


def echo() -> bytes:
    """Ask for bytes back: so the drone hears of us, and on a radio we of it."""
    return packet(LINK, 0, bytes(8))  # as many as cflib sends


def table_item(port: int, number: int) -> bytes:
    """Ask for one entry of a table of contents."""
    return packet(port, TABLE, TABLE_ITEM + struct.pack("<H", number))


def write_parameter(number: int, value: bytes) -> bytes:
    """Set a parameter; the answer has the same bytes."""
    return packet(PARAMETER, WRITE, struct.pack("<H", number) + value)


def log_block(block: int, variables: bytes, command: bytes = CREATE) -> bytes:
    """Make a block of log variables, or append to one."""
    return packet(LOG, SETTINGS, command + bytes([block]) + variables)


def start_block(block: int, period: float) -> bytes:
    """Have a block reported every `period`, s: in steps of 10 ms, at most 2.55 s."""
    return packet(LOG, SETTINGS, START + bytes([block, min(255, max(1, round(period * 100)))]))


def delete_block(block: int) -> bytes:
    """Have a block reported no more, and forgotten."""
    return packet(LOG, SETTINGS, DELETE + bytes([block]))


def accepted(answer: bytes, what: str) -> None:
    """Look whether a question about a log block was granted.

    Raises:
        PluginError: It was not; `what` is the block, in words.
    """
    error = answer[2] if len(answer) > 2 else 0  # noqa: PLR2004 -- command, block, error
    if error not in {0, _EXISTS}:
        raise PluginError(f"it refuses {what}: {_ERRORS.get(error, error)}")


def memory_info(number: int) -> bytes:
    """Ask what kind of memory has a number."""
    return packet(MEMORY, MEMORY_INFO, bytes([2, number]))


def write_memory(number: int, at: int, piece: bytes) -> bytes:
    """Write up to `MEMORY_PIECE` bytes to a memory."""
    return packet(MEMORY, MEMORY_WRITE, struct.pack("<BI", number, at) + piece)
