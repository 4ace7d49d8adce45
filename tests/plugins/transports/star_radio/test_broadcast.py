"""Broadcasts: their bytes, what the dongle receives, and which orders are broadcast at all."""

from __future__ import annotations

import math
import struct
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from types import ModuleType
from typing import TypeAlias

import numpy as np
import pytest

import star_radio
from star_core import Corrections, Order, PluginError, Setpoint
from star_radio import orders
from star_radio.address import RadioAddress
from star_radio.broadcast import REPEATS, BroadcastCommands, Broadcaster
from star_radio.connection.tables import Entry
from star_radio.orders import POSES, pose_entry
from star_radio.transport import Radio
from tests.plugins.transports.star_radio.conftest import command, options, reached
from tests.waiting import eventually

Log: TypeAlias = list[tuple[str, str]]


class Dongle:
    """A Crazyradio that keeps what it receives."""

    def __init__(self) -> None:
        self.told: list[tuple[int, int, bytes]] = []
        self.sent: list[bytes] = []
        self.go = threading.Event()
        self.go.set()
        self.error: OSError | None = None

    def set_configuration(self, _number: int) -> None:
        """There is one."""

    def ctrl_transfer(
        self, kind: int, request: int, value: int, _index: int, data: bytes, _timeout: int
    ) -> None:
        assert kind == 0x40
        self.told.append((request, value, bytes(data)))

    def write(self, endpoint: int, data: bytes, _timeout: int) -> None:
        assert endpoint == 1
        self.go.wait(5)
        if self.error is not None:
            raise self.error
        self.sent.append(bytes(data))


Dongles: TypeAlias = list[Dongle]


@pytest.fixture
def dongles(monkeypatch: pytest.MonkeyPatch) -> Dongles:
    devices = [Dongle(), Dongle()]
    core, util, package = ModuleType("usb.core"), ModuleType("usb.util"), ModuleType("libusb")
    vars(core)["find"] = lambda **_what: devices
    vars(util)["dispose_resources"] = lambda _device: None
    vars(package)["get_libusb1_backend"] = lambda: None
    for name, module in (("usb.core", core), ("usb.util", util), ("libusb_package", package)):
        monkeypatch.setitem(sys.modules, name, module)
    return devices


@pytest.fixture
def broadcaster(dongles: Dongles) -> Iterator[Broadcaster]:
    """Of the second dongle, on one channel."""
    assert dongles
    with closing(Broadcaster(1, AIRED)) as broadcaster:
        yield broadcaster


def settled(dongle: Dongle, n: int) -> bool:
    return eventually(lambda: len(dongle.sent) == n)


def test_a_packet_is_repeated_on_every_channel(dongles: Dongles) -> None:
    uris = [f"radio://0/{channel}/{rate}" for channel, rate in ((80, "2M"), (90, "250K"))]
    on = [address for uri in uris if (address := RadioAddress.of(uri))]
    radio = Broadcaster(1, on)
    assert radio.order(orders.stop())
    assert settled(dongles[1], 2 * REPEATS)
    radio.close()
    radio.close()
    all_drones = bytes.fromhex("ffe7e7e7e7")
    assert dongles[1].told == [
        (0x06, 0, b""), (0x10, 0, b""),  # no retries, no acknowledgements
        (0x03, 2, b""), (0x01, 80, b""), (0x02, 0, all_drones),
        (0x03, 0, b""), (0x01, 90, b""), (0x02, 0, all_drones),
    ]  # fmt: skip
    assert set(dongles[1].sent) == {orders.stop()}
    assert dongles[0].sent == []


def test_an_order_that_is_void_is_sent_no_more(dongles: Dongles, broadcaster: Broadcaster) -> None:
    dongles[1].go.clear()
    for packet, rows in ((b"a", {0, 1}), (b"b", {2}), (b"c", {1, 3})):
        assert broadcaster.order(packet, rows)
    broadcaster.void({1})
    dongles[1].go.set()
    broadcaster.wait()
    sent = b"".join(dongles[1].sent)
    assert sent.removeprefix(b"a") == b"b" * REPEATS  # one may have been on its way


def test_an_order_that_many_wait_before_is_left_to_the_links(
    dongles: Dongles, broadcaster: Broadcaster
) -> None:
    dongles[1].go.clear()
    taken = [broadcaster.order(b"a") for _ in range(20)].count(True)
    assert 0.1 <= taken * REPEATS * 0.001 < 0.1 + REPEATS * 0.001  # s that they take
    dongles[1].go.set()
    broadcaster.wait()
    assert broadcaster.order(b"a")


