"""The fleet on its sockets, in real time and faster."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator

import pytest

from star_core import PluginError
from star_core.testing import scene
from star_fleet.packet import NULL, Port, join
from star_fleet.server import address
from tests.plugins.commands.star_fleet.conftest import place
from tests.simulators import ideal_fleet

FAST = 10.0


@pytest.fixture
def client() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.settimeout(5.0)
        yield made


def test_every_agent_has_a_port_of_its_own(client: socket.socket) -> None:
    with ideal_fleet(scene(3)) as fleet:
        assert len(set(fleet.addresses)) == 3
        for uri in fleet.addresses:
            client.sendto(NULL, place(uri))
            assert client.recvfrom(64) == (NULL, place(uri))


@pytest.mark.parametrize("size", [0, 32, 64, 65, 65_507])
def test_a_datagram_that_is_no_packet_is_not_answered(client: socket.socket, size: int) -> None:
    with ideal_fleet(scene(1)) as fleet:
        client.sendto(bytes([0xF0] * size), place(fleet.addresses[0]))
        client.sendto(b"\xf0ping", place(fleet.addresses[0]))
        assert client.recv(64) == b"\xf0ping"


def test_ports_follow_the_first_one() -> None:
    with ideal_fleet(scene(1)) as probe:
        first = place(probe.addresses[0])[1]
    with ideal_fleet(scene(1), port=first) as fleet:
        assert fleet.addresses == [f"udp://127.0.0.1:{first}"]


def test_a_port_that_is_taken_is_named() -> None:
    with ideal_fleet(scene(1)) as fleet:
        taken = place(fleet.addresses[0])[1]
        match = rf"agent 'cf1': port {taken} of '127.0.0.1' is not available: "
        with pytest.raises(PluginError, match=match):
            ideal_fleet(scene(1), port=taken)


def test_images_are_streamed_to_the_client_that_asked_last(client: socket.socket) -> None:
    with ideal_fleet(scene(1), speed=FAST) as fleet:
        address = place(fleet.addresses[0])
        client.sendto(join(Port.LOG, 1, struct.pack("<BBBH", 6, 1, 7, 0)), address)
        assert client.recv(64) == join(Port.LOG, 1, b"\x06\x01\0")
        client.sendto(join(Port.LOG, 1, b"\x03\x01\x0a"), address)
        packets = [client.recv(64) for _ in range(10)]
        assert sum(packet[:2] == b"\x52\x01" for packet in packets) >= 4


def test_the_link_timeout_is_one_of_the_clients_clock() -> None:
    fleet = ideal_fleet(scene(1), speed=FAST)
    fleet.handle(0, join(Port.LOG, 1, struct.pack("<BBBH", 6, 1, 7, 0)))
    fleet.handle(0, join(Port.LOG, 1, b"\x03\x01\x0a"))
    for seconds, error in ((0.9, b"\0"), (1.1, b"\2")):
        for _ in range(round(seconds * FAST * 100)):
            fleet.advance()
        assert fleet.handle(0, join(Port.LOG, 1, b"\x03\x01\x0a"))[0][-1:] == error
    fleet.close()


def test_simulated_time_goes_at_its_speed() -> None:
    with ideal_fleet(scene(1), speed=4.0) as fleet:
        first, began = fleet.time, time.monotonic()
        time.sleep(0.5)
        rate = (fleet.time - first) / (time.monotonic() - began)
        assert fleet.slipped > 0 or rate == pytest.approx(4.0, rel=0.5)


def test_serving_ends_at_a_time_and_at_a_word() -> None:
    fleet = ideal_fleet(scene(1), speed=FAST)
    fleet.serve(until=0.5)
    assert fleet.time == pytest.approx(0.5, abs=0.011)
    threading.Timer(0.1, fleet.stop).start()
    fleet.serve()
    fleet.close()
    fleet.close()
    assert 0 < fleet.busy < 60


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("radio://0/80/2M/E7E7E7E70A", 0xE7E7E7E70A),
        ("radio://0/80/2M/E7E7E7E70B?rate_limit=100", 0xE7E7E7E70B),
        ("radio://0/80/2M", 0xE7E7E7E703),
        ("udp://127.0.0.1:19850", 0xE7E7E7E703),
        (None, 0xE7E7E7E703),
    ],
)
def test_an_address_is_that_of_the_radio_or_follows_the_row(uri: str | None, expected: int) -> None:
    agent = scene(1).agents[0]
    assert address(type(agent)(agent.name, agent.start, uri=uri), 2) == expected
