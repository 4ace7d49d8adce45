"""Images of AI-decks come with the telemetry, in mission time."""

from __future__ import annotations

import dataclasses
import time
from contextlib import ExitStack

import numpy as np

from star_core import Frames
from star_core.camera import Camera
from star_core.testing import scene
from star_radio.decks import Decks
from star_sim.fleet.aideck.server import AideckServer
from tests.plugins.transports.star_radio.conftest import Open, Peers

SHAPE = (32, 48)


def test_images_are_gathered_by_row_and_time() -> None:
    room = scene(3)
    camera = Camera(width=SHAPE[1], height=SHAPE[0])
    agents = tuple(dataclasses.replace(agent, camera=camera) for agent in room.agents)
    room = dataclasses.replace(room, agents=agents)
    with ExitStack() as stack:
        servers = [stack.enter_context(AideckServer(port=0, shape=SHAPE)) for _ in range(2)]
        hosts = [f"{host}:{port}" for host, port in (server.address for server in servers)]
        decks = Decks(room, {"cf1": hosts[0], "cf3": hosts[1]}, latency=0.1)
        stack.callback(decks.close)
        began = time.monotonic()
        found: list[Frames] = []
        end = began + 5
        while len({int(row) for frames in found for row in frames.agent}) < 2:
            assert time.monotonic() < end
            for shade, server in enumerate(servers):
                server.publish(np.full(SHAPE, shade, np.uint8), 0.0)
            time.sleep(0.05)
            if len((frames := decks.frames(began)).agent):
                found.append(frames)
    for frames in found:
        shades = [int(image[0, 0]) for image in frames.image]
        assert frames.agent.tolist() == [2 * shade for shade in shades]
        assert (np.diff(frames.arrived) >= 0).all()
        assert (frames.taken < frames.arrived - 0.09).all()
        assert (frames.arrived < 6).all()


def test_a_deck_that_is_not_there_holds_up_nobody(peers: Peers, connect: Open) -> None:
    radio = connect(peers(), cameras={"cf1": "127.0.0.1:9"})
    radio.wait(0.0)
    assert len(radio.receive().frames.agent) == 0
