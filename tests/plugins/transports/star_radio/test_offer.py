"""What a mission may say of the transport, and what the check finds."""

from __future__ import annotations

import dataclasses
from importlib.util import find_spec as real_find_spec
from typing import Any

import pytest

import star_radio
from star_core import Camera, Registry, Scene
from star_core.testing import scene
from star_radio.address import fault
from tests.plugins.transports.star_radio.conftest import options as defaults
from tests.plugins.transports.star_radio.conftest import reached


def found(uris: list[str | None], **options: Any) -> list[str]:
    """Return the errors of agents with these addresses."""
    room = scene(len(uris))
    agents = (
        dataclasses.replace(agent, uri=uri) for agent, uri in zip(room.agents, uris, strict=True)
    )
    room = dataclasses.replace(room, agents=tuple(agents))
    return [problem.message for problem in star_radio.check(room, **defaults(**options))]


def test_it_is_offered_as_one_of_real_time() -> None:
    offer = Registry().find("transport", "radio").offer
    assert offer.realtime


@pytest.mark.parametrize(
    "uri",
    [
        "radio://0/80/2M", "radio://0/80/2M/E7E7E7E701", "radio://1/125/250K/E701?rate_limit=100",
        "radio://5A03B5F1B4/2/1M", "udp://127.0.0.1:19850", "tcp://192.168.4.1:5000",
        "tcp://cf.local:1", "usb://0",
    ],
)  # fmt: skip
def test_addresses_that_cflib_takes_are_taken(uri: str) -> None:
    assert fault(uri) is None


@pytest.mark.parametrize(
    "uri",
    [
        "radio://0/126/2M", "radio://0/80/3M", "radio://0/80/2M/E7E7E7E7E701", "radio:/0/80/2M",
        "udp://:19850", "udp://127.0.0.1:99999", "udp://127.0.0.1:x", "udp://h:1/path", "usb://a",
        "http://127.0.0.1:80", "cf1", "",
    ],
)  # fmt: skip
def test_addresses_of_no_link_are_refused(uri: str) -> None:
    assert f"{uri!r} is not a link address; expected radio://" in (fault(uri) or "")


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("radio://0/80/2M/e7e7e7e701", "radio://0/80/2M/E7E7E7E701"),
        ("radio://0/80/2M/E7E7E7E701", "radio://0/80/2M/E7E7E7E701?rate_limit=100"),
        ("radio://0/80/2M/E7E7E7E701", "radio://1/80/2M/E7E7E7E701"),
        ("radio://0/80/2M", "radio://0/80/2M/E7E7E7E7E7"),
        ("radio://0/80/2M/E701", "radio://0/80/2M/000000E701"),
        ("udp://127.0.0.1:19850", "tcp://127.0.0.1:19850"),
        ("tcp://CF.local:5000", "tcp://cf.local:5000"),
        ("usb://0", "usb://00"),
    ],
)
def test_agents_that_are_one_drone_are_named(one: str, other: str) -> None:
    assert found([one, other]) == [
        f"agents 'cf1' and 'cf2' are the same drone: {one!r} and {other!r}"
    ]


@pytest.mark.parametrize(
    ("uris", "told"),
    [
        (["udp://127.0.0.1:1", None], "agent 'cf2' has no 'uri': the address of its link"),
        (["usb://0", "usb://0"], "agents 'cf1' and 'cf2' have the same uri 'usb://0'"),
        (["udp://127.0.0.1"], "agent 'cf1': 'udp://127.0.0.1' has no port"),
        (
            [f"radio://0/80/2M/{i:02X}" for i in range(9)],
            "dongle '0' is to serve 9 agents with 20 exchanges/s each",
        ),
    ],
)
def test_agents_that_cannot_be_reached_are_named(uris: list[str | None], told: str) -> None:
    [problem] = found(uris)
    assert problem.startswith(told)


@pytest.mark.parametrize("other", ["81/2M/E7E7E7E701", "80/1M/E7E7E7E701", "80/2M/E7E7E7E702"])
def test_agents_that_differ_in_channel_rate_or_address_are_two(other: str) -> None:
    assert found(["radio://0/80/2M/E7E7E7E701", f"radio://0/{other}"]) == []


