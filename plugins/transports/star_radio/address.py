"""Addresses: links of Crazyflies, and their AI-decks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from star_core import Agent, Problem, Scene

FORMS = (
    "radio://0/80/2M/E7E7E7E701 (dongle, channel, data rate, address), udp://127.0.0.1:19850, "
    "tcp://192.168.4.1:5000 or usb://0"
)
_RADIO = re.compile(
    r"radio://(?P<dongle>[0-9A-Fa-f]+)/(?P<channel>\d{1,3})/(?P<rate>250K|1M|2M)"
    r"(/(?P<address>[0-9A-Fa-f]{1,10}))?(\?rate_limit=(?P<most>[1-9]\d*))?"
)
_LAST_CHANNEL = 125
_FIRST_ADDRESS = "E7E7E7E7E7"
_SERIAL = 10  # minimum number of digits of a dongle's serial


@dataclass(frozen=True, slots=True)
class RadioAddress:
    """Radio address of a Crazyflie.

    Attributes:
        dongle: Number or serial of the Crazyradio; ten digits are a serial, as in cflib.
        channel: 0 to 125, 1 MHz each from 2400 MHz.
        rate: 250K, 1M or 2M.
        address: Ten hexadecimal digits.
        most: Its ``rate_limit``, 1/s, whose inverse is the pause after each exchange; None: none.
    """

    dongle: str
    channel: int
    rate: str
    address: str
    most: int | None = None

    @classmethod
    def of(cls, uri: str) -> RadioAddress | None:
        """Return the components of a radio URI, None if `uri` is not one.

        >>> RadioAddress.of("radio://0/80/2M/E701")
        RadioAddress(dongle='0', channel=80, rate='2M', address='000000E701', most=None)
        """
        match = _RADIO.fullmatch(uri)
        if not match or int(match["channel"]) > _LAST_CHANNEL:
            return None
        address = (match["address"] or _FIRST_ADDRESS).upper().rjust(10, "0")
        dongle = match["dongle"].upper()
        if dongle.isdigit() and len(dongle) < _SERIAL:
            dongle = str(int(dongle))
        most = int(match["most"]) if match["most"] else None
        return cls(dongle, int(match["channel"]), match["rate"], address, most)


def faults(agents: Iterable[Agent]) -> Iterator[Problem]:
    """Yield a problem for each missing, invalid or duplicate address."""
    agent_by_drone: dict[tuple[str | int, ...], Agent] = {}
    for agent in agents:
        if agent.uri is None:
            yield Problem(
                (), f"agent {agent.name!r} has no 'uri': the address of its link", "missing-option"
            )
        elif problem := fault(agent.uri):
            yield Problem((), f"agent {agent.name!r}: {problem}", "invalid-address")
        elif (other := agent_by_drone.setdefault(drone(agent.uri), agent)) is agent:
            pass
        else:
            what = f"have the same uri {agent.uri!r}"
            if other.uri != agent.uri:
                what = f"are the same drone: {other.uri!r} and {agent.uri!r}"
            yield Problem(
                (), f"agents {other.name!r} and {agent.name!r} {what}", "duplicate-address"
            )


def drone(uri: str) -> tuple[str | int, ...]:
    """Return the identity of the drone at a valid address.

    It is channel, data rate and address for a radio, whatever the dongle and its rate limit, and
    host and port for UDP and TCP.

    >>> drone("radio://0/80/2M/e7e7e7e701") == drone("radio://1/80/2M/E7E7E7E701?rate_limit=100")
    True
    >>> drone("udp://LocalHost:19850")
    ('localhost', 19850)
    """
    radio = RadioAddress.of(uri)
    if radio is not None:
        return radio.channel, radio.rate, radio.address
    parts = urlsplit(uri)
    if parts.scheme == "usb":
        return "usb", int(parts.netloc)
    return parts.hostname or "", parts.port or 0


def fault(uri: str) -> str | None:
    """Return what is wrong with a link address, None if nothing is.

    >>> fault("udp://127.0.0.1:19850")
    >>> fault("udp://127.0.0.1")
    "'udp://127.0.0.1' has no port"
    """
    scheme = uri.partition("://")[0]
    if scheme == "radio":
        wrong = RadioAddress.of(uri) is None
    elif scheme == "usb":
        wrong = re.fullmatch(r"usb://\d+", uri) is None
    elif scheme in {"udp", "tcp"}:
        try:
            parts = urlsplit(uri)
            if parts.hostname and parts.port is None:
                return f"{uri!r} has no port"
            wrong = not parts.hostname or not parts.port or bool(parts.path or parts.query)
        except ValueError:
            wrong = True
    else:
        wrong = True
    return f"{uri!r} is not a link address; expected {FORMS}" if wrong else None


PORT: Final = 5000  # of an AI-deck's ESP32
LAST_PORT: Final = 65535


def host_and_port(address: str) -> tuple[str, int]:
    """Return the host and the port of a deck's address.

    >>> host_and_port("192.168.4.1"), host_and_port("192.168.4.1:5001")
    (('192.168.4.1', 5000), ('192.168.4.1', 5001))
    """
    host, _, port = address.partition(":")
    return host.lower(), int(port or PORT)


def camera_faults(scene: Scene, cameras: Mapping[str, str]) -> Iterator[Problem]:
    """Yield a problem for each camera that cannot be read.

    A deck's WiFi serves one client (Bitcraze, aideck-gap8-examples, ``wifi-img-streamer``), so the
    reader of its images cannot share it with a link over TCP or the reader of another agent.
    """
    agents = {agent.name: agent for agent in scene.agents}
    taken = {
        drone(agent.uri): f"is the link of agent {agent.name!r}"
        for agent in scene.agents
        if agent.uri and agent.uri.startswith("tcp://") and fault(agent.uri) is None
    }
    for name, address in cameras.items():
        host, port = where = host_and_port(address)
        if name not in agents:
            yield Problem(("cameras", name), f"no agent is named {name!r}", "unknown-agent")
        elif agents[name].camera is None:
            yield Problem(
                ("cameras", name),
                f"agent {name!r} carries no camera: set its 'camera'",
                "missing-camera",
            )
        elif not 0 < port <= LAST_PORT:
            yield Problem(
                ("cameras", name), f"{address!r} has no port from 1 to {LAST_PORT}", "out-of-range"
            )
        elif where in taken:
            text = f"'{host}:{port}' {taken[where]} already, and a deck serves one client"
            yield Problem(("cameras", name), text, "duplicate-address")
        else:
            taken[where] = f"is the camera of agent {name!r}"
