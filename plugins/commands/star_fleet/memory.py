"""Memories that a client reads and writes over the link."""

from __future__ import annotations

import errno
import struct
from typing import Final

from star_fleet.packet import read

EEPROM, TRAJECTORY = 0x00, 0x12  # types
TRAJECTORY_BYTES: Final = 4096  # 31 pieces of poly4d
EEPROM_BYTES: Final = 112
MAX_READ: Final = 24  # bytes in an answer

COUNT, DETAILS = 1, 2  # commands of the channel 0
INFO, READ, WRITE = 0, 1, 2  # channels


class Memories:
    """All memories of one vehicle.

    Args:
        address: The vehicle's on the radio, five bytes.
    """

    def __init__(self, address: int) -> None:
        self.trajectory: Final = bytearray(TRAJECTORY_BYTES)
        self._memories = (
            (EEPROM, bytearray(_configuration(address).ljust(EEPROM_BYTES, b"\xff"))),
            (TRAJECTORY, self.trajectory),
        )

    def answer(self, channel: int, payload: bytes) -> bytes | None:
        """Return the answer to a question or an order; None for other packets."""
        if channel == INFO:
            return self._info(payload)
        head = read("BI", payload)
        if head is None or (channel == READ and len(payload) <= 5):  # noqa: PLR2004 -- no length
            return None
        number, start = head
        memory = self._memories[number][1] if number < len(self._memories) else bytearray()
        if channel == READ:
            count = payload[5]
            fits = count <= MAX_READ and start + count <= len(memory)
            data = bytes(memory[start : start + count]) if fits else b""
        elif channel == WRITE:
            data = payload[5:]
            fits = start + len(data) <= len(memory)
            if fits:
                memory[start : start + len(data)] = data
            data = b""
        else:
            return None
        return payload[:5] + bytes([0 if fits else errno.EIO]) + data

    def _info(self, payload: bytes) -> bytes | None:
        if payload[:1] == bytes([COUNT]):
            return bytes([COUNT, len(self._memories)])
        if payload[:1] == bytes([DETAILS]) and len(payload) > 1:
            number = payload[1]
            if number >= len(self._memories):
                return payload[:2]
            kind, memory = self._memories[number]
            return struct.pack("<BBBI8x", DETAILS, number, kind, len(memory))
        return None


def _configuration(address: int) -> bytes:
    """Return the block at the start of the EEPROM: channel 80, 2 Mbit/s, no trim, the address."""
    block = b"0xBC" + struct.pack(
        "<BBBffBI", 1, 80, 2, 0.0, 0.0, address >> 32, address & 0xFFFFFFFF
    )
    return block + bytes([sum(block) % 256])
