"""Links and cameras over TCP."""

from __future__ import annotations

import socket
from dataclasses import replace
from typing import Any

import pytest

from star_core import Camera, Image, PluginError, Scene
from star_core.testing import scene
from star_fleet.aideck import Wifi
from star_sim.camera_sim.options import camera_options
from star_sim.camera_sim.renderer import Renderer
from tests.plugins.commands.star_fleet.conftest import place
from tests.simulators import ideal_fleet
from tests.waiting import eventually


def eyes() -> Scene:
    room = scene(2)
    first, second = room.agents
    return replace(room, agents=(first, replace(second, camera=Camera())))


def test_a_port_that_is_taken_leaves_nothing_open() -> None:
    with ideal_fleet(scene(2)) as fleet, socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(PluginError):
            Wifi(fleet, eyes(), "127.0.0.1", links=0, cameras=port)
        with pytest.raises(PluginError):
            Wifi(fleet, eyes(), "127.0.0.1", links=port, cameras=0)
        assert not fleet._watchers


def test_an_image_is_sent_in_the_cycle_in_which_it_arrives() -> None:
    fleet = ideal_fleet(eyes(), camera=camera_options(latency=0.1, latency_std=0.0))
    late: list[float] = []
    fleet.watch(1, lambda _image, taken: late.append(fleet.time - taken), lambda: True)
    for _ in range(100):
        fleet.advance()
    fleet.close()
    assert len(late) > 4
    assert 0.1 - 1e-9 <= min(late) <= max(late) < 0.11


def test_no_image_is_made_without_a_client(monkeypatch: pytest.MonkeyPatch) -> None:
    fleet = ideal_fleet(eyes(), camera=camera_options())
    made: list[float] = []
    render = Renderer.render

    def noted(*arguments: Any) -> Image:
        made.append(fleet.time)
        return render(*arguments)

    monkeypatch.setattr(Renderer, "render", noted)
    wifi = Wifi(fleet, eyes(), "127.0.0.1", links=None, cameras=0)
    assert list(wifi.cameras) == [1]
    clients = []

    def fly(cycles: int) -> int:
        before = len(made)
        for _ in range(cycles):
            fleet.advance()
        clients.append(fleet.watched(1))
        return len(made) - before

    assert fly(100) == 0
    with socket.create_connection(place(wifi.cameras[1]), timeout=10):
        assert eventually(lambda: fleet.watched(1))
        assert fly(100) >= 9
    assert eventually(lambda: not fleet.watched(1))
    assert fly(100) == 0
    assert clients == [False, True, False]
    wifi.close()
    fleet.close()


def test_a_client_that_connects_later_gets_no_earlier_image() -> None:
    fleet = ideal_fleet(eyes(), camera=camera_options(latency=0.1, latency_std=0.0))
    watching = True
    late: list[float] = []
    fleet.watch(1, lambda _image, taken: late.append(fleet.time - taken), lambda: watching)
    while not late:
        fleet.advance()
    watching = False  # with an image on its way
    for _ in range(20):
        fleet.advance()
    watching = True
    for _ in range(60):
        fleet.advance()
    fleet.close()
    assert len(late) > 3
    assert max(late) < 0.11
