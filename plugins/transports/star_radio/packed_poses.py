"""Packets with the poses of several drones, each identified by the last byte of its address."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from star_radio.orders import LOCALISATION, packed_quaternion
from star_radio.packets import packet


class Kind(NamedTuple):
    """Type of such a packet.

    Attributes:
        channel: Channel of the port LOCALISATION.
        head: First bytes of the payload.
        most: Maximum number of drones in a packet.
    """

    channel: int
    head: bytes
    most: int

    def packet(self, entries: Iterable[bytes]) -> bytes:
        """Return the packet of up to `most` entries, all of this kind."""
        return packet(LOCALISATION, self.channel, self.head + b"".join(entries))


POSITIONS: Final = Kind(2, b"", 4)
POSES: Final = Kind(1, b"\x09", 2)


def position(last: int, position: Sequence[float]) -> bytes:
    """Return the entry with one drone's position, m; sent in mm."""
    x, y, z = (round(1000 * value) for value in position)
    return struct.pack("<Bhhh", last, x, y, z)


def pose(last: int, position: Sequence[float], attitude: Sequence[float]) -> bytes:
    """Return the entry with one drone's pose.

    Args:
        last: Last byte of the drone's address.
        position: m; sent in mm.
        attitude: Unit quaternion x, y, z, w.
    """
    x, y, z = (round(1000 * value) for value in position)
    return struct.pack("<BhhhI", last, x, y, z, packed_quaternion(attitude))
