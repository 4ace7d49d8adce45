"""A client of the verb ``external``, and steps of it with a door of their own."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from star_core import Scene
from star_core.testing import scene
from star_external.door import Door
from star_external.external import External, Manner

SOON = 5.0  # s, by which what was sent over the loopback has arrived


class Client:
    """The other process."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.socket = socket.create_connection(address, timeout=SOON)
        self._lines = self.socket.makefile("rb")

    def send(self, *said: Any) -> None:
        """Send lines: bytes as they are, anything else as JSON."""
        for value in said:
            line = value if isinstance(value, bytes) else json.dumps(value).encode() + b"\n"
            self.socket.sendall(line)

    def hear(self) -> Any:
        """Return the next line, or None if there is none any more."""
        line = self._lines.readline()
        return json.loads(line) if line else None

    def close(self) -> None:
        self._lines.close()
        self.socket.close()


@pytest.fixture
def door() -> Iterator[Door]:
    made = Door("127.0.0.1", 0)
    yield made
    made.close()


@pytest.fixture
def connect(door: Door) -> Iterator[Callable[[], Client]]:
    """Connect to the door."""
    made: list[Client] = []

    def connected() -> Client:
        made.append(Client(door.address))
        return made[-1]

    yield connected
    for client in made:
        client.close()


@pytest.fixture
def room() -> Scene:
    return scene(3)


@pytest.fixture
def external(door: Door, room: Scene) -> Callable[..., External]:
    """Make the task of the first two of three agents, with these options."""

    def made(**options: Any) -> External:
        return External(room, (0, 1), door, Manner(**options))

    return made
