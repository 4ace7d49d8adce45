"""A camera is read whatever its deck does, and delays nothing."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing, suppress

import numpy as np
import pytest

from star_fleet.aideck import AideckServer
from star_radio.camera import ai_decks
from star_radio.camera.ai_decks import CameraClient
from star_radio.camera.stream import Counts
from tests.waiting import eventually

SHAPE = (244, 324)
BLANK = np.zeros(SHAPE, np.uint8)


@pytest.fixture
def server() -> Iterator[AideckServer]:
    with AideckServer(port=0) as server:
        yield server


def test_images_that_are_not_read_are_dropped_oldest_first(
    server: AideckServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ai_decks, "MAX_WAITING", 3)
    with CameraClient(*server.address) as client:
        assert eventually(lambda: server.connected)
        for value in range(5):
            server.publish(BLANK + np.uint8(value), 0.0)
            assert eventually(lambda count=value + 1: client.counts.images == count)
        assert [int(shot.image[0, 0]) for shot in client.arrived()] == [2, 3, 4]
        assert client.counts.dropped == 2


@pytest.mark.parametrize(("host", "port"), [("127.0.0.1", 70_000), ("a" * 64 + ".b", 5000)])
def test_an_address_that_there_cannot_be_is_a_fault_like_another(host: str, port: int) -> None:
    with CameraClient(host, port) as client:
        assert eventually(lambda: client.fault != f"{host}:{port}: not connected yet")
        assert client._thread.is_alive()


def test_a_deck_that_falls_silent_is_called_anew(
    server: AideckServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ai_decks, "SILENCE_TIMEOUT", 0.3)
    with CameraClient(*server.address) as client:
        assert eventually(lambda: client.counts.connections >= 2)


def test_reconnections_to_a_deck_that_hangs_up_are_paused() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as listener:
        listener.settimeout(0.05)
        stop = threading.Event()

        def refuse() -> None:
            while not stop.is_set():
                with suppress(TimeoutError):
                    listener.accept()[0].close()

        thread = threading.Thread(target=refuse)
        thread.start()
        with CameraClient(*listener.getsockname()[:2]) as client:
            time.sleep(1.0)
            assert 1 <= client.counts.connections <= 6
        stop.set()
        thread.join()


def test_closing_ends_the_thread(server: AideckServer) -> None:
    client = CameraClient(*server.address)
    assert client._thread.is_alive()
    client.close()
    client.close()
    assert not client._thread.is_alive()


def test_counts_are_a_copy(server: AideckServer) -> None:
    with CameraClient(*server.address) as client:
        assert client.reached(5.0)
        client.counts.images = 7
        assert client.counts == Counts(connections=1)
