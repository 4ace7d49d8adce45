"""Frames of CPX, the protocol between the processors of a Crazyflie, as they go over TCP.

A frame is a u16 with the length of what follows, two bytes of routing and the data, little endian:
``RSV:1 LP:1 source:3 destination:3`` and ``version:2 function:6``, LP saying that no packet of the
same message follows (Bitcraze, crazyflie-firmware and cflib.cpx).
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, NamedTuple

MTU: Final = 1022  # bytes after the length, the most that the AI-deck's ESP32 carries
ROUTING: Final = 2  # bytes
ROOM: Final = MTU - ROUTING  # for data
VERSION: Final = 0
LAST: Final = 0x40

_HEAD: Final = struct.Struct("<HBB")
_LENGTH: Final = 2  # bytes of the length itself


class Target(IntEnum):
    """Source or destination of a packet."""

    STM32 = 1
    ESP32 = 2
    HOST = 3
    GAP8 = 4


class Function(IntEnum):
    """What a packet is about."""

    SYSTEM = 1
    CONSOLE = 2
    CRTP = 3
    WIFI_CTRL = 4
    APP = 5
    TEST = 14
    BOOTLOADER = 15


class Packet(NamedTuple):
    """One packet and its routing.

    Attributes:
        source: Sender.
        destination: Receiver.
        function: Type of content.
        data: At most `ROOM` bytes.
        last: Whether it is the last one of its message.
    """

    source: Target
    destination: Target
    function: Function
    data: bytes
    last: bool = True


class SyncError(Exception):
    """The stream has an invalid frame length, so synchronisation is lost."""


def encode(packet: Packet) -> bytes:
    """Return the frame of a packet.

    Raises:
        ValueError: It has more data than `ROOM`.

    Example:
        >>> encode(Packet(Target.HOST, Target.STM32, Function.SYSTEM, bytes([0x21, 1]))).hex(" ")
        '04 00 59 01 21 01'
    """
    if len(packet.data) > ROOM:
        raise ValueError(f"packet has {len(packet.data)} bytes of data, expected at most {ROOM}")
    routing = packet.source << 3 | packet.destination | (LAST if packet.last else 0)
    return _HEAD.pack(ROUTING + len(packet.data), routing, packet.function) + packet.data


class Decoder:
    """Takes a stream apart as it comes, in pieces of any size.

    Frames with a version, a function or a target that there is not are passed over.
    """

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that `data` completes.

        Raises:
            SyncError: A frame has an invalid length. Packets before it are lost too; the next
                `feed` starts a new stream.
        """
        stream, at, packets = self._rest + data, 0, []
        self._rest = b""
        while len(stream) - at >= _LENGTH:
            (length,) = struct.unpack_from("<H", stream, at)
            if not ROUTING <= length <= MTU:
                wrong = f"frame of {length} bytes, expected {ROUTING} to {MTU}"
                raise SyncError(wrong)
            end = at + _LENGTH + length
            if len(stream) < end:
                break
            packet = _packet(stream[at + _LENGTH : end])
            if packet is not None:
                packets.append(packet)
            at = end
        self._rest = stream[at:]
        return packets


def _packet(frame: bytes) -> Packet | None:
    """Return what a frame without its length holds; None if that means nothing."""
    routing, function = frame[:ROUTING]
    try:
        return Packet(
            Target(routing >> 3 & 7),
            Target(routing & 7),
            Function(function),  # with the version in its upper bits: 0
            frame[ROUTING:],
            bool(routing & LAST),
        )
    except ValueError:
        return None
