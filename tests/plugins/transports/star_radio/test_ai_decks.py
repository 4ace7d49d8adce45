"""Images of AI-decks come with the telemetry, in mission time."""

from __future__ import annotations

import dataclasses
import socket
import time
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress

import numpy as np
import pytest

from star_core import Frames, PluginError
from star_core.testing import scene
from star_core.world.camera import Camera
from star_fleet.aideck import AideckServer
from star_radio.camera.ai_decks import AiDecks
from tests.plugins.transports.star_radio.conftest import Open, Peers
from tests.waiting import eventually, free_port

SHAPE = (32, 48)


def test_images_are_gathered_by_row_and_time() -> None:
    room = scene(3)
    camera = Camera(width=SHAPE[1], height=SHAPE[0])
    agents = tuple(dataclasses.replace(agent, camera=camera) for agent in room.agents)
    room = dataclasses.replace(room, agents=agents)
    with ExitStack() as stack:
        servers = [stack.enter_context(AideckServer(port=0)) for _ in range(2)]
        hosts = [f"{host}:{port}" for host, port in (server.address for server in servers)]
        decks = AiDecks(room, {"cf1": hosts[0], "cf3": hosts[1]}, latency=0.1)
        stack.callback(decks.close)
        began = time.monotonic()
        batches: list[Frames] = []
        end = began + 5
        while len({int(row) for frames in batches for row in frames.agent}) < 2:
            assert time.monotonic() < end
            for shade, server in enumerate(servers):
                server.publish(np.full(SHAPE, shade, np.uint8), 0.0)
            time.sleep(0.05)
            if len((frames := decks.frames(began)).agent):
                batches.append(frames)
    for frames in batches:
        shades = [int(image[0, 0]) for image in frames.image]
        assert frames.agent.tolist() == [2 * shade for shade in shades]
        assert (np.diff(frames.arrived) >= 0).all()
        assert (frames.taken < frames.arrived - 0.09).all()
        assert (frames.arrived < 6).all()


SAID = "star_radio.camera.ai_decks"


@pytest.fixture
def free() -> int:
    """A port without a listener."""
    return free_port()


@pytest.fixture
def open_decks(stack: ExitStack) -> Callable[[int], AiDecks]:
    """Read the deck at a port for the first agent, whose images are small."""

    def start(port: int) -> AiDecks:
        room = scene(1)
        camera = Camera(width=SHAPE[1], height=SHAPE[0])
        room = dataclasses.replace(
            room, agents=(dataclasses.replace(room.agents[0], camera=camera),)
        )
        decks = AiDecks(room, {"cf1": f"127.0.0.1:{port}"}, latency=0.1)
        stack.callback(decks.close)
        return decks

    return start


def watched(
    decks: AiDecks,
    caplog: pytest.LogCaptureFixture,
    words: str,
    server: AideckServer | None = None,
    shape: tuple[int, int] = SHAPE,
) -> bool:
    """Take images as ticks do, until something was logged; return whether it was."""

    def logged() -> bool:
        if server is not None:
            server.publish(np.zeros(shape, np.uint8), 0.0)
        decks.frames(0.0)
        return any(words in message for message in caplog.messages)

    return eventually(logged)


def test_missing_decks_are_reported_and_delay_no_agent(
    peers: Peers, connect: Open, caplog: pytest.LogCaptureFixture, free: int
) -> None:
    radio = connect(peers(), cameras={"cf1": f"127.0.0.1:{free}"})
    [told] = [record for record in caplog.records if record.name == SAID]
    assert told.levelname == "WARNING"
    assert told.getMessage() == (
        f"radio: the camera of cf1 is not available: 127.0.0.1:{free}: Connection refused"
    )
    radio.wait(0.0)
    assert len(radio.receive().frames.agent) == 0


def test_a_deck_that_comes_up_while_agents_connect_is_waited_for(
    open_decks: Callable[[int], AiDecks], caplog: pytest.LogCaptureFixture, free: int
) -> None:
    decks = open_decks(free)
    time.sleep(0.3)
    with AideckServer(port=free):
        decks.connect(5.0)
    assert caplog.messages == []


def test_an_agent_that_is_refused_is_not_held_up_by_its_camera(
    make: Open, caplog: pytest.LogCaptureFixture, free: int
) -> None:
    radio = make([f"udp://127.0.0.1:{free}"], cameras={"cf1": f"127.0.0.1:{free}"})
    with pytest.raises(PluginError, match="cannot reach 1 of 1 agents"):
        radio.connect()
    assert [record for record in caplog.records if record.name == SAID] == []


def test_lost_decks_and_their_return_are_reported_once(
    open_decks: Callable[[int], AiDecks], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", SAID)
    server = AideckServer(port=0)
    port = server.address[1]
    decks = open_decks(port)
    decks.connect(5.0)
    server.close()
    lost = f"radio: the camera of cf1 is not available: 127.0.0.1:{port}: "
    assert watched(decks, caplog, lost)
    for _ in range(20):
        decks.frames(0.0)
        time.sleep(0.02)
    assert len(caplog.messages) == 1
    with AideckServer(port=port) as again:
        assert watched(decks, caplog, "radio: the camera of cf1 is back", again)
        decks.frames(0.0)
    assert [record.levelname for record in caplog.records] == ["WARNING", "INFO"]


def test_silent_decks_are_reported_once(
    open_decks: Callable[[int], AiDecks], caplog: pytest.LogCaptureFixture
) -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as listener:
        listener.settimeout(0.05)
        decks = open_decks(listener.getsockname()[1])
        calls, end = 0, time.monotonic() + 10
        while calls < 4 and time.monotonic() < end:
            with suppress(TimeoutError):
                listener.accept()[0].close()
                calls += 1
            decks.frames(0.0)
    assert calls == 4
    assert len(caplog.messages) == 1


def test_a_deck_that_sends_images_of_another_size_is_reported(
    open_decks: Callable[[int], AiDecks], caplog: pytest.LogCaptureFixture
) -> None:
    other = (SHAPE[0], SHAPE[1] + 2)
    with AideckServer(port=0) as server:
        decks = open_decks(server.address[1])
        decks.connect(5.0)
        assert watched(decks, caplog, "it sends", server, other)
    [told] = caplog.messages
    assert told == (
        "radio: the camera of cf1 is not available: it sends images that are not 48 x 32 px"
    )
