"""Addresses of AI-deck image streams, and their checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from star_core import Problem, Scene
from star_radio.address import drone, fault

PORT: Final = 5000  # of an AI-deck's ESP32
LAST_PORT: Final = 65535


def host_and_port(address: str) -> tuple[str, int]:
    """Return the host and the port of a deck's address.

    >>> host_and_port("192.168.4.1"), host_and_port("192.168.4.1:5001")
    (('192.168.4.1', 5000), ('192.168.4.1', 5001))
    """
    host, _, port = address.partition(":")
    return host.lower(), int(port or PORT)


def faults(scene: Scene, cameras: Mapping[str, str]) -> Iterator[Problem]:
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