def test_waiting_for_a_dongle_that_fails_ends(dongles: Dongles, broadcaster: Broadcaster) -> None:
    dongles[1].error = OSError("pipe error")
    assert broadcaster.order(b"a")
    broadcaster.wait()
    assert broadcaster.broken
    assert not broadcaster.order(b"a")


@pytest.mark.usefixtures("dongles")
def test_a_dongle_that_lacks_is_named() -> None:
    with pytest.raises(PluginError, match="no Crazyradio number 2 for broadcasts; found 2"):
        Broadcaster(2, [])


AIRED = [RadioAddress("1", 80, "2M", "E7E7E7E701")]
AIR = ["radio://0/80/2M/E7E7E7E701", "udp://127.0.0.1:1", "radio://0/80/2M/E7E7E7E702"]


def corrections(n: int, *, attitude_std: float = 0.05, away: float = 1.0) -> Corrections:
    """Corrections of poses; of positions only if the deviation of attitudes is infinite."""
    at, turn = np.full((n, 3), away), np.tile([0.0, 0, 0, 1], (n, 1))
    return Corrections(np.arange(n), at, turn, np.full(n, 0.05), np.full(n, attitude_std))


def test_corrections_of_radios_are_broadcast_once(dongles: Dongles) -> None:
    broadcasts = BroadcastCommands(reached(AIR), 1)
    assert tuple(broadcasts.correct(corrections(3))) == (0, 2)
    broadcasts.close()
    assert b"".join(packet[2::11] for packet in dongles[1].sent) == b"\1\2"


def test_two_poses_go_into_one_packet(dongles: Dongles, broadcaster: Broadcaster) -> None:
    dongles[1].go.clear()
    broadcaster.order(orders.stop())  # holds up what comes after it
    for last in (1, 2, 3):
        broadcaster.show(POSES, last, pose_entry(last, [1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]))
    dongles[1].go.set()
    broadcaster.close()
    first, second = dongles[1].sent[REPEATS:]
    assert first[0] & 0xF3 == 6 << 4 | 1
    entry = struct.pack("<BhhhI", 1, 1000, 2000, 3000, 0xC0000000)
    assert first[1:] == b"\x09" + entry + b"\2" + entry[1:]
    assert second[1:] == b"\x09\3" + entry[1:]


def test_four_positions_go_into_one_packet(dongles: Dongles) -> None:
    broadcasts = BroadcastCommands(
        reached([f"radio://0/80/2M/E7E7E7E7{i:02}" for i in range(1, 7)]), 1
    )
    dongles[1].go.clear()
    broadcasts.order(dict.fromkeys(range(6), orders.stop()))  # holds up what comes after it
    assert tuple(broadcasts.correct(corrections(6, attitude_std=math.inf))) == tuple(range(6))
    dongles[1].go.set()
    broadcasts.close()
    first, second = dongles[1].sent[REPEATS:]
    assert first[0] & 0xF3 == 6 << 4 | 2
    each = [struct.pack("<Bhhh", last, 1000, 1000, 1000) for last in range(1, 7)]
    assert first[1:] == b"".join(each[:4])
    assert second[1:] == b"".join(each[4:])


def test_agents_beyond_millimetre_range_are_not_broadcast(dongles: Dongles) -> None:
    broadcasts = BroadcastCommands(reached(AIR), 1)
    assert tuple(broadcasts.correct(corrections(3, attitude_std=math.inf, away=33.0))) == ()
    broadcasts.close()
    assert dongles[1].sent == []


def test_late_dongles_send_the_newest_pose_of_each_drone(
    dongles: Dongles, broadcaster: Broadcaster
) -> None:
    dongles[1].go.clear()
    broadcaster.order(orders.stop())
    for i in range(1000):
        broadcaster.show(POSES, 1, pose_entry(1, [i / 1000, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]))
    dongles[1].go.set()
    broadcaster.close()
    [sent] = dongles[1].sent[REPEATS:]
    assert struct.unpack_from("<Bh", sent, 2) == (1, 999)


def test_a_dongle_that_fails_leaves_everything_to_the_links(
    dongles: Dongles, caplog: pytest.LogCaptureFixture
) -> None:
    broadcasts = BroadcastCommands(reached(AIR), 1)
    dongles[1].error = OSError("pipe error")
    said = orders.only_for(1, b"a")
    assert broadcasts.order({0: b"a", 2: b"a"}) == {0: said, 2: said}
    broadcasts._radio._thread.join(3)
    assert broadcasts.order({0: b"a", 2: b"a"}) == {}
    assert broadcasts.correct(corrections(3)) == ()
    broadcasts.close()
    assert caplog.messages == ["radio: broadcasting failed, using the links instead: pipe error"]


