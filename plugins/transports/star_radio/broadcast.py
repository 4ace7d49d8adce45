"""Packets to all drones of a channel at once, over a Crazyradio of their own.

Nobody acknowledges a broadcast, so an order is repeated. cflib has no broadcast and keeps a dongle
to itself, so this needs another one. Not tried on hardware: the bytes are tested, and the order in
which the dongle is told things.
"""

from __future__ import annotations

import logging
import struct
import threading
import time
from collections import deque
from collections.abc import Sequence
from importlib import import_module
from typing import Any, Final

from star_core import PluginError
from star_radio.address import RadioAddress
from star_radio.orders import LOCALISATION, packed_quaternion
from star_radio.packets import packet

log = logging.getLogger(__name__)

EVERYBODY: Final = bytes.fromhex("FFE7E7E7E7")  # the address that every Crazyflie listens to
TIMES: Final = 15  # that an order is sent, as Crazyswarm2 repeats it
PAUSE: Final = 0.001  # s between two of them
POSES: Final = 2  # in one packet
_PACKED: Final = b"\x09"  # what such a packet begins with
_VENDOR, _PRODUCT = 0x1915, 0x7777  # of a Crazyradio
_CHANNEL, _ADDRESS, _RATE, _RETRIES, _ACKNOWLEDGE = 0x01, 0x02, 0x03, 0x06, 0x10  # USB requests
_RATES: Final = {"250K": 0, "1M": 1, "2M": 2}
_OUT: Final = 1  # endpoint
_TIMEOUT: Final = 1000  # ms


def pose(last: int, position: Sequence[float], attitude: Sequence[float]) -> bytes:
    """Return what tells one estimator its drone's pose; two of them go into a packet.

    Args:
        last: Last byte of the drone's address.
        position: m; sent in mm.
        attitude: Unit quaternion x, y, z, w.
    """
    x, y, z = (round(1000 * value) for value in position)
    return struct.pack("<BhhhI", last, x, y, z, packed_quaternion(attitude))


class Broadcaster:
    """Sends packets to every drone on some channels, in a thread of its own.

    Args:
        dongle: Number of the Crazyradio, which no link uses.
        on: An address on each channel and data rate to send on.

    Attributes:
        broken: Whether the dongle has failed: then nothing is sent any more.

    Raises:
        PluginError: There is no such dongle, or it cannot be used.
    """

    def __init__(self, dongle: int, on: Sequence[RadioAddress]) -> None:
        self._on = sorted({(radio.channel, radio.rate) for radio in on})
        self._device = _dongle(dongle)
        try:
            self._device.set_configuration(1)
            self._tell(_RETRIES, 0)
            self._tell(_ACKNOWLEDGE, 0)
        except OSError as error:
            raise PluginError(f"Crazyradio {dongle} cannot broadcast: {error}") from error
        self.broken = False
        self._orders: deque[bytes] = deque()
        self._poses: dict[int, bytes] = {}  # the newest of each drone, by the last byte
        self._changed = threading.Condition()
        self._tuned: tuple[int, str] | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="star-radio-all", daemon=True)
        self._thread.start()

    def order(self, packet: bytes) -> None:
        """Send a packet to everybody, several times, without waiting."""
        with self._changed:
            self._orders.append(packet)
            self._changed.notify()

    def show(self, last: int, pose: bytes) -> None:
        """Send a `pose` once, without waiting; it takes the place of one that still waits."""
        with self._changed:
            self._poses[last] = pose
            self._changed.notify()

    def close(self) -> None:
        """Send what waits, and release the dongle. Safe to call twice."""
        with self._changed:
            if self._ended:
                return
            self._ended = True
            self._changed.notify()
        self._thread.join(1.0)
        import_module("usb.util").dispose_resources(self._device)

    def _run(self) -> None:
        try:
            while (following := self._next()) is not None:
                self._send(*following)
        except Exception as error:  # noqa: BLE001 -- drivers raise what they like
            self.broken = True
            log.warning("radio: no broadcasts any more, links take over: %s", error)

    def _next(self) -> tuple[bytes, int] | None:
        """Wait for a packet, orders first, and how often it is to be sent; None at the end."""
        with self._changed:
            while not self._orders and not self._poses:
                if self._ended:
                    return None
                self._changed.wait()
            if self._orders:
                return self._orders.popleft(), TIMES
            drones = [self._poses.pop(last) for last in list(self._poses)[:POSES]]
        return packet(LOCALISATION, 1, _PACKED + b"".join(drones)), 1

    def _send(self, message: bytes, times: int) -> None:
        for channel, rate in self._on:
            if self._tuned != (channel, rate):
                self._tell(_RATE, _RATES[rate])
                self._tell(_CHANNEL, channel)
                self._tell(_ADDRESS, 0, EVERYBODY)
                self._tuned = channel, rate
            for _time in range(times):
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
