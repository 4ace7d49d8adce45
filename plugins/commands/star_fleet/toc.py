"""Tables of contents: how a client learns which variables a vehicle has, and their numbers."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from star_fleet.packet import read

ITEM, INFO = 2, 3  # commands; 0 and 1 are for protocol versions below 4, no longer in use


@dataclass(frozen=True, slots=True)
class Entry:
    """One variable.

    Attributes:
        name: ``group.name``.
        code: Its type and flags, as a table of contents has them.
    """

    name: str
    code: int

    def described(self) -> bytes:
        """The entry as sent to clients."""
        group, _, name = self.name.partition(".")
        return bytes([self.code]) + group.encode() + b"\0" + name.encode() + b"\0"


class Contents:
    """Answers questions about a table of variables.

    Args:
        salt: Keeps the checksums of two tables apart, by which clients remember them.
        entries: The variables; their place is their number.
        tail: What the answer about the whole ends with.
    """

    def __init__(self, salt: bytes, entries: Sequence[Entry], tail: bytes = b"") -> None:
        self.number: Final = {entry.name: i for i, entry in enumerate(entries)}
        self.entries: Final = tuple(entries)
        described = [entry.described() for entry in entries]
        checksum = zlib.crc32(salt + b"".join(described))
        self._info = struct.pack("<BHI", INFO, len(entries), checksum) + tail
        self._items = [struct.pack("<BH", ITEM, i) + text for i, text in enumerate(described)]

    def answer(self, payload: bytes) -> bytes | None:
        """Return the answer to a question; None if it is none."""
        if not payload:
            return None
        if payload[0] == INFO:
            return self._info
        if payload[0] == ITEM and (asked := read("H", payload, 1)) is not None:
            number: int = asked[0]
            return self._items[number] if number < len(self._items) else bytes([ITEM])
        return None
