"""Broadcasts: commands and corrections that one packet sends to many drones, and their dongle.

A command to the high-level commander (take off, land, stop, go to, start a trajectory) addresses
either all drones that receive it or groups: a mask of eight bits, matched against each drone's own
mask. One bit stands for all drones of the mission, so that other drones ignore the command. Thus a
command that is the same for all drones, or for all of one of the mission's groups, takes a single
packet. Setpoints have no group mask in the firmware's protocol: velocities go to each drone over
its own link.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np

from star_core import Corrections, PluginError, Scene
from star_radio import orders
from star_radio.address import RadioAddress
from star_radio.connection.packets import MAX_COORDINATE
from star_radio.orders import POSES, POSITIONS, PackedPoses, pose_entry

MAX_GROUPS: Final = 8  # bits of the firmware's mask; the first is for all drones of the mission


class BroadcastCommands:
    """Broadcasts on the channels of a swarm's radios.

    Args:
        scene: The agents and their groups. Of the groups, the first seven are used that contain
            at least two radio links, not all of them, and differ from each other.
        dongle: Number of the Crazyradio for broadcasts.

    Attributes:
        masks: Group mask of each drone with a radio link, by its row.
    """

    def __init__(self, scene: Scene, dongle: int) -> None:
        addresses = (
            (row, RadioAddress.of(agent.uri or "")) for row, agent in enumerate(scene.agents)
        )
        on = {row: address for row, address in addresses if address is not None}
        self._last = {row: int(address.address[-2:], 16) for row, address in on.items()}
        if len(set(self._last.values())) < len(self._last):
            raise PluginError(
                f"{scene.named(on)} share the last byte of an address, which identifies drones in "
                "broadcasts; make it unique",
                "duplicate-address",
            )
        self._groups = _groups(scene.groups.values(), frozenset(on))
        self.masks: Mapping[int, int] = {
            row: sum(bit for bit, group in self._groups.items() if row in group) for row in on
        }
        self._radio = Broadcaster(dongle, list(on.values()))

    def clear_groups(self) -> None:
        """Broadcast that all drones leave their groups, and wait until that is sent.

        A drone that receives broadcasts but cannot be connected to may still be in a group of an
        earlier flight, and would execute commands of this one.
        """
        if self._radio.order(orders.set_groups(0)):
            self._radio.wait()

    def order(self, packets: Mapping[int, bytes]) -> dict[int, bytes]:
        """Broadcast a command to the groups whose members all receive the same packet.

        A group is addressed only if the packet is for each of its radio links, absent drones
        included. Nothing is broadcast once the dongle has failed.

        Args:
            packets: Packets addressed to all groups, by the row of the drone.

        Returns:
            The broadcast packets, by the rows of the drones; they differ by their group masks.
        """
        alike: dict[bytes, set[int]] = {}
        for row in sorted(self._last.keys() & packets.keys()):
            alike.setdefault(packets[row], set()).add(row)
        sent: dict[int, bytes] = {}
        for packet, rows in alike.items():
            bits = [bit for bit, group in self._groups.items() if group <= rows]
            if not bits:
                continue
            # one mask for all groups: a drone in two of them receives the packet once
            reached = frozenset[int]().union(*(self._groups[bit] for bit in bits))
            addressed = orders.only_for(sum(bits), packet)
            if self._radio.order(addressed, reached):
                sent |= dict.fromkeys(reached, addressed)
        return sent

    def void(self, rows: Iterable[int]) -> None:
        """Stop broadcasting commands to these drones: a newer one replaces them."""
        self._radio.void(frozenset(rows))

    def correct(self, corrections: Corrections) -> Sequence[int]:
        """Broadcast corrections to drones with radio links; return their rows.

        A packet holds two poses or four positions. Positions beyond ±`MAX_COORDINATE` do not fit
        its millimetres and are sent over the link.
        """
        if self._radio.broken:
            return ()
        near = (abs(corrections.position) <= MAX_COORDINATE).all(axis=1)
        sent = []
        for i in np.flatnonzero(near).tolist():
            row = int(corrections.agent[i])
            if (last := self._last.get(row)) is None:
                continue
            at = corrections.position[i].tolist()
            if np.isfinite(corrections.attitude_deviation[i]):
                entry = pose_entry(last, at, corrections.attitude[i].tolist())
                self._radio.show(POSES, last, entry)
            else:
                self._radio.show(POSITIONS, last, pose_entry(last, at))
            sent.append(row)
        return sent

    def close(self) -> None:
        """Release the dongle."""
        self._radio.close()


def _groups(
    groups: Iterable[Sequence[int]], radios: frozenset[int]
) -> Mapping[int, frozenset[int]]:
    """Return the rows of each bit: all radio links, and the groups that benefit from a bit."""
    distinct = dict.fromkeys(radios.intersection(rows) for rows in groups)
    useful = [rows for rows in distinct if 1 < len(rows) < len(radios)]
    return {1 << i: rows for i, rows in enumerate([radios, *useful][:MAX_GROUPS])}


log = logging.getLogger(__name__)

BROADCAST_ADDRESS: Final = bytes.fromhex("FFE7E7E7E7")  # received by every Crazyflie
REPEATS: Final = 15  # transmissions of a command, as in Crazyswarm2
REPEAT_PERIOD: Final = 0.001  # s
MAX_QUEUE_TIME: Final = 0.1  # s that a command may wait; links repeat it after 0.2 s
_VENDOR, _PRODUCT = 0x1915, 0x7777  # of a Crazyradio
_CHANNEL, _ADDRESS, _RATE, _RETRIES, _ACKNOWLEDGE = 0x01, 0x02, 0x03, 0x06, 0x10  # USB requests
_RATES: Final = {"250K": 0, "1M": 1, "2M": 2}
_OUT: Final = 1  # endpoint
_TIMEOUT: Final = 1000  # ms


@dataclass(eq=False, slots=True)
class _Call:
    """A packet to send, the rows it is for, and the number of transmissions per channel."""

    packet: bytes
    rows: AbstractSet[int] = frozenset()
    times: int = 1
    void: bool = False


class Broadcaster:
    """Sends packets to every drone on some channels, in its own thread.

    Args:
        dongle: Number of the Crazyradio; no link may use it.
        on: An address on each channel and data rate to send on.

    Attributes:
        broken: Whether the dongle has failed; then nothing more is sent.
    """

    def __init__(self, dongle: int, on: Sequence[RadioAddress]) -> None:
        self._on = sorted({(radio.channel, radio.rate) for radio in on})
        self._device = _dongle(dongle)
        try:
            self._device.set_configuration(1)
            self._tell(_RETRIES, 0)
            self._tell(_ACKNOWLEDGE, 0)
        except OSError as error:
            text = f"Crazyradio {dongle} cannot broadcast: {error}"
            raise PluginError(text, "link-failed") from error
        self.broken = False
        self._orders: deque[_Call] = deque()  # the first one may be in transmission
        # newest entry of each drone, by the last byte of its address
        self._shown: dict[PackedPoses, dict[int, bytes]] = {POSITIONS: {}, POSES: {}}
        self._changed = threading.Condition()
        self._tuned: tuple[int, str] | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="star-radio-all", daemon=True)
        self._thread.start()

    def order(self, packet: bytes, rows: AbstractSet[int] = frozenset()) -> bool:
        """Queue a packet for repeated transmission to all drones, without blocking.

        Returns whether it was queued; not if the dongle has failed or the queue is too long. For
        `void`, `rows` are the drones it is for.
        """
        with self._changed:
            duration = REPEATS * REPEAT_PERIOD * len(self._on)  # s, at least
            waiting = sum(not call.void for call in self._orders)
            if self.broken or duration * waiting > MAX_QUEUE_TIME:
                return False
            self._orders.append(_Call(packet, rows, REPEATS))
            self._changed.notify_all()
        return True

    def void(self, rows: AbstractSet[int]) -> None:
        """Cancel queued commands to any of these rows; a packet in transmission still goes out."""
        with self._changed:
            for call in self._orders:
                call.void |= not rows.isdisjoint(call.rows)

    def wait(self) -> None:
        """Wait until all commands are sent, or the dongle has failed."""
        with self._changed:
            self._changed.wait_for(lambda: self.broken or not self._orders)

    def show(self, kind: PackedPoses, last: int, entry: bytes) -> None:
        """Queue a pose correction, made by `orders.pose_entry`, for one transmission.

        It replaces one that is still queued. The drone is that whose address ends with `last`.
        """
        with self._changed:
            self._shown[kind][last] = entry
            self._changed.notify_all()

    def close(self) -> None:
        """Send what is queued, and release the dongle. Safe to call twice."""
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
        except Exception as error:  # noqa: BLE001 -- drivers raise any type
            with self._changed:
                self.broken = True
                self._changed.notify_all()
            log.warning("radio: broadcasting failed, using the links instead: %s", error)

    def _next(self) -> _Call | None:
        """Wait for the next packet to send, commands first; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._orders or self._waiting() or self._ended)
            if self._orders:
                return self._orders[0]
            if (kind := self._waiting()) is None:
                return None
            entries = self._shown[kind]
            return _Call(kind.packet([entries.pop(last) for last in list(entries)[: kind.most]]))

    def _waiting(self) -> PackedPoses | None:
        """Return a type of correction that is queued, if any."""
        return next((kind for kind, entries in self._shown.items() if entries), None)

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
                self._tell(_ADDRESS, 0, BROADCAST_ADDRESS)
                self._tuned = channel, rate
            for _time in range(call.times):
                if call.void:
                    return
                self._device.write(_OUT, call.packet, _TIMEOUT)
                time.sleep(REPEAT_PERIOD)

    def _tell(self, request: int, value: int, data: bytes = b"") -> None:
        """Configure the dongle by a vendor-specific USB request."""
        self._device.ctrl_transfer(0x40, request, value, 0, data, _TIMEOUT)


def _dongle(number: int) -> Any:
    """Return a Crazyradio's USB device."""
    usb = import_module("usb.core")
    backend = import_module("libusb_package").get_libusb1_backend()
    devices = list(usb.find(idVendor=_VENDOR, idProduct=_PRODUCT, find_all=True, backend=backend))
    if number >= len(devices):
        raise PluginError(
            f"no Crazyradio number {number} for broadcasts; found {len(devices)}: it needs one in "
            "addition to those of the links",
            "link-failed",
        )
    return devices[number]
