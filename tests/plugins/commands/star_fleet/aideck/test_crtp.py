"""A vehicle answers over TCP what it is asked in CPX, to cflib too."""

from __future__ import annotations

import logging
import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest

from star_fleet.aideck import MAX_WAITING, CrtpOverTcp
from star_fleet.cpx import Decoder, Function, Packet, Switchboard, Target, encode
from tests.waiting import eventually


def unheard(packet: bytes) -> list[bytes]:
    raise ZeroDivisionError(packet)


def echo(packet: bytes) -> list[bytes]:
    return [packet, packet[::-1]]


def asked(packet: bytes, function: Function = Function.CRTP) -> bytes:
    return encode(Packet(Target.HOST, Target.STM32, function, packet))


def answers(client: socket.socket, count: int) -> list[Packet]:
    decoder, packets = Decoder(), list[Packet]()
    while len(packets) < count:
        data = client.recv(4096)
        assert data
        packets += decoder.feed(data)
    return packets


@pytest.fixture
def link(switchboard: Switchboard) -> Iterator[CrtpOverTcp]:
    with CrtpOverTcp("127.0.0.1", 0, echo, switchboard=switchboard) as link:
        yield link


@pytest.fixture
def client(link: CrtpOverTcp) -> Iterator[socket.socket]:
    with socket.create_connection(link.address, 5) as client:
        assert eventually(lambda: link.connected)
        yield client


def test_every_packet_is_answered_in_order(client: socket.socket) -> None:
    client.sendall(asked(b"\x01ab") + asked(b"\x02cd"))
    packets = answers(client, 4)
    assert [p.data for p in packets] == [b"\x01ab", b"ba\x01", b"\x02cd", b"dc\x02"]
    assert {p[:3] for p in packets} == {(Target.STM32, Target.HOST, Function.CRTP)}


def test_packets_can_be_pushed(link: CrtpOverTcp, client: socket.socket) -> None:
    link.push(b"\x52log")
    assert [p.data for p in answers(client, 1)] == [b"\x52log"]


def test_what_is_no_crtp_is_not_answered(client: socket.socket) -> None:
    client.sendall(asked(b"\x21\x01", Function.SYSTEM) + asked(b"") + asked(bytes(32)))
    client.sendall(asked(b"\x01"))
    assert [p.data for p in answers(client, 2)] == [b"\x01", b"\x01"]


@pytest.mark.usefixtures("client")
def test_a_client_that_leaves_too_much_unread_is_sent_away(link: CrtpOverTcp) -> None:
    def gone() -> bool:
        for _ in range(MAX_WAITING):
            link.push(bytes(31))
        return not link.connected

    assert eventually(gone, within=20.0)


def test_a_vehicle_that_fails_loses_its_client_only(
    switchboard: Switchboard, client: socket.socket, caplog: pytest.LogCaptureFixture
) -> None:
    with (
        CrtpOverTcp("127.0.0.1", 0, unheard, switchboard=switchboard) as broken,
        socket.create_connection(broken.address, 5) as other,
        caplog.at_level(logging.ERROR),
    ):
        other.sendall(asked(b"\x01"))
        assert other.recv(1) == b""
        client.sendall(asked(b"\x01"))
        assert len(answers(client, 2)) == 2
    assert "ZeroDivisionError" in caplog.text


def test_clients_sending_invalid_lengths_may_reconnect(
    link: CrtpOverTcp, client: socket.socket
) -> None:
    client.sendall(b"\0\0\0\0")
    assert client.recv(1) == b""
    with socket.create_connection(link.address, 5) as again:
        again.sendall(asked(b"\x01"))
        assert len(answers(again, 2)) == 2


def test_a_thousand_malformed_frames_change_nothing(
    link: CrtpOverTcp, client: socket.socket
) -> None:
    client.close()
    random = np.random.default_rng(3)
    for _ in range(20):
        with socket.create_connection(link.address, 5) as bad:
            for _ in range(50):
                frame = bytearray(asked(random.bytes(20)))
                frame[random.integers(4)] = random.integers(256)
                try:
                    bad.sendall(frame)
                except OSError:
                    break
    with socket.create_connection(link.address, 5) as good:
        good.sendall(asked(b"\x01"))
        assert len(answers(good, 2)) == 2


@pytest.mark.usefixtures("capfd")  # it prints
def test_cflib_talks_to_it(link: CrtpOverTcp) -> None:
    tcp = pytest.importorskip("cflib.crtp.tcpdriver")
    stack = pytest.importorskip("cflib.crtp.crtpstack")
    driver = tcp.TcpDriver()
    driver.connect("tcp://{}:{}".format(*link.address), None, print)
    time.sleep(0.2)  # cflib drops what comes before its thread first asks for CRTP
    packet = stack.CRTPPacket(0xFC, b"ping")
    driver.send_packet(packet)
    first = driver.receive_packet(5)
    link.push(b"\x50\x01\x02")
    driver.receive_packet(5)
    pushed = driver.receive_packet(5)
    router = driver.cpx._router
    driver.close()
    router.join(5)  # it prints a traceback when its link is closed
    assert (first.header, bytes(first.data)) == (packet.header, b"ping")
    assert (pushed.port, pushed.channel, bytes(pushed.data)) == (5, 0, b"\x01\x02")
