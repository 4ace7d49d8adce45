"""``star camera`` shows what a simulated AI-deck streams, on its own page only."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from star_core import Image, InputError, Registry
from star_fleet.aideck import AideckServer
from star_radio.camera.ai_decks import CameraClient
from star_radio.camera_command import Preview, Server, serve, source
from tests.waiting import eventually

MISSION = """\
star: 1
name: aim
world: room.yaml
swarm: {cf1: {start: [0, 0, 0], camera: aideck, uri: "radio://0/80/2M/E7E7E7E701"}}
transport: {use: radio, cameras: {cf1: "192.168.4.1:5001"}}
localizer: flow
planner: straight
avoider: none
mission: [hold: {for: 1}]
"""


def with_tag() -> Image:
    """An image of tag 7."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    image = np.full((244, 324), 200, np.uint8)
    image[60:140, 90:170] = family.generateImageMarker(7, 80)
    return image


@pytest.fixture
def deck() -> Iterator[AideckServer]:
    with AideckServer(port=0) as deck:
        yield deck


@pytest.fixture
def server(deck: AideckServer) -> Iterator[Server]:
    with CameraClient(*deck.address) as client, serve(Preview(client), 0) as server:
        assert eventually(lambda: deck.connected)
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        yield server
        server.shutdown()


def get(server: Server, path: str, **headers: str) -> http.client.HTTPResponse:
    with closing(http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=5)) as link:
        link.request("GET", path, headers=headers)
        response = link.getresponse()
        response.body = response.read()  # type: ignore[attr-defined]
        return response


def test_the_page_shows_the_newest_image_with_its_tags(deck: AideckServer, server: Server) -> None:
    token = f"/{server.token}/"
    page = get(server, token)
    assert (page.status, b"picture" in page.body) == (200, True)  # type: ignore[attr-defined]
    assert get(server, f"{token}picture").status == 404
    deck.publish(with_tag(), 0.0)
    assert eventually(lambda: get(server, f"{token}picture?1").status == 200)
    body = get(server, f"{token}picture").body  # type: ignore[attr-defined]
    shown = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    blue, green, red = shown.astype(int).transpose(2, 0, 1)
    v, u = np.nonzero((green > 150) & (red < 100) & (blue < 150))
    assert (u.min(), v.min()) == pytest.approx((3 * 90, 3 * 60), abs=4)


def test_the_detected_tag_has_its_number_and_corners(deck: AideckServer) -> None:
    with CameraClient(*deck.address) as client:
        tags = Preview(client).tags(with_tag())
    assert tags.tag.tolist() == [7]
    expected = np.array([[90, 139], [169, 139], [169, 60], [90, 60]])
    assert tags.corners[0] == pytest.approx(expected, abs=1.5)


def test_a_name_is_looked_up_in_the_mission(tmp_path: Path) -> None:
    world = "star: 1\nname: room\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n"
    (tmp_path / "room.yaml").write_text(world)
    mission = tmp_path / "aim.yaml"
    mission.write_text(MISSION)
    address, camera = source("cf1", str(mission), Registry())
    assert address == "192.168.4.1:5001"
    assert camera is not None
    with pytest.raises(InputError, match=r"transport\.cameras has no 'cf2'"):
        source("cf2", str(mission), Registry())


def test_what_is_no_address_is_an_error() -> None:
    with pytest.raises(InputError, match=r"expected host\[:port\]"):
        source("http://x/", None, Registry())
    assert source("192.168.4.1", None, Registry()) == ("192.168.4.1", None)