@pytest.mark.usefixtures("dongles")
def test_a_dongle_that_may_not_be_used_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbid(*_what: object) -> None:
        raise OSError("access denied")

    monkeypatch.setattr(Dongle, "set_configuration", forbid)
    with pytest.raises(PluginError, match="Crazyradio 1 cannot broadcast: access denied"):
        Broadcaster(1, AIRED)


class LinkDriver:
    """What carries packets to one drone: it writes them down, by their first byte's port."""

    def __init__(self, name: str, log: Log) -> None:
        self._name, self._log = name, log

    def send(self, packet: bytes) -> None:
        self._log.append((self._name, WHAT[packet[0] & 0xF3]))

    steer = send

    def close(self) -> None:
        """There is nothing to close."""


WHAT = {
    0x70: "setpoint",
    0x71: "let go",
    0x80: "order",
    0x91: "arm",
    0x22: "deviation",
    0x61: "pose",
}


@pytest.fixture
def log() -> Log:
    """The packets of `radio` and their receivers, in order."""
    return []


@pytest.fixture
def radio(dongles: Dongles, log: Log, monkeypatch: pytest.MonkeyPatch) -> Iterator[Radio]:
    """A connected radio that broadcasts."""
    assert dongles
    all_drones = LinkDriver("all", log)

    def order(_self: Broadcaster, packet: bytes, _rows: object) -> bool:
        all_drones.send(packet)
        return True

    monkeypatch.setattr(Broadcaster, "order", order)
    monkeypatch.setattr(Broadcaster, "show", lambda *_pose: all_drones.send(b"\x61"))
    radio = star_radio.make(reached([AIR[0], AIR[2]]), **options(broadcast=1, landing_timeout=0.0))
    assert isinstance(radio, Radio)
    radio.connected[:] = True
    for vehicle in radio.vehicles:
        vehicle.version = 12
        vehicle.link._driver = LinkDriver(vehicle.name, log)
        vehicle.parameters = {
            "locSrv.extPosStdDev": Entry(1, 6), "locSrv.extQuatStdDev": Entry(2, 6)
        }  # fmt: skip
    with closing(radio):
        yield radio


def test_drones_are_armed_before_a_take_off_is_broadcast(radio: Radio, log: Log) -> None:
    radio.command(command(Order.TAKEOFF, [0, 1]))
    assert log == [("cf1", "arm"), ("cf2", "arm"), ("all", "order")]


def test_an_order_goes_to_each_while_setpoints_fly_one_of_them(radio: Radio, log: Log) -> None:
    radio.send(Setpoint(np.zeros((2, 3)), np.zeros(2), np.array([False, True])))
    radio.command(command(Order.LAND, [0, 1]))
    assert log == [("cf2", "setpoint"), ("cf1", "order")]
    radio.wait(0.0)
    radio.wait(0.2)
    radio.wait(0.2)
    assert ("cf2", "order") in log
    radio.command(command(Order.LAND, [0, 1]))
    assert log[-1] == ("all", "order")


def test_a_stop_is_broadcast_to_agents_that_setpoints_fly_too(radio: Radio, log: Log) -> None:
    radio.send(Setpoint(np.zeros((2, 3)), np.zeros(2), np.ones(2, np.bool_)))
    radio.command(command(Order.STOP, [0, 1]))
    assert log[2:] == [("all", "order"), ("cf1", "let go"), ("cf2", "let go")]


def test_deviations_are_sent_before_poses_are_broadcast(radio: Radio, log: Log) -> None:
    radio.correct(corrections(2))
    assert log == [
        *[("cf1", "deviation")] * 2, *[("cf2", "deviation")] * 2, *[("all", "pose")] * 2,
    ]  # fmt: skip


def test_with_positions_alone_no_deviation_of_attitudes_is_sent(radio: Radio, log: Log) -> None:
    radio.correct(corrections(2, attitude_std=math.inf))
    assert log == [("cf1", "deviation"), ("cf2", "deviation"), *[("all", "pose")] * 2]


def test_a_broadcast_take_off_is_confirmed_by_any_of_its_answers(radio: Radio) -> None:
    radio.command(command(Order.TAKEOFF, [0, 1]))
    radio.vehicles[0].link.hear(b"\x80\7\0\0\1", 0.0)  # a repetition: the plan is in the way
    assert radio.vehicles[0].retry(0.0) == []


@pytest.mark.usefixtures("dongles")
def test_addresses_with_the_same_last_byte_are_refused() -> None:
    uris = ["radio://0/80/2M/E7E7E7E701", "radio://0/80/2M/E7E7E7E801"]
    with pytest.raises(PluginError, match="cf1, cf2 share the last byte of an address"):
        BroadcastCommands(reached(uris), 0)
