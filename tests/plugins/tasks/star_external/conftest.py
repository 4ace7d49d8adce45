"""A client and a planner of the verb ``external``, and steps of it with a server of their own."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pytest

import star_external
from star_core import Registry, Scene, TaskSpec, hookimpl
from star_core.discovery import Source
from star_core.testing import scene
from star_core.toolkit import fill_defaults
from star_external.external import External
from star_external.planner import ExternalPlannerSpec
from star_external.process_source import ProcessSource
from star_external.spec import PROCESS_OPTIONS
from star_external.tcp_server import TcpServer

SOON = 5.0  # s, by which what was sent over the loopback has arrived


class Client:
    """The other process."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.socket = socket.create_connection(address, timeout=SOON)
        self._lines = self.socket.makefile("rb")

    def send(self, *lines: Any) -> None:
        """Send lines: bytes as they are, anything else as JSON."""
        for value in lines:
            line = value if isinstance(value, bytes) else json.dumps(value).encode() + b"\n"
            self.socket.sendall(line)

    def receive(self) -> Any:
        """Return the next line, or None if there is none any more."""
        line = self._lines.readline()
        return json.loads(line) if line else None

    def close(self) -> None:
        self._lines.close()
        self.socket.close()


@pytest.fixture
def server() -> Iterator[TcpServer]:
    made = TcpServer("127.0.0.1", 0)
    yield made
    made.close()


@pytest.fixture
def connect(server: TcpServer) -> Iterator[Callable[[], Client]]:
    """Connect to the server."""
    made: list[Client] = []

    def connected() -> Client:
        made.append(Client(server.address))
        return made[-1]

    yield connected
    for client in made:
        client.close()


@pytest.fixture
def room() -> Scene:
    return scene(3)


@pytest.fixture
def external(server: TcpServer, room: Scene) -> Callable[..., External]:
    """Make the task of the first two of three agents, with these options."""

    def made(scene: Scene = room, **options: Any) -> External:
        filled = fill_defaults({"rate": None, **options}, {"properties": PROCESS_OPTIONS})
        arguments = {key: value for key, value in filled.items() if key not in {"port", "listen"}}
        return External(scene, (0, 1), ProcessSource(scene, server, **arguments))

    return made


class Offering:
    """A plugin that offers an external planner."""

    def __init__(self, make: Callable[..., object], name: str = "theirs") -> None:
        planner: Any = make
        self._spec = ExternalPlannerSpec(name=name, summary="Plans.", make=planner)

    @hookimpl
    def star_external_planners(self) -> Iterable[ExternalPlannerSpec]:
        yield self._spec


def offered(**planners: Callable[..., object]) -> TaskSpec:
    """Return the verb where these planners are installed, each by a distribution of its own."""
    registry = Registry(star_external, installed=False)
    for name, make in planners.items():
        plugin = Offering(make, name.removeprefix("their_"))
        registry.add(plugin, Source(f"{name.replace('_', '-')}-dist:{name}", "1.0"))
    spec: TaskSpec = registry.find("task", "external").offer
    return spec
