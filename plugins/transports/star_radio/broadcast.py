"""Packets to all drones of a channel at once, over a Crazyradio of their own.

Nobody acknowledges a broadcast, so an order is repeated. cflib has no broadcast and keeps a dongle
to itself, so this needs another one. Not tried on hardware: the bytes are tested, and the order in
which the dongle is told things.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

from star_core import PluginError
from star_radio.address import RadioAddress
from star_radio.packed import PLACES, POSES, Kind

log = logging.getLogger(__name__)

EVERYBODY: Final = bytes.fromhex("FFE7E7E7E7")  # the address that every Crazyflie listens to
TIMES: Final = 15  # that an order is sent, as Crazyswarm2 repeats it
PAUSE: Final = 0.001  # s between two of them
SOON: Final = 0.1  # s that an order may wait; links give it again after 0.2 s
_VENDOR, _PRODUCT = 0x1915, 0x7777  # of a Crazyradio
_CHANNEL, _ADDRESS, _RATE, _RETRIES, _ACKNOWLEDGE = 0x01, 0x02, 0x03, 0x06, 0x10  # USB requests
_RATES: Final = {"250K": 0, "1M": 1, "2M": 2}
_OUT: Final = 1  # endpoint
_TIMEOUT: Final = 1000  # ms


@dataclass(eq=False, slots=True)
class _Call:
    """A packet that is to be sent, to whom, and how often on each channel."""

    packet: bytes
    rows: AbstractSet[int] = frozenset()
    times: int = 1
    void: bool = False


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
        self._orders: deque[_Call] = deque()  # the first of them may be on the air
        # the newest of each drone, by the last byte of its address
        self._shown: dict[Kind, dict[int, bytes]] = {PLACES: {}, POSES: {}}
        self._changed = threading.Condition()
        self._tuned: tuple[int, str] | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="star-radio-all", daemon=True)
        self._thread.start()

    def order(self, packet: bytes, rows: AbstractSet[int] = frozenset()) -> bool:
        """Send a packet to everybody, several times, without waiting.

        Args:
            packet: What to send.
            rows: Of those whom it is for, for `void`.

        Returns:
            Whether it is sent; not if the dongle has failed, or if many orders wait for it.
        """
        with self._changed:
            takes = TIMES * PAUSE * len(self._on)  # s, at least
            waiting = sum(not call.void for call in self._orders)
            if self.broken or takes * waiting > SOON:
                return False
            self._orders.append(_Call(packet, rows, TIMES))
            self._changed.notify_all()
        return True

    def void(self, rows: AbstractSet[int]) -> None:
        """Send no more of the orders to any of these; a packet that is being sent still goes."""
        with self._changed:
            for call in self._orders:
                call.void |= not rows.isdisjoint(call.rows)

    def wait(self) -> None:
        """Wait until every order is sent, or the dongle has failed."""
        with self._changed:
            self._changed.wait_for(lambda: self.broken or not self._orders)

    def show(self, kind: Kind, last: int, part: bytes) -> None:
        """Tell a drone where it is, once, without waiting; in place of what still waits.

        Args:
            kind: What it is told.
            last: Last byte of its address.
            part: What `star_radio.packed` made of it.
        """
        with self._changed:
            self._shown[kind][last] = part
            self._changed.notify_all()

    def close(self) -> None:
        """Send what waits, and release the dongle. Safe to call twice."""
        with self._changed:
            if self._ended:
                return
            self._ended = True
            self._changed.notify_all()
        self._thread.join(1.0)
        import_module("usb.util").dispose_resources(self._device)

    def _run(self) -> None:
        try:
            while (call := self._next()) is not None:
                self._send(call)
                self._end(call)
        except Exception as error:  # noqa: BLE001 -- drivers raise what they like
            with self._changed:
                self.broken = True
                self._changed.notify_all()
            log.warning("radio: no broadcasts any more, links take over: %s", error)

    def _next(self) -> _Call | None:
        """Wait for something to send, orders first; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._orders or self._waiting() or self._ended)
            if self._orders:
                return self._orders[0]
            if (kind := self._waiting()) is None:
                return None
            parts = self._shown[kind]
            return _Call(kind.packet([parts.pop(last) for last in list(parts)[: kind.most]]))

    def _waiting(self) -> Kind | None:
        """Return what drones are to be told of where they are, if any."""
        return next((kind for kind, parts in self._shown.items() if parts), None)

    def _end(self, call: _Call) -> None:
        with self._changed:
            if self._orders and self._orders[0] is call:
                self._orders.popleft()
                self._changed.notify_all()

    def _send(self, call: _Call) -> None:
        for channel, rate in self._on:
            if self._tuned != (channel, rate):
                self._tell(_RATE, _RATES[rate])
                self._tell(_CHANNEL, channel)
                self._tell(_ADDRESS, 0, EVERYBODY)
                self._tuned = channel, rate
            for _time in range(call.times):
                if call.void:
                    return
                self._device.write(_OUT, call.packet, _TIMEOUT)
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
