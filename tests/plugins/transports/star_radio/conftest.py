"""A swarm of scripted Crazyflies, and a radio to them."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest

import star_radio
from star_core import Array, Command, Order, Scene, Telemetry, Trajectory
from star_core.plugin_support.option_schema import fill_defaults
from star_core.testing import scene
from star_fleet.server import Fleet
from star_radio.options import OPTIONS
from star_radio.report import Layout, Z
from star_radio.transport import Radio
from tests.plugins.transports.star_radio.peer import Peer, PeerClock, UdpPeer
from tests.plugins.transports.star_radio.virtual import virtual

Open: TypeAlias = Callable[..., Radio]
Peers: TypeAlias = Callable[..., list[Peer]]
UNSERVED = "udp://127.0.0.1:9"  # the port `discard`, which has no server
TICK = 0.05  # s


def options(**changes: Any) -> dict[str, Any]:
    """Options of the transport, with the defaults of the schema."""
    return fill_defaults({"guardian": False, "descent": False} | changes, OPTIONS)


def reached(uris: list[str], rate: float = 20.0) -> Scene:
    """A scene whose agents have addresses."""
    room = scene(len(uris), rate=rate)
    agents = tuple(
        dataclasses.replace(agent, uri=uri) for agent, uri in zip(room.agents, uris, strict=True)
    )
    return dataclasses.replace(room, agents=agents, realtime=True)


def command(
    order: Order,
    rows: Sequence[int] = (0,),
    position: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    yaw: float = 0.0,
    duration: float = 1.0,
    trajectory: Trajectory | None = None,
) -> Command:
    """The same command to some agents."""
    n = len(rows)
    at, yaws, durations = np.tile(position, (n, 1)), np.full(n, yaw), np.full(n, duration)
    return Command(order, np.array(rows), at, yaws, durations, trajectory)


def report_unknown_heights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all drones report NaN as their heights from now on."""
    read = Layout.read

    def unknown(layout: Layout, payloads: Sequence[bytes]) -> Array:
        values = read(layout, payloads)
        values[:, Z] = np.nan
        return values

    monkeypatch.setattr(Layout, "read", unknown)


def ticks(radio: Radio, n: int) -> list[Telemetry]:
    """Let ticks of 50 ms pass, the first at once; return what was received in each."""
    first = 0.0 if radio.began is None else time.monotonic() - radio.began
    received = []
    for i in range(n):
        radio.wait(first + i * TICK)
        received.append(radio.receive())
    return received


def received(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int, bytes]]:
    """Return port, channel and payload of every packet that drones receive from now on."""
    packets: list[tuple[int, int, bytes]] = []
    handle = fleet.handle

    def handled(row: int, packet: bytes, *, tcp: bool = False) -> list[bytes]:
        packets.append((packet[0] >> 4, packet[0] & 3, packet[1:]))
        return handle(row, packet, tcp=tcp)

    monkeypatch.setattr(fleet, "handle", handled)
    return packets


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have questions asked again at every tick."""
    monkeypatch.setattr("star_radio.connection.questions.Answers.timeout", 0.02)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def virtual_clock(stack: ExitStack) -> PeerClock:
    """The virtual clock of a test, and its peers."""
    clock = PeerClock()
    stack.enter_context(virtual(clock))
    return clock


@pytest.fixture
def peers(virtual_clock: PeerClock) -> Peers:
    """Start peers on the virtual clock."""

    def start(n: int = 1, **how: Any) -> list[Peer]:
        return virtual_clock.start(n, **how)

    return start


@pytest.fixture
def udp_peers(stack: ExitStack) -> Peers:
    """Start peers behind UDP sockets, in real time."""

    def start(n: int = 1) -> list[Peer]:
        return [stack.enter_context(UdpPeer()) for _ in range(n)]

    return start


@pytest.fixture
def make(tmp_path: Path, stack: ExitStack) -> Open:
    """Make a radio to some addresses; it is closed at the end."""

    def make(uris: list[str], *, reports_in_map: bool = False, **how: Any) -> Radio:
        settings: dict[str, Any] = {
            "cache": str(tmp_path),
            "response_timeout": 0.6,
            "landing_timeout": 1.0,  # s, for peers that stay in the air
            **how,
        }
        room = dataclasses.replace(reached(uris), reports_in_map=reports_in_map)
        radio = star_radio.make(room, **options(**settings))
        assert isinstance(radio, Radio)
        stack.callback(radio.close)
        return radio

    return make


@pytest.fixture
def connect(make: Open) -> Open:
    """Make a radio to some peers, and connect it."""

    def connect(peers: list[Peer], **options: Any) -> Radio:
        radio = make([peer.uri for peer in peers], **options)
        radio.connect()
        return radio

    return connect


@pytest.fixture
def drone(peers: Peers) -> Peer:
    """A peer on the virtual clock."""
    return peers()[0]


@pytest.fixture
def radio(drone: Peer, connect: Open) -> Radio:
    """A radio that is connected to the drone."""
    return connect([drone])
