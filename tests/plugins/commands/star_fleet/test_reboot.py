"""What a reboot in flight does to a simulated vehicle."""

from __future__ import annotations

import errno
import struct
from typing import Any

import pytest

from star_core import Supervisor
from star_fleet.packet import Port
from star_fleet.server import BOOT_TIME
from tests.plugins.commands.star_fleet.conftest import Bench, Start


def stamps(bench: Any) -> list[int]:
    """Time stamps of the reports so far, ms."""
    return [
        int.from_bytes(packet[2:5], "little") for packet in bench.streamed[0] if packet[0] == 0x52
    ]


@pytest.fixture
def rebooted(bench: Bench) -> Any:
    """A drone that reported, hovered at 0.8 m, rebooted, and fell."""
    bench.ask(Port.LOG, 1, struct.pack("<BBBH", 6, 1, 7, 0))
    bench.ask(Port.LOG, 1, b"\x03\x01\x01")
    assert bench.takeoff() == 0
    bench.fly(3.0)
    assert stamps(bench)[-1] >= 2990
    bench.streamed[0].clear()
    bench.fleet.reboot(0)
    bench.fly(BOOT_TIME + 0.5)
    return bench


def test_its_motors_stop_and_it_is_neither_flying_nor_locked(rebooted: Any) -> None:
    assert not rebooted.turned
    assert rebooted.position[2] == 0
    assert not rebooted.state() & (Supervisor.FLYING | Supervisor.LOCKED | Supervisor.CRASHED)


def test_it_answers_nothing_while_it_boots(bench: Bench) -> None:
    bench.fleet.reboot(0)
    assert bench.ask(Port.LINK, 0, b"ping") == []
    bench.fly(BOOT_TIME)
    assert bench.ask(Port.LINK, 0, b"ping") == [b"ping"]


def test_its_log_blocks_are_gone_and_its_clock_begins_anew(rebooted: Any) -> None:
    assert rebooted.streamed[0] == []
    assert rebooted.ask(Port.LOG, 1, b"\x03\x01\x01") == [bytes([3, 1, errno.ENOENT])]
    rebooted.ask(Port.LOG, 1, struct.pack("<BBBH", 6, 1, 7, 0))
    rebooted.ask(Port.LOG, 1, b"\x03\x01\x01")
    rebooted.fly(0.1)
    assert 0 < stamps(rebooted)[0] < 1000 * (BOOT_TIME + 0.6)


def test_an_order_to_land_starts_its_motors_on_the_floor(rebooted: Any) -> None:
    assert rebooted.land() == 0
    rebooted.fly(0.2)
    assert rebooted.turned


def test_without_feed_forward_a_drone_lags_its_plan(start: Start) -> None:
    heights = []
    for feed_forward in (True, False):
        bench = start(feed_forward=feed_forward)
        assert bench.takeoff(0.8, 2.0) == 0
        bench.fly(1.0)
        heights.append(bench.position[2])
    assert heights[0] == pytest.approx(0.4, abs=0.05)
    assert heights[1] < heights[0] - 0.15
