"""Attacks on simulated Crazyflies and on their clients, by datagrams."""

from __future__ import annotations

import random
import socket
from contextlib import closing
from threading import Event, Thread

import numpy as np

from star_core.testing import scene
from star_fleet.packet import MAX_PAYLOAD
from star_fleet.server import Fleet
from star_radio.connection.udp_links import UdpLinks
from tests.plugins.commands.star_fleet.conftest import place
from tests.plugins.transports.star_radio.test_udp_links import Listener
from tests.simulators import ideal_fleet
from tests.waiting import eventually

PING = b"\xf0ping"
SOURCES = 20


def client() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.settimeout(30.0)
    return made


def test_drones_listen_on_the_loopback_address_only() -> None:
    with ideal_fleet(scene(2)) as fleet:
        for each in fleet._ports.sockets:
            assert each.getsockname()[0] == "127.0.0.1"
            assert not each.getsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST)


def test_malformed_packets_reach_no_other_drone() -> None:
    with closing(ideal_fleet(scene(2))) as fleet:
        before = fleet.simulator.drones[1].copy()
        for header in range(256):
            for size in range(MAX_PAYLOAD + 3):
                for fill in b"\x00", b"\xff", b"\x7f":
                    answers = fleet.handle(0, bytes([header]) + size * fill)
                    assert all(len(answer) <= MAX_PAYLOAD + 1 for answer in answers)
            fleet.advance()
        after = fleet.simulator.drones[1]
        assert (before["position"] == after["position"]).all()
        assert fleet.handle(1, PING) == [PING]
        for name in ("position", "velocity", "attitude"):
            assert np.isfinite(fleet.simulator.drones[name]).all()


def _flood(fleet: Fleet, stop: Event) -> None:
    """Send datagrams of any content and size to the first drone, from many ports."""
    draw = random.Random(1)  # noqa: S311 -- the same in each run
    sources = [client() for _ in range(SOURCES)]
    while not stop.is_set():
        size = draw.choice([0, 1, 5, 31, 32, 64, 1400, 60_000])
        draw.choice(sources).sendto(draw.randbytes(size), place(fleet.addresses[0]))
    for each in sources:
        each.close()


def test_a_flood_keeps_no_other_drone_from_answering() -> None:
    with ideal_fleet(scene(2)) as fleet, client() as own:
        stop = Event()
        flood = Thread(target=_flood, args=(fleet, stop))
        flood.start()
        began = fleet.time
        try:
            while fleet.time < began + 0.5:
                _ping(own, fleet.addresses[1])
        finally:
            stop.set()
            flood.join()
        _ping(own, fleet.addresses[0])


def _ping(own: socket.socket, address: str) -> None:
    """Wait for the answer of a drone, which sends its console and its stream, too."""
    own.sendto(PING, place(address))
    while own.recvfrom(64) != (PING, place(address)):
        pass


def test_foreign_datagrams_are_not_telemetry() -> None:
    listener, links = Listener(), UdpLinks()
    with closing(links), client() as drone, client() as foreign:
        drone.bind(("127.0.0.1", 0))
        link = links.open(f"udp://127.0.0.1:{drone.getsockname()[1]}", listener)
        link.send(PING)
        _packet, flight = drone.recvfrom(64)
        for data in b"\x50\x01spoofed", bytes(60_000), b"":
            foreign.sendto(data, flight)
        drone.sendto(b"\x50\x01own", flight)
        assert eventually(lambda: listener.heard)
        assert listener.heard == [b"\x50\x01own"]
        link.close()
