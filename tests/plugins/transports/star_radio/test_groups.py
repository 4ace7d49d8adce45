"""Orders that are broadcast to groups: which, to whom, and that only those they are for obey."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import Order, PluginError, Scene, Setpoint, Supervisor
from star_core.testing import scene
from star_radio import orders
from star_radio.broadcast import BroadcastCommands
from star_radio.connection import udp_links
from star_radio.options import RadioOptions
from star_radio.transport import Radio
from tests.end_to_end.virtual_air import Air as FleetAir
from tests.plugins.transports.star_radio.conftest import (
    Open,
    Peers,
    command,
    options,
    reached,
    ticks,
)
from tests.plugins.transports.star_radio.peer import Peer
from tests.plugins.transports.star_radio.virtual import VirtualTime, virtual

Groups: TypeAlias = Mapping[str, Sequence[int]]


class Air:
    """What packets are broadcast into, in place of a dongle.

    Attributes:
        said: What was broadcast, and to whom.
        voided: Whose orders were voided, in turn.
        hearers: Where it arrives.
    """

    broken = False

    def __init__(self) -> None:
        self.said: list[tuple[bytes, set[int]]] = []
        self.voided: list[set[int]] = []
        self.hearers: list[Callable[[bytes], object]] = []
        self.clock = VirtualTime()

    def order(self, packet: bytes, rows: Sequence[int] = ()) -> bool:
        self.said.append((packet, set(rows)))
        for hear in self.hearers:
            self.clock.later(0.02, partial(hear, packet))  # a dongle has a thread, too
        return True

    def void(self, rows: Sequence[int]) -> None:
        self.voided.append(set(rows))

    def wait(self) -> None:
        self.clock.sleep(0.02)

    def close(self) -> None:
        """There is nothing to close."""


def aired(n: int, groups: Groups, wired: Sequence[int] = ()) -> Scene:
    """A scene whose agents are on the air, but for those over a wire."""
    rows = [row for row in range(n) if row not in wired]
    on = {row: f"radio://0/80/2M/E7E7E7E7{row:02X}" for row in rows}
    room = reached([on.get(row, f"udp://127.0.0.1:{row + 1}") for row in range(n)])
    return dataclasses.replace(room, groups={name: tuple(rows) for name, rows in groups.items()})


def broadcasts(room: Scene, air: Air) -> BroadcastCommands:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("star_radio.broadcast.Broadcaster", lambda _dongle, _on: air)
        return BroadcastCommands(room, 1)


def test_all_have_a_bit_and_each_group_has_one() -> None:
    made = broadcasts(aired(4, {"left": (0, 1), "even": (0, 2)}), Air())
    assert made.masks == {0: 0b111, 1: 0b011, 2: 0b101, 3: 0b001}


def test_trivial_or_duplicate_groups_have_no_bit_of_their_own() -> None:
    groups = {"one": (0,), "same": (1, 0), "all": (0, 1, 2), "again": (0, 1), "wire": (3, 0)}
    made = broadcasts(aired(4, groups, wired=(3,)), Air())
    assert made.masks == {0: 0b11, 1: 0b11, 2: 0b01}


def test_the_first_seven_groups_have_bits() -> None:
    groups = {f"g{i}": (i, i + 1) for i in range(9)}
    assert broadcasts(aired(11, groups), Air()).masks[7] == 0x81
    assert broadcasts(aired(11, groups), Air()).masks[8] == 0x01


STOP, LAND = orders.stop(), orders.land(0.0, 2.0)
HALVES = {"left": (0, 1), "right": (2, 3)}
CROSSED = {"left": (0, 1), "even": (0, 2)}


@pytest.mark.parametrize(
    ("groups", "packets", "said"),
    [
        (HALVES, [STOP, STOP, STOP, STOP], ["8c0307"]),
        (HALVES, [STOP, STOP, None, None], ["8c0302"]),
        (HALVES, [None, STOP, STOP, STOP], ["8c0304"]),
        (HALVES, [STOP, None, STOP, None], []),
        (HALVES, [STOP, STOP, LAND, LAND], ["8c0302", orders.only_for(4, LAND).hex()]),
        (HALVES, [STOP, STOP, LAND, STOP], ["8c0302"]),
        (CROSSED, [STOP, STOP, STOP, None], ["8c0306"]),  # the first hears it once
        ({}, [STOP, STOP, None, None], []),
        ({}, [STOP, STOP, STOP, STOP], ["8c0301"]),  # for no other drone that receives it
    ],
)
def test_what_a_group_has_in_common_is_broadcast_once(
    groups: Groups, packets: list[bytes | None], said: list[str]
) -> None:
    air = Air()
    made = broadcasts(aired(4, groups), air)
    reached = made.order({i: order for i, order in enumerate(packets) if order})
    assert [packet.hex() for packet, _rows in air.said] == said
    assert reached == {row: packet for packet, rows in air.said for row in rows}


PACKETS = st.sampled_from([None, STOP, LAND, orders.go_to([1.0, 2.0, 3.0], 0.0, 2.0, 12)])
SIX = st.sets(st.integers(0, 5))


@given(
    st.lists(PACKETS, min_size=6, max_size=6),
    st.lists(SIX, max_size=10),
    st.sets(st.integers(0, 5), max_size=3),
)
def test_every_drone_gets_its_own_packet_once(
    packets: list[bytes | None], groups: list[set[int]], wired: set[int]
) -> None:
    air = Air()
    named = {f"g{i}": tuple(rows) for i, rows in enumerate(groups)}
    made = broadcasts(aired(6, named, tuple(wired)), air)
    asked = {row: packet for row, packet in enumerate(packets) if packet}
    reached = made.order(asked)
    for row, packet in enumerate(packets):
        obeyed = [
            said
            for said, _rows in air.said
            if row not in wired and (said[2] == 0 or said[2] & made.masks[row])
        ]
        assert obeyed == ([reached[row]] if row in reached else [])
        by_link = [] if packet is None or row in reached else [packet]
        got = by_link + [orders.only_for(orders.ALL_GROUPS, order) for order in obeyed]
        assert got == ([] if packet is None else [packet])
    assert {row for _said, rows in air.said for row in rows} == reached.keys()


@given(st.lists(SIX, max_size=8))
def test_a_command_to_a_group_is_not_repeated_to_its_agents(groups: list[set[int]]) -> None:
    named = {f"g{i}": tuple(rows) for i, rows in enumerate(groups)}
    told = [rows for rows in groups if len(rows) > 1 and 5 not in rows]
    reached = broadcasts(aired(6, named), Air()).order(dict.fromkeys(set().union(*told), STOP))
    assert reached.keys() == set().union(*told)


def test_all_agents_are_taken_out_of_groups() -> None:
    air = Air()
    broadcasts(aired(3, {}), air).clear_groups()
    assert [packet.hex() for packet, _rows in air.said] == ["8c0000"]


@pytest.fixture
def aloud(tmp_path: Path, stack: ExitStack) -> Open:
    """Make a radio over UDP that broadcasts too: all drones with a link receive it."""

    def make(uris: list[str], groups: Groups, air: Air, **how: str) -> Radio:
        clock = udp_links.UdpLinks()
        assert isinstance(clock, VirtualTime)
        room = reached(uris)
        made = broadcasts(aired(len(uris), groups), air)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("star_radio.transport.BroadcastCommands", lambda *_how: made)
            settings = options(cache=str(tmp_path), response_timeout=0.6, broadcast=1, **how)
            radio = Radio(room, RadioOptions(**settings))
        stack.callback(radio.close)
        air.clock = clock
        air.hearers = [vehicle.link.post for vehicle in radio.vehicles]
        return radio

    return make


def uris(drones: list[Peer]) -> list[str]:
    return [drone.uri for drone in drones]


@pytest.mark.parametrize(
    ("groups", "masks"),
    [({"left": (0, 1), "right": (1, 2)}, [b"\3", b"\7", b"\5"]), ({}, [b"\1"] * 3)],
)
def test_every_drone_is_put_into_its_groups_at_last(
    peers: Peers, aloud: Open, groups: Groups, masks: list[bytes]
) -> None:
    drones = peers(3)
    aloud(uris(drones), groups, Air()).connect()
    assert [drone.sent_to(8, 0) for drone in drones] == [[b"\0" + mask] for mask in masks]


def test_without_a_broadcast_all_drones_are_put_into_one_group(peers: Peers, connect: Open) -> None:
    drones = peers(2)
    connect(drones)
    assert [drone.sent_to(8, 0) for drone in drones] == [[b"\0\1"]] * 2


def test_groups_are_sent_again_if_that_is_lost(peers: Peers, aloud: Open) -> None:
    drones = peers(2)
    drones[0].lose[b"\x80\0"] = 1
    aloud(uris(drones), {}, Air()).connect()
    assert drones[0].sent_to(8, 0) == [b"\0\1"] * 2


def test_an_agent_that_refuses_its_groups_is_absent(peers: Peers, aloud: Open) -> None:
    drones = peers(1)
    drones[0].errors[0] = [8]
    with pytest.raises(PluginError, match="refuses to be put into groups: it does not know it"):
        aloud(uris(drones), {}, Air()).connect()


TRIO = {"pair": (0, 1)}


def told(drone: Peer) -> list[bytes]:
    """The stops that a drone received."""
    return [payload for payload in drone.sent_to(8, 0) if payload[0] == STOP[1]]


@pytest.mark.parametrize("lost", [False, True])
def test_a_broadcast_is_repeated_by_the_links_of_its_group(
    peers: Peers, aloud: Open, *, lost: bool
) -> None:
    drones, air = peers(3), Air()
    radio = aloud(uris(drones), TRIO, air)
    radio.connect()
    if lost:
        air.hearers = []
    radio.command(command(Order.STOP, [0, 1]))
    ticks(radio, 12)
    assert [set(told(drone)) for drone in drones[:2]] == [{b"\3\2"}] * 2
    assert told(drones[2]) == ([] if lost else [b"\3\2"])


def test_what_is_newer_voids_what_is_still_broadcast(peers: Peers, aloud: Open) -> None:
    air = Air()
    radio = aloud(uris(peers(3)), TRIO, air)
    radio.connect()
    radio.command(command(Order.STOP, [0, 1]))
    for _tick in range(2):
        radio.send(Setpoint(np.zeros((3, 3)), np.zeros(3), np.array([False, True, False])))
    assert air.voided == [{0, 1}, {1}, set()]


@pytest.mark.parametrize(("absent", "said"), [(2, ["8c0302"]), (1, [])])
def test_absent_drones_prevent_broadcasts_addressed_to_them(
    absent: int, said: list[str], peers: Peers, aloud: Open
) -> None:
    drones = peers(3)
    drones[absent].mute.set()
    air = Air()
    radio = aloud(uris(drones), TRIO, air, absent="fly-without")
    radio.connect()
    air.said.clear()
    radio.command(command(Order.STOP, [0, 1, 2]))
    assert [packet.hex() for packet, _rows in air.said] == said


def test_only_the_group_takes_off_though_all_hear_it(aloud: Open) -> None:
    fleet, air = FleetAir(scene(3), noise=False), Air()
    with virtual(fleet), closing(fleet.fleet):
        radio = aloud(fleet.uris, TRIO, air)
        radio.connect()
        air.said.clear()
        radio.command(command(Order.TAKEOFF, [0, 1], (0.0, 0.0, 0.4)))
        now = ticks(radio, 32)[-1]
        radio.close()
    assert [packet[:3].hex() for packet, _rows in air.said] == ["8c0702"]
    assert (now.state & int(Supervisor.FLYING) > 0).tolist() == [True, True, False]
    assert now.position[:2, 2] == pytest.approx(0.4, abs=0.1)
    assert now.position[2, 2] == pytest.approx(0.0, abs=0.05)
    assert now.refusals == ()
