"""Broadcasts: their bytes, what the dongle is told, and which orders are broadcast at all."""

from __future__ import annotations

import struct
import sys
import time
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from star_core import Corrections, PluginError
from star_radio import orders
from star_radio.address import RadioAddress
from star_radio.broadcast import TIMES, Broadcaster, pose_packets, position_packets
from star_radio.shouts import Shouts
from tests.plugins.transports.star_radio.conftest import reached


class Dongle:
    """A Crazyradio that writes down what it is told."""

    def __init__(self) -> None:
        self.told: list[tuple[int, int, bytes]] = []
        self.sent: list[bytes] = []

    def set_configuration(self, _number: int) -> None:
        """There is one."""

    def ctrl_transfer(
        self, kind: int, request: int, value: int, _index: int, data: bytes, _timeout: int
    ) -> None:
        assert kind == 0x40
        self.told.append((request, value, bytes(data)))

    def write(self, endpoint: int, data: bytes, _timeout: int) -> None:
        assert endpoint == 1
        self.sent.append(bytes(data))


@pytest.fixture
def dongles(monkeypatch: pytest.MonkeyPatch) -> list[Dongle]:
    found = [Dongle(), Dongle()]
    core, util, package = ModuleType("usb.core"), ModuleType("usb.util"), ModuleType("libusb")
    vars(core)["find"] = lambda **_what: found
    vars(util)["dispose_resources"] = lambda _device: None
    vars(package)["get_libusb1_backend"] = lambda: None
    for name, module in (("usb.core", core), ("usb.util", util), ("libusb_package", package)):
        monkeypatch.setitem(sys.modules, name, module)
    return found


def test_four_positions_go_into_one_packet() -> None:
    position = [[i * 0.5, -1.0, 0.25] for i in range(5)]
    first, second = position_packets([1, 2, 3, 4, 5], position)
    assert first[0] & 0xF3 == 6 << 4 | 2
    drones = list(struct.iter_unpack("<Bhhh", first[1:]))
    assert drones == [(i + 1, 500 * i, -1000, 250) for i in range(4)]
    assert second[1:] == struct.pack("<Bhhh", 5, 2000, -1000, 250)


def test_two_poses_go_into_one_packet() -> None:
    turn = [0.0, 0.0, 0.0, 1.0]
    first, second = pose_packets([1, 2, 3], [[1.0, 2.0, 3.0]] * 3, [turn] * 3)
    assert first[0] & 0xF3 == 6 << 4 | 1
    one = struct.pack("<BhhhI", 1, 1000, 2000, 3000, 0xC0000000)
    assert first[1:] == b"\x09" + one + b"\2" + one[1:]
    assert second[1:] == b"\x09\3" + one[1:]


def settled(dongle: Dongle, n: int) -> bool:
    end = time.monotonic() + 3
    while len(dongle.sent) < n and time.monotonic() < end:
        time.sleep(0.002)
    return len(dongle.sent) == n


def test_a_packet_is_repeated_on_every_channel(dongles: list[Dongle]) -> None:
    uris = [f"radio://0/{channel}/{rate}" for channel, rate in ((80, "2M"), (90, "250K"))]
    on = [address for uri in uris if (address := RadioAddress.of(uri))]
    radio = Broadcaster(1, on)
    radio.post(orders.stop())
    assert settled(dongles[1], 2 * TIMES)
    radio.close()
    radio.close()
    everybody = bytes.fromhex("ffe7e7e7e7")
    assert dongles[1].told == [
        (0x06, 0, b""), (0x10, 0, b""),  # no retries, no acknowledgements
        (0x03, 2, b""), (0x01, 80, b""), (0x02, 0, everybody),
        (0x03, 0, b""), (0x01, 90, b""), (0x02, 0, everybody),
    ]  # fmt: skip
    assert set(dongles[1].sent) == {orders.stop()}
    assert dongles[0].sent == []


@pytest.mark.usefixtures("dongles")
def test_a_dongle_that_lacks_is_named() -> None:
    with pytest.raises(PluginError, match="no Crazyradio of number 2 to broadcast with; found 2"):
        Broadcaster(2, [])


AIR = ["radio://0/80/2M/E7E7E7E701", "udp://127.0.0.1:1", "radio://0/80/2M/E7E7E7E702"]


@pytest.mark.parametrize(
    ("packets", "rows"),
    [
        ({0: b"a", 1: b"b", 2: b"a"}, (0, 2)),
        ({0: b"a", 2: b"a"}, (0, 2)),
        ({0: b"a", 2: b"b"}, ()),
        ({0: b"a"}, ()),
        ({1: b"a"}, ()),
    ],
)
def test_an_order_is_broadcast_if_it_is_the_same_for_every_radio(
    dongles: list[Dongle], packets: dict[int, bytes], rows: tuple[int, ...]
) -> None:
    shouts = Shouts(reached(AIR), 1)
    assert tuple(shouts.order(packets)) == rows
    assert settled(dongles[1], TIMES if rows else 0)
    shouts.close()


def test_corrections_of_radios_are_broadcast(dongles: list[Dongle]) -> None:
    shouts = Shouts(reached(AIR), 1)
    n = np.arange(3)
    turn: Any = np.tile([0.0, 0, 0, 1], (3, 1))
    rows = shouts.correct(Corrections(n, np.ones((3, 3)), turn, np.ones(3), np.ones(3)))
    assert tuple(rows) == (0, 2)
    assert settled(dongles[1], TIMES)
    assert dongles[1].sent[0][2::11][:2] == b"\1\2"
    shouts.close()


@pytest.mark.usefixtures("dongles")
def test_addresses_with_the_same_last_byte_are_refused() -> None:
    uris = ["radio://0/80/2M/E7E7E7E701", "radio://0/80/2M/E7E7E7E801"]
    with pytest.raises(PluginError, match="cf1, cf2 share last bytes of addresses"):
        Shouts(reached(uris), 0)