@pytest.mark.parametrize(
    ("version", "uri", "told"),
    [
        (
            "0.1.34",
            "radio://0/80/2M",
            ["cflib 0.1.34 does not support this mode; remove the option"],
        ),
        ("0.1.35", "radio://0/80/2M", []),
        ("0.1.35b1", "radio://0/80/2M", []),
        ("0.2", "radio://0/80/2M", []),
        ("0.1.34", "udp://127.0.0.1:1", []),
    ],
)
def test_a_mode_that_cflib_does_not_have_is_refused(
    version: str, uri: str, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.metadata.version", lambda _package: version)
    problems = star_radio.check(reached([uri]), **defaults(mode="inline"))
    assert [(p.path, p.message) for p in problems] == [(("mode",), one) for one in told]


CAMERAS = {  # by agent: address, and what is wrong
    "cf9": ("host", "no agent is named 'cf9'"),
    "cf2": ("host", "agent 'cf2' carries no camera: set its 'camera'"),
    "cf1": ("1.2.3.4:99999", "'1.2.3.4:99999' has no port from 1 to 65535"),
    "cf3": ("1.2.3.4:0", "'1.2.3.4:0' has no port from 1 to 65535"),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_that_cannot_be_read_is_named_and_located(name: str) -> None:
    address, told = CAMERAS[name]
    room = reached(["usb://0", "usb://1", "usb://2"])
    one, two, three = room.agents
    agents = (
        dataclasses.replace(one, camera=Camera()),
        two,
        dataclasses.replace(three, camera=Camera()),
    )
    room = dataclasses.replace(room, agents=agents)
    [problem] = star_radio.check(room, **defaults(cameras={name: address}))
    assert problem[:2] == (("cameras", name), told)


def seeing(*uris: str) -> Scene:
    """A scene whose agents have addresses and cameras."""
    room = reached(list(uris))
    agents = tuple(dataclasses.replace(agent, camera=Camera()) for agent in room.agents)
    return dataclasses.replace(room, agents=agents)


@pytest.mark.parametrize("address", ["Deck", "deck:5000"])
def test_a_deck_serves_a_link_or_a_camera(address: str) -> None:
    room = seeing("tcp://deck:5000")
    assert [one[:2] for one in star_radio.check(room, **defaults(cameras={"cf1": address}))] == [
        (
            ("cameras", "cf1"),
            "'deck:5000' is the link of agent 'cf1' already, and a deck serves one client",
        )
    ]


def test_links_and_cameras_at_other_ports_of_a_host_are_served() -> None:
    room = seeing("tcp://127.0.0.1:6000", "udp://127.0.0.1:5001")
    cameras = {"cf1": "127.0.0.1:5000", "cf2": "127.0.0.1:5001"}
    assert list(star_radio.check(room, **defaults(cameras=cameras))) == []


@pytest.mark.parametrize("uri", ["radio://1/80/2M/E701", "radio://01/80/2M/E701"])
def test_a_dongle_that_has_links_does_not_broadcast(uri: str) -> None:
    assert [one[:2] for one in star_radio.check(reached([uri]), **defaults(broadcast=1))] == [
        (("broadcast",), "dongle 1 carries the link of agent 'cf1': expected another")
    ]
    assert list(star_radio.check(reached([uri]), **defaults(broadcast=0))) == []


def test_a_watchdog_needs_a_quick_tick() -> None:
    room = reached(["usb://0"], rate=1.0)
    [problem] = star_radio.check(room, **defaults(watchdog=True))
    assert problem[:2] == (("watchdog",), "it needs a tick of 0.5 s or less, got 1 s")


def test_packages_that_are_not_installed_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(name: str) -> object:
        return None if name in {"cflib", "motioncapture"} else real_find_spec(name)

    monkeypatch.setattr("importlib.util.find_spec", find)
    system = {"source": {"motioncapture": {"type": "vicon", "host": "h"}}}
    assert found(["usb://0"], mocap=system) == [
        "it needs the package 'cflib': pip install 'star-swarm[radio]'",
        "it needs the package 'motioncapture': pip install motioncapture",
    ]
