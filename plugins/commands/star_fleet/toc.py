"""Tables of contents: how a client learns which variables a vehicle has, and their numbers."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import Protocol

from star_fleet.packet import read

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
