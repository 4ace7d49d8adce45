"""Profiles of take-offs that come down by themselves: climb, hover, descent.

The firmware's own take-off hovers until the battery is empty, whatever becomes of the link. A
profile is flown as a trajectory in the compressed format of ``pptraj_compressed.c``: 36 bytes, two
packets. So it can be written when the take-off is commanded.
"""

from __future__ import annotations

import math
import struct
from typing import Final

from star_core import PluginError
from star_radio import orders
from star_radio.connection import packets
from star_radio.connection.questions import Ask, Question
from star_radio.trajectories import (
    DESCENT_MARGIN,
    DESCENT_SPEED,
    HOVER_TIME,
    SIZE,
    memory_number,
)

NUMBER: Final = 9  # of the trajectory: the last one that the firmware can define
AT: Final = SIZE - 40  # byte of the memory, at its end
TOPIC: Final = "take-off"  # of the questions that write a profile
_ALONG_Z, _LINEAR, _SEVENTH = 4, 1, 3  # bits of the height in a piece's type; types of an axis
_MAX_HEIGHT: Final = 32767  # mm, of a coordinate
_MAX_TIME: Final = 65535  # ms, of a piece


def profile(rise: float, yaw: float, duration: float) -> bytes | None:
    """Return the trajectory of a take-off, from z = 0; None if the format cannot hold it.

    The climb is the firmware's: 35 u⁴ - 84 u⁵ + 70 u⁶ - 20 u⁷ of the rise after a share u of its
    time. Its Bézier curve has four control points at the start and four at the end. A descent at
    `DESCENT_SPEED` follows `HOVER_TIME` later.

    Args:
        rise: m.
        yaw: Heading, rad in the odometry frame.
        duration: Of the climb, s.

    >>> len(profile(0.5, 0.0, 2.0))
    36
    """
    if not all(map(math.isfinite, (rise, yaw, duration))):
        return None
    top, depth = round(1000 * rise), round(1000 * DESCENT_MARGIN)
    times = [1000 * duration, 1000 * HOVER_TIME, (top + depth) / DESCENT_SPEED]
    climb, hover, descent = map(round, times)
    if not (0 < top <= _MAX_HEIGHT and 0 < climb <= _MAX_TIME and descent <= _MAX_TIME):
        return None
    degrees = round(10 * math.degrees(math.remainder(yaw, math.tau)))
    return b"".join(
        [
            struct.pack("<4h", 0, 0, 0, degrees),
            struct.pack("<BH7h", _SEVENTH << _ALONG_Z, climb, 0, 0, 0, top, top, top, top),
            struct.pack("<BH", 0, hover),
            struct.pack("<BHh", _LINEAR << _ALONG_Z, descent, -depth),
            struct.pack("<BH", 0, 0),
        ]
    )


def reserve(ask: Ask) -> int | None:
    """Define the trajectory that profiles are written to.

    Returns:
        Number of the drone's memory; None if it has none for trajectories, or refuses.
    """
    try:
        memory = memory_number(ask)
    except PluginError:
        return None
    packet = orders.define_trajectory(NUMBER, 1, AT, compressed=True)
    (answer,) = ask([Question.of(packet, packet[1:4], "the trajectory of take-offs")])
    return memory if answer[3:4] == b"\0" else None


def writes(profile: bytes, memory: int) -> list[Question]:
    """Return the questions that write a profile to the memory of a number."""
    return [
        Question.of(packet, packet[1:6], "its take-off", topic=f"{TOPIC} {i}")
        for i, packet in enumerate(packets.write_memory(memory, AT, profile))
    ]


def start(version: int) -> bytes:
    """Return the command to fly a profile from the drone's position."""
    return orders.start_trajectory(NUMBER, version, relative=True)
