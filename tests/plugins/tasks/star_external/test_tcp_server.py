"""The port, with real sockets on the loopback."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from star_core import PluginError
from star_external.tcp_server import MAX_LINE, MAX_UNREAD, Line, TcpServer

SOON = 5.0  # s

Connect = Callable[[], Any]


def heard(server: TcpServer, many: int) -> list[Line]:
    """The next lines, however many calls they take."""
    lines: list[Line] = []
    until = time.monotonic() + SOON
    while len(lines) < many and time.monotonic() < until:
        lines += server.receive(many - len(lines), 0.2)
    return lines


def gone(server: TcpServer) -> bool:
    """Whether it is seen that the client has gone."""
    until = time.monotonic() + SOON
    while server.connected and time.monotonic() < until:
        server.receive(9, 0.05)
    return not server.connected


@pytest.fixture
def client(server: TcpServer, connect: Connect) -> Any:
    """Return a client that the server has accepted."""
    made = connect()
    server.accept(SOON)
    return made


def test_no_client_is_connected_at_first(server: TcpServer) -> None:
    assert not server.accept(0.0)
    assert server.receive(9, 0.0) == []


def test_lines_are_heard_with_their_numbers(server: TcpServer, client: Any) -> None:
    client.send(b"one\ntwo\r\n")
    assert heard(server, 2) == [Line(1, b"one"), Line(2, b"two\r")]


def test_no_more_lines_are_heard_than_asked_for(server: TcpServer, client: Any) -> None:
    client.send(b"1\n2\n3\n")
    assert server.receive(1, SOON) == [Line(1, b"1")]
    assert heard(server, 2) == [Line(2, b"2"), Line(3, b"3")]


def test_half_a_line_waits_for_the_other_half(server: TcpServer, client: Any) -> None:
    client.send(b"ha")
    assert server.receive(9, 0.1) == []
    client.send(b"lf\n")
    assert server.receive(9, SOON) == [Line(1, b"half")]


def test_empty_lines_are_ignored(server: TcpServer, client: Any) -> None:
    client.send(b"\n  \r\nx\n")
    assert heard(server, 1) == [Line(3, b"x")]


@pytest.mark.parametrize("length", [MAX_LINE + 1, 3 * MAX_LINE, 40 * MAX_LINE])
def test_overlong_lines_are_reported_once_and_skipped(
    server: TcpServer, client: Any, length: int
) -> None:
    client.socket.settimeout(0.0)
    waiting = length * b"x" + b"\nnext\n"
    lines: list[Line] = []
    until = time.monotonic() + SOON
    while len(lines) < 2 and time.monotonic() < until:
        with suppress(BlockingIOError):
            waiting = waiting[client.socket.send(waiting) :] if waiting else b""
        lines += server.receive(9, 0.0)
        assert len(server._received) <= 2 * MAX_LINE
    assert lines == [Line(1, None), Line(2, b"next")]


def test_a_line_of_the_greatest_length_is_heard(server: TcpServer, client: Any) -> None:
    client.send(MAX_LINE * b"x" + b"\n")
    assert heard(server, 1) == [Line(1, MAX_LINE * b"x")]


def test_a_second_client_is_sent_away(server: TcpServer, connect: Connect) -> None:
    first = connect()
    server.accept(SOON)
    second = connect()
    server.receive(9, 0.1)  # it ignores clients that are rejected
    assert second.receive() == {"error": "another process is connected", "line": 0}
    assert second.receive() is None
    first.send(b"still here\n")
    assert server.receive(9, SOON) == [Line(1, b"still here")]


def test_a_client_that_goes_away_is_gone_without_its_half_line(
    server: TcpServer, client: Any
) -> None:
    client.send(b"half")
    client.close()
    assert gone(server)


def test_the_last_lines_of_a_client_are_received_after_it_left(
    server: TcpServer, client: Any
) -> None:
    client.send(b"1\n2\n")
    client.close()
    assert server.receive(1, SOON) == [Line(1, b"1")]
    assert heard(server, 1) == [Line(2, b"2")]
    assert gone(server)


def test_another_client_can_come_after_that(server: TcpServer, connect: Connect) -> None:
    connect().close()
    assert server.accept(SOON)
    assert gone(server)
    client = connect()
    assert server.accept(SOON)
    assert server.client_count == 2
    client.send(b"x\n")
    assert server.receive(9, SOON) == [Line(1, b"x")]


def test_unread_output_is_bounded_and_never_awaited(server: TcpServer, connect: Connect) -> None:
    connect()
    server.accept(SOON)
    line = 8191 * b"x" + b"\n"
    while server.send(line):
        pass
    assert len(server._unsent) <= MAX_UNREAD
    assert not server.send(line, now=True)


def test_nothing_is_sent_to_a_disconnected_client(server: TcpServer, client: Any) -> None:
    assert server.send(b"[1]\n")
    assert client.receive() == [1]
    client.close()
    assert gone(server)
    assert not server.send(b"[1]\n")


def test_waiting_ends_with_a_line_or_the_timeout(server: TcpServer, connect: Connect) -> None:
    connect()
    server.accept(SOON)
    begun = time.monotonic()
    assert server.receive(1, 0.1) == []
    assert time.monotonic() - begun >= 0.1


def test_a_port_that_is_taken_is_an_error(server: TcpServer) -> None:
    host, port = server.address
    with pytest.raises(PluginError) as error:
        TcpServer(host, port)
    assert str(error.value) == (
        f"cannot listen on 127.0.0.1:{port}: Address already in use; choose another 'port'"
        " [address-in-use]"
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(st.lists(st.binary(max_size=300), max_size=8))
def test_lines_come_through_however_they_are_cut(
    server: TcpServer, connect: Connect, pieces: list[bytes]
) -> None:
    server.disconnect()
    client = connect()
    assert server.accept(SOON)
    sent = b"".join(pieces) + b"\n"
    for piece in [*pieces, b"\n"]:
        client.send(piece)
        server.accept(0.0)
    expected = [line for line in sent.split(b"\n") if line.strip()]
    assert [line.text for line in heard(server, len(expected))] == expected
    client.close()
    assert gone(server)
