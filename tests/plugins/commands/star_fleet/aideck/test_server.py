"""A simulated deck streams as a deck does, and waits for no client."""

from __future__ import annotations

import socket
import threading

import numpy as np
import pytest

from star_core import Image, PluginError
from star_fleet.aideck import AideckServer, framed
from star_fleet.cpx import Switchboard
from star_radio.camera.stream import Counts, Stream
from tests.plugins.commands.star_fleet.conftest import received
from tests.waiting import eventually

SHAPE = (244, 324)
BLANK = np.zeros(SHAPE, np.uint8)


@pytest.mark.parametrize("jpeg", [False, True])
def test_a_client_gets_the_image_and_nothing_else(*, jpeg: bool, picture: Image) -> None:
    with (
        AideckServer(port=0, jpeg=jpeg) as server,
        socket.create_connection(server.address, 5) as client,
    ):
        assert eventually(lambda: server.connected)
        server.publish(picture, 0.0)
        whole = framed(picture, jpeg=jpeg)
        assert received(client, len(whole)) == whole
    assert server.dropped == 0


def test_slow_clients_miss_whole_images_and_block_nothing() -> None:
    counts = Counts()
    stream = Stream(SHAPE, counts)
    with AideckServer(port=0) as server, socket.create_connection(server.address, 5) as client:
        assert eventually(lambda: server.connected)
        for value in range(200):
            server.publish(BLANK + np.uint8(value), 0.0)  # would not return if it waited
        assert server.dropped > 0
        values: list[int] = []
        client.settimeout(5)
        while 199 not in values:
            values += [int(a.image[0, 0]) for a in stream.feed(client.recv(65_536), 0.0)]
    assert values == sorted(set(values))
    assert len(values) == 200 - server.dropped
    assert (counts.broken, counts.malformed) == (0, 0)


def test_images_without_a_client_are_lost_and_not_counted() -> None:
    with AideckServer(port=0) as server:
        server.publish(BLANK, 0.0)
        assert server.dropped == 0


def test_another_client_is_served_when_the_first_has_gone(picture: Image) -> None:
    whole = framed(picture)
    with AideckServer(port=0) as server:
        for _ in range(3):
            with socket.create_connection(server.address, 5) as client:
                assert eventually(lambda: server.connected)
                server.publish(picture, 0.0)
                assert received(client, len(whole)) == whole
            assert eventually(lambda: not server.connected)


def test_a_second_client_waits_for_the_first_to_go() -> None:
    with AideckServer(port=0) as server:
        first = socket.create_connection(server.address, 5)
        assert eventually(lambda: server.connected)
        with socket.create_connection(server.address, 5) as second:
            server.publish(BLANK, 0.0)
            second.settimeout(0.1)
            with pytest.raises(TimeoutError):
                second.recv(1)
            first.close()
            second.settimeout(None)
            thread = threading.Thread(target=second.recv, args=(1,), daemon=True)
            thread.start()

            def served() -> bool:
                server.publish(BLANK, 0.0)
                return not thread.is_alive()

            assert eventually(served)


def test_disconnects_within_an_image_leave_the_next_image_whole(picture: Image) -> None:
    with AideckServer(port=0) as server:
        with socket.create_connection(server.address, 5) as client:
            assert eventually(lambda: server.connected)
            for _ in range(60):
                server.publish(BLANK, 0.0)
            received(client, 5000)
        assert eventually(lambda: not server.connected)
        with socket.create_connection(server.address, 5) as client:
            assert eventually(lambda: server.connected)
            server.publish(picture, 0.0)
            assert received(client, 15) == framed(picture)[:15]


def test_thirty_decks_share_one_thread(switchboard: Switchboard, picture: Image) -> None:
    before = threading.active_count()
    servers = [AideckServer(port=0, switchboard=switchboard) for _ in range(30)]
    clients = [socket.create_connection(server.address, 5) for server in servers]
    assert eventually(lambda: all(server.connected for server in servers))
    assert threading.active_count() == before
    whole = framed(picture)
    for server, client in zip(servers, clients, strict=True):
        server.publish(picture, 0.0)
        assert received(client, len(whole)) == whole
    for client in clients:
        client.close()
    for server in servers:
        server.close()


def test_a_port_is_free_again_when_its_deck_is_closed(switchboard: Switchboard) -> None:
    server = AideckServer(port=0, switchboard=switchboard)
    server.close()
    server.close()
    AideckServer(port=server.address[1], switchboard=switchboard).close()


def test_closing_a_deck_ends_its_own_thread() -> None:
    before = threading.active_count()
    AideckServer(port=0).close()
    assert threading.active_count() == before


@pytest.mark.parametrize("shared", [True, False])
def test_a_port_that_is_taken_is_named(*, shared: bool, switchboard: Switchboard) -> None:
    before = threading.active_count()
    with AideckServer(port=0, switchboard=switchboard) as server:
        port = server.address[1]
        message = rf"^cannot listen on 127\.0\.0\.1:{port}: .*in use"
        with pytest.raises(PluginError, match=message):
            AideckServer(port=port, switchboard=switchboard if shared else None)
    assert threading.active_count() == before
