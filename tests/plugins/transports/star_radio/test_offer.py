"""What a mission may say of the transport, and what the check finds."""

from __future__ import annotations

import dataclasses
from importlib.util import find_spec as real_find_spec
from typing import Any

import jsonschema
import pytest

import star_radio
from star_core import Registry
from star_core.testing import scene
from star_radio.address import RadioAddress, fault
from star_radio.options import OPTIONS
from tests.plugins.transports.star_radio.conftest import reached


def found(uris: list[str | None], **options: Any) -> list[str]:
    """Return what the check says of agents with these addresses."""
    room = scene(len(uris))
    agents = (
        dataclasses.replace(agent, uri=uri) for agent, uri in zip(room.agents, uris, strict=True)
    )
    room = dataclasses.replace(room, agents=tuple(agents))
    return [problem.message for problem in star_radio.check(room, **options)]


def test_it_is_offered_as_one_of_real_time() -> None:
    offer = Registry().find("transport", "radio").offer
    assert offer.realtime


def test_every_option_has_a_default_that_its_own_schema_allows() -> None:
    for name, schema in OPTIONS["properties"].items():
        assert schema["description"], name
        jsonschema.validate(schema["default"], schema)


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
    assert f"{uri!r} is no address of a link; expected radio://" in (fault(uri) or "")


def test_a_short_address_is_filled_up() -> None:
    found = RadioAddress.of("radio://0/80/2M/e701")
    assert found is not None
    assert found.address == "000000E701"


def test_agents_without_addresses_are_named() -> None:
    assert found(["udp://127.0.0.1:1", None]) == [
        "agent 'cf2' has no 'uri': the address of its link"
    ]


def test_agents_that_share_an_address_are_named() -> None:
    assert found(["usb://0", "usb://0"]) == ["agents 'cf1' and 'cf2' have the same uri 'usb://0'"]


def test_a_wrong_address_is_named() -> None:
    [told] = found(["udp://127.0.0.1"])
    assert told == "agent 'cf1': 'udp://127.0.0.1' has no port"


def test_an_overload_is_told() -> None:
    [told] = found([f"radio://0/80/2M/{i:02X}" for i in range(9)])
    assert told.startswith("dongle '0' is to serve 9 agents")


def test_cameras_of_nobody_are_named() -> None:
    assert found(["usb://0"], cameras={"cf9": "host"}) == ["no agent is named 'cf9'"]


def test_a_watchdog_needs_a_quick_tick() -> None:
    room = reached(["usb://0"], rate=1.0)
    [problem] = star_radio.check(room, watchdog=True)
    assert problem == (("watchdog",), "it needs a tick of 0.5 s or less, got 1 s")


def test_packages_that_are_not_installed_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(name: str) -> object:
        return None if name in {"cflib", "motioncapture"} else real_find_spec(name)

    monkeypatch.setattr("importlib.util.find_spec", find)
    assert found(["usb://0"], mocap={"type": "vicon", "hostname": "h"}) == [
        "it needs the package 'cflib': pip install 'star-swarm[radio]'",
        "it needs the package 'motioncapture': pip install motioncapture",
    ]
