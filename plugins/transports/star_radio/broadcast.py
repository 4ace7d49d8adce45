"""Packets to all drones of a channel at once, over a Crazyradio of their own.

Nobody acknowledges a broadcast, so it is repeated. cflib has no broadcast and keeps a dongle to
itself, so this needs another one. Not tried on hardware: the bytes are tested, and the order in
which the dongle is told things.
"""

from __future__ import annotations

import struct
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any, Final

from star_core import PluginError
from star_radio.address import RadioAddress
from star_radio.orders import LOCALISATION, packed_quaternion
from star_radio.packets import packet

EVERYBODY: Final = bytes.fromhex("FFE7E7E7E7")  # the address that every Crazyflie listens to
TIMES: Final = 15  # as Crazyswarm2 repeats them
PAUSE: Final = 0.001  # s between two of them
POSITIONS, POSES = 4, 2  # in one packet
_VENDOR, _PRODUCT = 0x1915, 0x7777  # of a Crazyradio
_CHANNEL, _ADDRESS, _RATE, _RETRIES, _ACKNOWLEDGE = 0x01, 0x02, 0x03, 0x06, 0x10  # USB requests
_RATES: Final = {"250K": 0, "1M": 1, "2M": 2}
_OUT: Final = 1  # endpoint
_TIMEOUT: Final = 1000  # ms


def position_packets(last: Sequence[int], position: Sequence[Sequence[float]]) -> Iterator[bytes]:
    """Yield packets that tell estimators where their drones are, four drones in each.

    Args:
        last: Last byte of each drone's address.
        position: Of each, m; sent in mm.
    """
    drones = [
        struct.pack("<Bhhh", *_numbered(number, where))
        for number, where in zip(last, position, strict=True)
    ]
    for at in range(0, len(drones), POSITIONS):
        yield packet(LOCALISATION, 2, b"".join(drones[at : at + POSITIONS]))


def pose_packets(
    last: Sequence[int], position: Sequence[Sequence[float]], attitude: Sequence[Sequence[float]]
) -> Iterator[bytes]:
    """Yield packets that tell estimators their drones' poses, two drones in each.

    Args:
        last: Last byte of each drone's address.
        position: Of each, m; sent in mm.
        attitude: Unit quaternion x, y, z, w of each.
    """
    drones = [
        struct.pack("<BhhhI", *_numbered(number, where), packed_quaternion(turn))
        for number, where, turn in zip(last, position, attitude, strict=True)
    ]
    for at in range(0, len(drones), POSES):
        yield packet(LOCALISATION, 1, b"\x09" + b"".join(drones[at : at + POSES]))


class Broadcaster:
    """Sends packets to every drone on some channels, in a thread of its own.

    Args:
        dongle: Number of the Crazyradio, which no link uses.
        on: An address on each channel and data rate to send on.

    Raises:
        PluginError: There is no such dongle.
    """

    def __init__(self, dongle: int, on: Sequence[RadioAddress]) -> None:
        self._on = sorted({(radio.channel, radio.rate) for radio in on})
        self._device = _dongle(dongle)
        self._device.set_configuration(1)
        self._tell(_RETRIES, 0)
        self._tell(_ACKNOWLEDGE, 0)
        self._waiting: deque[bytes] = deque()
        self._posted = threading.Semaphore(0)
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="star-radio-all", daemon=True)
        self._thread.start()

    def post(self, packet: bytes) -> None:
        """Send a packet to everybody, without waiting."""
        self._waiting.append(packet)
        self._posted.release()

    def close(self) -> None:
        """Send what waits, and release the dongle. Safe to call twice."""
        if self._ended:
            return
        self._ended = True
        self._posted.release()
        self._thread.join(1.0)
        import_module("usb.util").dispose_resources(self._device)

    def _run(self) -> None:
        while True:
            self._posted.acquire()
            if not self._waiting:
                if self._ended:
                    return
                continue
            message = self._waiting.popleft()
            for channel, rate in self._on:
                self._tell(_RATE, _RATES[rate])
                self._tell(_CHANNEL, channel)
                self._tell(_ADDRESS, 0, EVERYBODY)
                for _time in range(TIMES):
                    self._device.write(_OUT, message, _TIMEOUT)
                    time.sleep(PAUSE)

    def _tell(self, request: int, value: int, data: bytes = b"") -> None:
        """Set the dongle up: a USB request of the vendor's own kind."""
        self._device.ctrl_transfer(0x40, request, value, 0, data, _TIMEOUT)


def _dongle(number: int) -> Any:
    """Return a Crazyradio's USB device.

    Raises:
        PluginError: There is none of this number.
    """
    usb = import_module("usb.core")
    backend = import_module("libusb_package").get_libusb1_backend()
    found = list(usb.find(idVendor=_VENDOR, idProduct=_PRODUCT, find_all=True, backend=backend))
    if number >= len(found):
        raise PluginError(
            f"no Crazyradio of number {number} to broadcast with; found {len(found)}: it needs one "
            "beside those of the links"
        )
    return found[number]


def _numbered(number: int, position: Sequence[float]) -> tuple[int, int, int, int]:
    x, y, z = (round(1000 * value) for value in position)
    return number, x, y, z
