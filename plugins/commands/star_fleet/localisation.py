"""Positions and poses that are sent to the estimators on board."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from star_fleet.packet import expand, read, sound

POSITION, GENERIC, PACKED = 0, 1, 2  # channels
POSE, PACKED_POSES = 8, 9  # commands of the channel GENERIC
UNIT: Final = (0.9, 1.1)  # length of what is taken for a unit quaternion


@dataclass(frozen=True, slots=True)
class Fix:
    """Where a vehicle is.

    Attributes:
        name: Last byte of the address of the vehicle it is for; None for any receiver.
        position: Odometry frame, m.
        attitude: x, y, z, w from the body to that frame, if known.
    """

    name: int | None
    position: tuple[float, float, float]
    attitude: tuple[float, float, float, float] | None = None


def fixes(channel: int, payload: bytes) -> Iterator[Fix]:
    """Yield the positions and poses in a packet, those of other vehicles among them."""
    if channel == POSITION:
        if (position := read("fff", payload)) is not None and sound(position):
            yield Fix(None, (position[0], position[1], position[2]))
    elif channel == PACKED:
        for name, x, y, z in _each("Bhhh", payload):
            yield Fix(name, (x / 1000, y / 1000, z / 1000))
    elif payload[:1] == bytes([POSE]):
        if (pose := read("7f", payload, 1)) is not None and sound(pose):
            x, y, z, *attitude = pose
            length = math.hypot(*attitude)
            if UNIT[0] < length < UNIT[1]:
                qx, qy, qz, qw = (part / length for part in attitude)
                yield Fix(None, (x, y, z), (qx, qy, qz, qw))
    elif payload[:1] == bytes([PACKED_POSES]):
        for name, x, y, z, packed in _each("BhhhI", payload[1:]):
            yield Fix(name, (x / 1000, y / 1000, z / 1000), expand(packed))


def _each(form: str, payload: bytes) -> Iterator[tuple[int, ...]]:
    layout = struct.Struct("<" + form)
    whole = len(payload) // layout.size * layout.size
    yield from layout.iter_unpack(payload[:whole])
