"""What a mission may say of the transport, and what the check finds."""

from __future__ import annotations

import dataclasses
from importlib.util import find_spec as real_find_spec
from typing import Any

import pytest

import star_radio
from star_core import Camera, Registry
from star_core.testing import scene
from star_radio.address import fault
from tests.plugins.transports.star_radio.conftest import options as defaults
from tests.plugins.transports.star_radio.conftest import reached


def errors(uris: list[str | None], **options: Any) -> list[str]:
    """Return the errors of agents with these addresses."""
    room = scene(len(uris))
    agents = (
        dataclasses.replace(agent, uri=uri) for agent, uri in zip(room.agents, uris, strict=True)
    )
    room = dataclasses.replace(room, agents=tuple(agents))
    return [problem.message for problem in star_radio.check(room, **defaults(**options))]


def test_it_is_offered_as_one_of_real_time() -> None:
    assert Registry().find("transport", "radio").offer.realtime


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
    ("uri", "other"),
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
def test_agents_that_are_one_drone_are_named(uri: str, other: str) -> None:
    assert errors([uri, other]) == [
        f"agents 'cf1' and 'cf2' are the same drone: {uri!r} and {other!r}"
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
    [problem] = errors(uris)
    assert problem.startswith(told)


@pytest.mark.parametrize("other", ["81/2M/E7E7E7E701", "80/1M/E7E7E7E701", "80/2M/E7E7E7E702"])
def test_agents_that_differ_in_channel_rate_or_address_are_two(other: str) -> None:
    assert errors(["radio://0/80/2M/E7E7E7E701", f"radio://0/{other}"]) == []


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
    assert [(p.path, p.message) for p in problems] == [(("mode",), message) for message in told]


USB = ["usb://0", "usb://1", "usb://2"]


@pytest.mark.parametrize(
    ("uris", "options", "path", "code"),
    [
        (USB, {"cameras": {"cf9": "host"}}, ("cameras", "cf9"), "unknown-agent"),
        (USB, {"cameras": {"cf2": "host"}}, ("cameras", "cf2"), "missing-camera"),
        (USB, {"cameras": {"cf1": "1.2.3.4:99999"}}, ("cameras", "cf1"), "out-of-range"),
        (USB, {"cameras": {"cf3": "1.2.3.4:0"}}, ("cameras", "cf3"), "out-of-range"),
        (
            USB,
            {"cameras": {"cf1": "deck", "cf3": "deck:5000"}},
            ("cameras", "cf3"),
            "duplicate-address",
        ),
        (
            ["tcp://deck:5000"],
            {"cameras": {"cf1": "Deck"}},
            ("cameras", "cf1"),
            "duplicate-address",
        ),
        (["radio://1/80/2M/E701"], {"broadcast": 1}, ("broadcast",), "option-conflict"),
        (["radio://01/80/2M/E701"], {"broadcast": 1}, ("broadcast",), "option-conflict"),
        (["radio://1/80/2M/E701"], {"broadcast": 0}, None, ""),
        (["tcp://127.0.0.1:6000"], {"cameras": {"cf1": "127.0.0.1:5000"}}, None, ""),
        (["udp://127.0.0.1:5001"], {"cameras": {"cf1": "127.0.0.1:5001"}}, None, ""),
        (["usb://0"], {"watchdog": True}, ("watchdog",), "out-of-range"),
    ],
)
def test_options_that_cannot_be_used_are_located(
    uris: list[str], options: dict[str, Any], path: tuple[str, ...] | None, code: str
) -> None:
    room = reached(uris, rate=1.0 if "watchdog" in options else 20.0)
    agents = tuple(
        dataclasses.replace(agent, camera=None if agent.name == "cf2" else Camera())
        for agent in room.agents
    )
    room = dataclasses.replace(room, agents=agents)
    problems = list(star_radio.check(room, **defaults(**options)))
    assert [(problem.path, problem.code) for problem in problems] == (
        [(path, code)] if path else []
    )


def test_packages_that_are_not_installed_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(name: str) -> object:
        return None if name in {"cflib", "motioncapture"} else real_find_spec(name)

    monkeypatch.setattr("importlib.util.find_spec", find)
    system = {"source": {"motioncapture": {"type": "vicon", "host": "h"}}}
    assert errors(["usb://0"], mocap=system) == [
        "it needs the package 'cflib': pip install 'star-swarm[radio]'",
        "it needs the package 'motioncapture': pip install motioncapture",
    ]
