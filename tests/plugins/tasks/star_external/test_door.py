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
from star_external.door import LONGEST, UNREAD, Door, Line

SOON = 5.0  # s

Connect = Callable[[], Any]


def heard(door: Door, many: int) -> list[Line]:
    """The next lines, however many calls they take."""
    lines: list[Line] = []
    until = time.monotonic() + SOON
    while len(lines) < many and time.monotonic() < until:
        lines += door.hear(many - len(lines), 0.2)
    return lines


def gone(door: Door) -> bool:
    """Whether it is seen that the client has gone."""
    until = time.monotonic() + SOON
    while door.connected and time.monotonic() < until:
        door.hear(9, 0.05)
    return not door.connected


def test_nobody_is_there_at_first(door: Door) -> None:
    assert not door.meet(0.0)
    assert door.hear(9, 0.0) == []


def test_a_client_is_let_in(door: Door, connect: Connect) -> None:
    connect()
    assert door.meet(SOON)
    assert door.visitor == 1


def test_lines_are_heard_with_their_numbers(door: Door, connect: Connect) -> None:
    client = connect()
    door.meet(SOON)
    client.send(b"one\ntwo\r\n")
    assert heard(door, 2) == [Line(1, b"one"), Line(2, b"two\r")]


def test_no_more_lines_are_heard_than_asked_for(door: Door, connect: Connect) -> None:
    client = connect()
    door.meet(SOON)
    client.send(b"1\n2\n3\n")
    assert door.hear(1, SOON) == [Line(1, b"1")]
    assert heard(door, 2) == [Line(2, b"2"), Line(3, b"3")]


def test_half_a_line_waits_for_the_other_half(door: Door, connect: Connect) -> None:
    client = connect()
    door.meet(SOON)
    client.send(b"ha")
    assert door.hear(9, 0.1) == []
    client.send(b"lf\n")
    assert door.hear(9, SOON) == [Line(1, b"half")]


def test_empty_lines_say_nothing(door: Door, connect: Connect) -> None:
    client = connect()
    door.meet(SOON)
    client.send(b"\n  \r\nx\n")
    assert heard(door, 1) == [Line(3, b"x")]


@pytest.mark.parametrize("length", [LONGEST + 1, 3 * LONGEST, 40 * LONGEST])
def test_a_line_that_is_too_long_is_told_once_and_the_next_is_heard(
    door: Door, connect: Connect, length: int
) -> None:
    client = connect()
    door.meet(SOON)
    client.socket.settimeout(0.0)
    waiting = length * b"x" + b"\nnext\n"
    lines: list[Line] = []
    until = time.monotonic() + SOON
    while len(lines) < 2 and time.monotonic() < until:
        with suppress(BlockingIOError):
            waiting = waiting[client.socket.send(waiting) :] if waiting else b""
        lines += door.hear(9, 0.0)
        assert len(door._unheard) <= 2 * LONGEST
    assert lines == [Line(1, None), Line(2, b"next")]


def test_a_line_of_the_greatest_length_is_heard(door: Door, connect: Connect) -> None:
    client = connect()
    door.meet(SOON)
    client.send(LONGEST * b"x" + b"\n")
    assert heard(door, 1) == [Line(1, LONGEST * b"x")]


def test_a_second_client_is_sent_away(door: Door, connect: Connect) -> None:
    first = connect()
    door.meet(SOON)
    second = connect()
    door.hear(9, 0.1)  # it takes no notice of whoever is sent away
    assert second.hear() == {"error": "another process is connected", "line": 0}
    assert second.hear() is None
    first.send(b"still here\n")
    assert door.hear(9, SOON) == [Line(1, b"still here")]


def test_a_client_that_goes_away_is_gone_without_its_half_line(
    door: Door, connect: Connect
) -> None:
    client = connect()
    door.meet(SOON)
    client.send(b"half")
    client.close()
    assert gone(door)


def test_what_a_client_said_last_is_heard_after_it_has_gone(door: Door, connect: Connect) -> None:
    client = connect()
    door.meet(SOON)
    client.send(b"1\n2\n")
    client.close()
    assert door.hear(1, SOON) == [Line(1, b"1")]
    assert heard(door, 1) == [Line(2, b"2")]
    assert gone(door)


def test_another_client_can_come_after_that(door: Door, connect: Connect) -> None:
    connect().close()
    assert door.meet(SOON)
    assert gone(door)
    client = connect()
    assert door.meet(SOON)
    assert door.visitor == 2
    client.send(b"x\n")
    assert door.hear(9, SOON) == [Line(1, b"x")]


def test_a_client_is_told_lines(door: Door, connect: Connect) -> None:
    client = connect()
    door.meet(SOON)
    assert door.say(b"[1]\n")
    assert client.hear() == [1]


def test_what_a_client_does_not_read_is_bounded_and_never_waited_for(
    door: Door, connect: Connect
) -> None:
    connect()
    door.meet(SOON)
    line = 8191 * b"x" + b"\n"
    while door.say(line):
        pass
    assert len(door._unsent) <= UNREAD
    assert not door.say(line, now=True)


def test_to_a_client_that_has_gone_nothing_is_said(door: Door, connect: Connect) -> None:
    client = connect()
    door.meet(SOON)
    client.close()
    assert gone(door)
    assert not door.say(b"[1]\n")


def test_waiting_ends_when_a_line_comes_or_the_time_is_over(door: Door, connect: Connect) -> None:
    connect()
    door.meet(SOON)
    begun = time.monotonic()
    assert door.hear(1, 0.1) == []
    assert time.monotonic() - begun >= 0.1


def test_a_port_that_is_taken_is_an_error(door: Door) -> None:
    host, port = door.address
    with pytest.raises(PluginError) as error:
        Door(host, port)
    assert str(error.value) == (
        f"cannot listen on 127.0.0.1:{port}: Address already in use; choose another 'port'"
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(st.lists(st.binary(max_size=300), max_size=8))
def test_lines_come_through_however_they_are_cut(
    door: Door, connect: Connect, pieces: list[bytes]
) -> None:
    door.hang_up()
    client = connect()
    assert door.meet(SOON)
    sent = b"".join(pieces) + b"\n"
    for piece in [*pieces, b"\n"]:
        client.send(piece)
        door.meet(0.0)
    expected = [line for line in sent.split(b"\n") if line.strip()]
    assert [line.text for line in heard(door, len(expected))] == expected
    client.close()
    assert gone(door)
