"""The decks of simulated Crazyflies stream what their cameras see, and carry their links."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import Agent, Camera, Fence, Image, Scene, World
from star_fleet.aideck import Wifi
from star_fleet.server import Fleet
from star_radio.camera.ai_decks import CameraClient
from star_sim.camera_sim.options import camera_options
from tests.plugins.commands.star_fleet.conftest import place
from tests.simulators import ideal_fleet
from tests.waiting import eventually


def scene() -> Scene:
    world = World("lab", Fence((-2, -2, 0), (2, 2, 2)))
    return Scene((Agent("cf0", (0.0, 0.0, 0.0), camera=Camera()),), 0.05, world, realtime=True)


@pytest.fixture
def fleet() -> Iterator[Fleet]:
    with ideal_fleet(scene(), camera=camera_options()) as fleet:
        yield fleet


@pytest.mark.parametrize("jpeg", [False, True])
def test_what_a_simulated_camera_sees_arrives(fleet: Fleet, *, jpeg: bool) -> None:
    published: list[Image] = []
    fleet.watch(0, lambda image, _taken: published.append(image), lambda: True)
    wifi = Wifi(fleet, scene(), "127.0.0.1", links=None, cameras=0, jpeg=jpeg)
    with contextlib.closing(wifi), CameraClient(*place(wifi.cameras[0])) as client:
        assert eventually(lambda: client.counts.images >= 2, within=30.0)
        shots = client.arrived()
    off = [np.abs(shots[0].image.astype(int) - image).mean() for image in list(published)]
    assert 0 < min(off) < 5 if jpeg else min(off) == 0  # grey values: JPEG keeps them nearly


@pytest.mark.usefixtures("capfd")  # cflib prints
def test_cflib_connects_over_tcp(fleet: Fleet, tmp_path: Path) -> None:
    crazyflie: Any = pytest.importorskip("cflib.crazyflie")
    crtp = pytest.importorskip("cflib.crtp")
    crtp.init_drivers()
    wifi = Wifi(fleet, scene(), "127.0.0.1", links=0, cameras=None)
    with contextlib.closing(wifi):
        cf = crazyflie.Crazyflie(rw_cache=str(tmp_path))
        connected: list[str] = []
        console: list[str] = []
        cf.fully_connected.add_callback(connected.append)
        cf.console.receivedChar.add_callback(console.append)
        cf.open_link(wifi.links[0])
        assert eventually(lambda: connected, within=30.0)
        assert eventually(lambda: "up and running" in "".join(console))  # is not asked for
        router = cf.link.cpx._router
        cf.close_link()
        router.join(5)
    assert len(connected) == 1
