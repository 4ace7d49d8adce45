"""Where several drones are, in one packet: each is named by the last byte of its address."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from star_radio.orders import LOCALISATION, packed_quaternion
from star_radio.packets import packet


class Kind(NamedTuple):
    """What such a packet tells of each drone.

    Attributes:
        channel: Of the port LOCALISATION.
        head: What the packet begins with.
        most: Drones in a packet.
    """

    channel: int
    head: bytes
    most: int

    def packet(self, parts: Iterable[bytes]) -> bytes:
        """Return the packet of up to `most` parts, all of this kind."""
        return packet(LOCALISATION, self.channel, self.head + b"".join(parts))


PLACES: Final = Kind(2, b"", 4)
POSES: Final = Kind(1, b"\x09", 2)


def place(last: int, position: Sequence[float]) -> bytes:
    """Return the part that tells one estimator its drone's position, m; sent in mm."""
    x, y, z = (round(1000 * value) for value in position)
    return struct.pack("<Bhhh", last, x, y, z)


def pose(last: int, position: Sequence[float], attitude: Sequence[float]) -> bytes:
    """Return the part that tells one estimator its drone's pose.

    Args:
        last: Last byte of the drone's address.
        position: m; sent in mm.
        attitude: Unit quaternion x, y, z, w.
    """
    return place(last, position) + struct.pack("<I", packed_quaternion(attitude))
