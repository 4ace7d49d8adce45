"""CRTP packets for connecting: tables of contents, parameters, log blocks and memories.

A packet is a header byte and a payload of up to 30 bytes, little-endian, as sent over the link.
Names of the protocol are in capitals; the formats are those of firmware with protocol version 4
(2018) or later.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final, Protocol

MAX_PAYLOAD: Final = 30  # bytes of payload, at most
MAX_COORDINATE: Final = 32.767  # largest value in 16 bits of thousandths: m along each axis, etc.

CONSOLE, PARAMETER, MEMORY, LOG = 0, 2, 4, 5  # ports
LOCALISATION, HIGH_LEVEL, SUPERVISOR, PLATFORM, LINK = 6, 8, 9, 13, 15
TABLE, SETTINGS, DATA = 0, 1, 2  # channels of LOG; of PARAMETER: TABLE, READ, WRITE
READ: Final = 1
WRITE: Final = 2
VERSION: Final = 1  # channel of PLATFORM
PROTOCOL, FIRMWARE = bytes([0]), bytes([1])
RESET, CREATE, APPEND = bytes([5]), bytes([6]), bytes([7])
DELETE, START = bytes([2]), bytes([3])
TABLE_SIZE, TABLE_ITEM = bytes([3]), bytes([2])
MEMORY_INFO, MEMORY_WRITE = 0, 2  # channels of MEMORY
MEMORY_PIECE: Final = 24  # bytes of memory written by one packet

_TIME: Final = struct.Struct("<d")
_LEGACY: Final = 0x0C  # two bits that are set in sent packets and have no meaning in received ones


def packet(port: int, channel: int, payload: bytes = b"") -> bytes:
    """Return a packet.

    >>> packet(LOG, SETTINGS, RESET).hex()
    '5d05'

    Raises:
        ValueError: The payload is too long.
    """
    if len(payload) > MAX_PAYLOAD:
        raise ValueError(f"expected at most {MAX_PAYLOAD} bytes of payload, got {len(payload)}")
    return bytes([port << 4 | _LEGACY | channel]) + payload


def address(header: int) -> tuple[int, int]:
    """Return port and channel of a header byte; its other two bits have no meaning.

    >>> address(0x5E), address(0x52)
    ((5, 2), (5, 2))
    """
    return header >> 4, header & 0x03


def is_null(header: int) -> bool:
    """Whether a header byte is that of a null packet, which only keeps the link alive."""
    return header & 0xF3 == 0xF3  # noqa: PLR2004 -- port 15, channel 3


def echo(sent: float) -> bytes:
    """Ask for a timestamp back, s: this measures the round trip and keeps the link alive."""
    return packet(LINK, 0, _TIME.pack(sent))


def echoed(payload: bytes) -> float | None:
    """Return the timestamp in an echo, s; None if the echo has another format."""
    return float(_TIME.unpack(payload)[0]) if len(payload) == _TIME.size else None


def table_item(port: int, number: int) -> bytes:
    """Ask for one entry of a table of contents."""
    return packet(port, TABLE, TABLE_ITEM + struct.pack("<H", number))


def read_parameter(number: int) -> bytes:
    """Ask for the value of a parameter."""
    return packet(PARAMETER, READ, struct.pack("<H", number))


def write_parameter(number: int, value: bytes) -> bytes:
    """Set a parameter; the answer has the same bytes."""
    return packet(PARAMETER, WRITE, struct.pack("<H", number) + value)


def log_variable(kind: int, number: int) -> bytes:
    """Return the entry of a variable in a log block: the type to send, and its number."""
    return struct.pack("<BH", kind, number)


def log_block(block: int, variables: bytes, command: bytes = CREATE) -> bytes:
    """Create a block of log variables, or append to one."""
    return packet(LOG, SETTINGS, command + bytes([block]) + variables)


def start_block(block: int, period: float) -> bytes:
    """Report a block every `period`, s, in steps of 10 ms, at most 2.55 s."""
    return packet(LOG, SETTINGS, START + bytes([block, min(255, max(1, round(period * 100)))]))


def delete_block(block: int) -> bytes:
    """Stop and delete a block."""
    return packet(LOG, SETTINGS, DELETE + bytes([block]))


def memory_info(number: int) -> bytes:
    """Ask for the type of a memory."""
    return packet(MEMORY, MEMORY_INFO, bytes([2, number]))


def write_memory(number: int, at: int, data: bytes) -> Iterator[bytes]:
    """Write data to a memory, from byte `at` on: `MEMORY_PIECE` bytes in each packet."""
    for start in range(0, len(data), MEMORY_PIECE):
        head = struct.pack("<BI", number, at + start)
        yield packet(MEMORY, MEMORY_WRITE, head + data[start : start + MEMORY_PIECE])


class LinkDriver(Protocol):
    """Transmits packets to one drone without blocking the caller."""

    def send(self, packet: bytes) -> None:
        """Queue a packet; this drops a setpoint that is still queued."""
        ...

    def steer(self, setpoint: bytes) -> None:
        """Queue a setpoint; it replaces one that is still queued."""
        ...

    def close(self) -> None:
        """Close the driver. Safe to call twice."""
        ...


class LinkListener(Protocol):
    """Receives packets and errors from a driver, each call in the driver's thread."""

    def hear(self, packet: bytes, arrived: float) -> None:
        """Handle a packet that arrived at `arrived`, s of the computer's clock."""
        ...

    def idle(self, now: float) -> None:
        """Send a keep-alive packet if one is due; called several times a second."""
        ...

    def complain(self, message: str) -> None:
        """Record an error; the driver may recover."""
        ...

    def note_quality(self, quality: dict[str, float]) -> None:
        """Record link statistics of a dongle, under cflib's names."""
        ...
