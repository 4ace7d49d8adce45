"""The UDP ports of a fleet: where each vehicle is heard, and who is sent what it says."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Iterator, Sequence
from typing import Final, TypeAlias

from star_core import PluginError, Scene
from star_sim.fleet.packet import is_null

DATAGRAM: Final = 64  # bytes: more than a packet has, so that one that is too long shows
SILENT: Final = 5.0  # s of the clock on the wall, after which a client counts as gone

Client: TypeAlias = tuple[str, int]
"""A host and a port."""


class Ports:
    """One UDP port for each agent; whoever has sent the last packet to it gets what it streams.

    Args:
        scene: The agents.
        host: Address to serve at.
        numbers: Of the port of each agent; 0 for a free one.
        delay: Cycles that each packet takes to the client.

    Attributes:
        sockets: Of each agent; they do not block.

    Raises:
        PluginError: A port cannot be had; it is named.
    """

    def __init__(self, scene: Scene, host: str, numbers: Sequence[int], delay: int) -> None:
        self.sockets: list[socket.socket] = []
        self._delay = delay
        self._clients: list[tuple[Client, float] | None] = [None] * len(scene.agents)
        self._late: list[tuple[int, int, bytes, Client]] = []  # by the cycle when it is due
        try:
            for agent, number in zip(scene.agents, numbers, strict=True):
                self.sockets.append(_opened(agent.name, host, number))
        except BaseException:
            self.close()
            raise

    @property
    def addresses(self) -> list[str]:
        """Where each agent is to be reached, as a mission's ``uri``."""
        return [f"udp://{host}:{port}" for host, port in (s.getsockname() for s in self.sockets)]

    def receive(self, row: int) -> Iterator[tuple[bytes, Client]]:
        """Yield one packet and who sent it; if there are more, the selector says so again."""
        try:
            packet, client = self.sockets[row].recvfrom(DATAGRAM)
        except OSError:  # none after all, or a client has closed its port
            return
        if not is_null(packet):  # which asks who is there
            self._clients[row] = client, time.monotonic()
        yield packet, client

    def send(self, row: int, packet: bytes, client: Client, cycle: int) -> None:
        """Send a packet of an agent's to a client, now in `cycle` or so many cycles later."""
        if self._delay:
            self._late.append((cycle + self._delay, row, packet, client))
        else:
            self._put(row, packet, client)

    def stream(self, row: int, packets: Sequence[bytes], cycle: int) -> None:
        """Send packets to whom the agent heard last, until 5 s after that."""
        known = self._clients[row]
        if known is not None and time.monotonic() - known[1] < SILENT:
            for packet in packets:
                self.send(row, packet, known[0], cycle)

    def send_late(self, cycle: int) -> None:
        """Send what is due by now."""
        while self._late and self._late[0][0] <= cycle:
            _, row, packet, client = self._late.pop(0)
            self._put(row, packet, client)

    def close(self) -> None:
        """Give the ports back. Safe to call twice."""
        for each in self.sockets:
            each.close()

    def _put(self, row: int, packet: bytes, client: Client) -> None:
        with contextlib.suppress(OSError):  # its buffer is full, or it has gone
            self.sockets[row].sendto(packet, client)


def _opened(name: str, host: str, number: int) -> socket.socket:
    """Return the socket of the agent of that name.

    Raises:
        PluginError: The port cannot be had.
    """
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)  # noqa: FBT003 -- it has no name
        made.bind((host, number))
    except (OSError, OverflowError) as error:
        made.close()
        raise PluginError(
            f"agent {name!r}: port {number} of {host!r} cannot be had: {error}"
        ) from error
    return made
