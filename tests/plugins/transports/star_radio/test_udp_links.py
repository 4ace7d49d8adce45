"""Links over UDP: one thread hears them all, and none of them disturbs another."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing

import pytest

from star_core import PluginError
from star_radio.connection.link import Link
from star_radio.connection.udp_links import UdpLinks
from tests.plugins.transports.star_radio.conftest import Open, Peers
from tests.waiting import eventually


class Listener:
    """A listener that keeps what it receives."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []
        self.complaints: list[str] = []
        self.looks = 0

    def hear(self, packet: bytes, arrived: float) -> None:
        assert time.monotonic() - arrived < 5
        self.heard.append(packet)

    def idle(self, now: float) -> None:
        self.looks += 1

    def complain(self, message: str) -> None:
        self.complaints.append(message)

    def note_quality(self, quality: dict[str, float]) -> None: ...


@pytest.fixture
def datagrams() -> Iterator[UdpLinks]:
    with closing(UdpLinks()) as datagrams:
        yield datagrams


@pytest.fixture
def drone() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as drone:
        drone.bind(("127.0.0.1", 0))
        drone.settimeout(5)
        yield drone


def uri(drone: socket.socket) -> str:
    return f"udp://127.0.0.1:{drone.getsockname()[1]}"


def test_packets_go_and_come_as_they_are(datagrams: UdpLinks, drone: socket.socket) -> None:
    ear = Listener()
    line = datagrams.open(uri(drone), ear)
    line.send(b"\x80up")
    line.steer(b"\x70set")
    packet, client = drone.recvfrom(64)
    assert (packet, drone.recv(64)) == (b"\x80up", b"\x70set")
    for answer in (b"\x80one", b"", b"\x52two"):
        drone.sendto(answer, client)
    assert eventually(lambda: ear.heard == [b"\x80one", b"\x52two"])
    assert ear.complaints == []
    line.close()


def test_an_agent_without_messages_is_polled(datagrams: UdpLinks, drone: socket.socket) -> None:
    ear = Listener()
    line = datagrams.open(uri(drone), ear)
    assert eventually(lambda: ear.looks > 2)
    line.close()


def test_unreachable_addresses_are_reported_and_others_served(
    datagrams: UdpLinks, drone: socket.socket
) -> None:
    silent, ear = Listener(), Listener()
    gone = datagrams.open("udp://127.0.0.1:9", silent)
    line = datagrams.open(uri(drone), ear)
    gone.send(b"\x80")
    assert eventually(lambda: any("refused" in said for said in silent.complaints))
    line.send(b"\x80")
    drone.sendto(b"\x80", drone.recvfrom(64)[1])
    assert eventually(lambda: ear.heard == [b"\x80"])
    line.close()
    gone.close()


def test_a_line_that_is_closed_sends_and_receives_nothing(
    datagrams: UdpLinks, drone: socket.socket
) -> None:
    ear = Listener()
    line = datagrams.open(uri(drone), ear)
    line.send(b"\x80")
    client = drone.recvfrom(64)[1]
    line.close()
    line.close()
    line.send(b"\x81")
    drone.sendto(b"\x80", client)
    time.sleep(0.05)
    drone.settimeout(0.05)
    with pytest.raises(TimeoutError):
        drone.recv(64)
    assert ear.heard == []


def test_one_thread_hears_a_swarm_and_ends_with_it(udp_peers: Peers, connect: Open) -> None:
    before = threading.active_count()
    drones = udp_peers(3)  # a thread each
    radio = connect(drones)
    assert threading.active_count() == before + 3 + 1
    radio.close()
    assert threading.active_count() == before + 3


def test_a_host_that_there_is_not_is_named(datagrams: UdpLinks) -> None:
    link = Link("udp://no.such.host.invalid:19850", "cf1", datagrams)
    with pytest.raises(PluginError, match=r"^udp://no\.such\.host\.invalid:19850: "):
        link.open(1.0)
