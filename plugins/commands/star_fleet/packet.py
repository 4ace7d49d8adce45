"""CRTP packets, and the tables of contents that clients read by them."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from star_core import Array

MAX_PAYLOAD: Final = 30  # bytes
NULL: Final = b"\xff"  # sent by a radio to poll, and by a client to find vehicles
MAX_VALUE: Final = 1e4  # of any number that steers a vehicle: m, m/s, °; beyond it is no flight

_RESERVED: Final = 0x0C  # bits of the header that clients set and the firmware does not
_HALF: Final = math.sqrt(0.5)
_STEPS: Final = 511  # 9 bits


class Port(IntEnum):
    """Port of a packet."""

    CONSOLE = 0
    PARAMETERS = 2
    ATTITUDE = 3  # roll, pitch, yaw rate and thrust
    MEMORY = 4
    LOG = 5
    LOCALISATION = 6
    SETPOINT = 7
    HIGH_LEVEL = 8
    SUPERVISOR = 9
    PLATFORM = 13
    LINK = 15


def join(port: int, channel: int, payload: bytes) -> bytes:
    """Return the packet with a payload.

    >>> join(Port.LINK, 1, b"ab").hex()
    'f16162'
    """
    return bytes([port << 4 | channel]) + payload


def split(packet: bytes) -> tuple[int, int, bytes] | None:
    """Return port, channel and payload; None for what is no packet (empty, or too long)."""
    if not 1 <= len(packet) <= 1 + MAX_PAYLOAD:
        return None
    return packet[0] >> 4, packet[0] & 3, packet[1:]


def is_null(packet: bytes) -> bool:
    """Whether a packet is the null packet, whose reserved bits and payload do not count."""
    return bool(packet) and packet[0] | _RESERVED == NULL[0]


def read(form: str, payload: bytes, at: int = 0) -> tuple[Any, ...] | None:
    """Return the little-endian values of a `struct` format; None if the payload is too short."""
    layout = struct.Struct("<" + form)
    return layout.unpack_from(payload, at) if len(payload) >= at + layout.size else None


def sound(values: Iterable[float], most: float = MAX_VALUE) -> bool:
    """Whether all values are numbers that a vehicle can be steered with."""
    return all(abs(value) <= most for value in values)  # what is not a number compares false


def compress(quaternion: Array) -> NDArray[np.uint32]:
    """Return unit quaternions in 32 bits, as the firmware's ``quatcompress.h`` defines them.

    Two bits name the component that is largest; each of the others, in order, has a bit for its
    sign and nine for its size, of which 511 are √½. The sign is turned so that the largest is
    positive.

    Args:
        quaternion: (N, 4) x, y, z, w.

    Returns:
        (N,)

    Example:
        >>> compress(np.array([[0.0, 0, 0, 1]])) >> np.uint32(30)
        array([3], dtype=uint32)
    """
    rows = np.arange(len(quaternion))
    largest = np.abs(quaternion).argmax(axis=1)
    signed = quaternion * np.where(quaternion[rows, largest] < 0, -1.0, 1.0)[:, None]
    size = np.minimum(np.floor(np.abs(signed) / _HALF * _STEPS + 0.5), _STEPS).astype(np.uint32)
    bits = size | (signed < 0).astype(np.uint32) << np.uint32(9)
    packed = largest.astype(np.uint32)
    for axis in range(4):
        packed = np.where(axis == largest, packed, packed << np.uint32(10) | bits[:, axis])
    return np.asarray(packed, np.uint32)


def expand(packed: int) -> tuple[float, float, float, float]:
    """Return the unit quaternion x, y, z, w of 32 bits: what `compress` was given, within 0.0014.

    Bits that no unit quaternion has give one whose largest component is 0 before it is made a unit.
    """
    largest = packed >> 30
    parts = [0.0] * 4
    for axis in (3, 2, 1, 0):
        if axis != largest:
            size = (packed & _STEPS) / _STEPS * _HALF
            parts[axis] = -size if packed & 0x200 else size
            packed >>= 10
    parts[largest] = math.sqrt(max(0.0, 1.0 - sum(part * part for part in parts)))
    length = math.sqrt(sum(part * part for part in parts))
    x, y, z, w = (part / length for part in parts)
    return x, y, z, w


ITEM, INFO = 2, 3  # commands; 0 and 1 are for protocol versions below 4, no longer in use


class Entry(Protocol):
    """A variable: ``group.name``, and its type and flags."""

    @property
    def name(self) -> str: ...
    @property
    def code(self) -> int: ...


class Contents:
    """Answers questions about a table of variables.

    Args:
        salt: Keeps the checksums of two tables apart, by which clients remember them.
        entries: The variables; their index is their number.
        tail: What the answer about the whole ends with.
    """

    def __init__(self, salt: bytes, entries: Sequence[Entry], tail: bytes = b"") -> None:
        self.number = {entry.name: i for i, entry in enumerate(entries)}
        self.entries = tuple(entries)
        texts = [described(entry) for entry in entries]
        checksum = zlib.crc32(salt + b"".join(texts))
        self._info = struct.pack("<BHI", INFO, len(entries), checksum) + tail
        self._items = [struct.pack("<BH", ITEM, i) + text for i, text in enumerate(texts)]

    def answer(self, payload: bytes) -> bytes | None:
        """Return the answer to a question; None for other packets."""
        if not payload:
            return None
        if payload[0] == INFO:
            return self._info
        if payload[0] == ITEM and (asked := read("H", payload, 1)) is not None:
            number: int = asked[0]
            return self._items[number] if number < len(self._items) else bytes([ITEM])
        return None


def described(entry: Entry) -> bytes:
    group, _, name = entry.name.partition(".")
    return bytes([entry.code]) + group.encode() + b"\0" + name.encode() + b"\0"
