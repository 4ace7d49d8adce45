"""The UDP ports of a fleet: one per vehicle, and the client that receives its packets."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from typing import Final, TypeAlias

from star_core import PluginError, Scene
from star_fleet.packet import is_null

DATAGRAM: Final = 64  # bytes: more than a packet has, so that one that is too long shows

Client: TypeAlias = tuple[str, int]
"""A host and a port."""


class Ports:
    """One UDP port per agent; its stream is sent to the client of the last packet received.

    Args:
        scene: The agents.
        host: Address to serve at.
        first: Port of the first agent, which those of the others follow; 0 for free ones.

    Attributes:
        sockets: Of each agent; they do not block.
    """

    def __init__(self, scene: Scene, host: str, first: int) -> None:
        self.sockets: list[socket.socket] = []
        self._clients: list[Client | None] = [None] * len(scene.agents)
        try:
            for row, agent in enumerate(scene.agents):
                self.sockets.append(_opened(agent.name, host, first and first + row))
        except BaseException:
            self.close()
            raise

    @property
    def addresses(self) -> list[str]:
        """Address of each agent, as the ``uri`` in a mission."""
        return [f"udp://{host}:{port}" for host, port in (s.getsockname() for s in self.sockets)]

    def receive(self, row: int) -> Iterator[tuple[bytes, Client]]:
        """Yield one packet and its sender; the selector reports any that follow."""
        try:
            packet, client = self.sockets[row].recvfrom(DATAGRAM)
        except OSError:  # none after all, or a client has closed its port
            return
        if not is_null(packet):  # null packets only search for vehicles
            self._clients[row] = client
        yield packet, client

    def client(self, row: int) -> Client | None:
        """Return the client that last sent a packet to the agent."""
        return self._clients[row]

    def send(self, row: int, packet: bytes, client: Client) -> None:
        """Send a packet of an agent's to a client."""
        with contextlib.suppress(OSError):  # its buffer is full, or it has gone
            self.sockets[row].sendto(packet, client)

    def close(self) -> None:
        """Close the ports. Safe to call twice."""
        for each in self.sockets:
            each.close()


def _opened(name: str, host: str, number: int) -> socket.socket:
    """Return the socket of the agent of that name."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)  # noqa: FBT003 -- it has no name
        made.bind((host, number))
    except OSError as error:
        made.close()
        raise PluginError(
            f"agent {name!r}: port {number} of {host!r} is not available: {error}",
            "address-in-use",
        ) from error
    return made
