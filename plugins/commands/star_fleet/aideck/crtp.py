"""A simulated Crazyflie's own link over WiFi: CRTP packets in CPX over TCP."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Final, Self

from star_fleet.aideck.switchboard import Switchboard, listen
from star_fleet.cpx import Function, Packet, Target, encode

MOST: Final = 31  # bytes of a CRTP packet, its header included
WAITING: Final = 2000  # packets: 2 s of a busy link


class CrtpOverTcp:
    """Serves one vehicle to one client at a time, such as cflib's ``tcp://HOST:PORT``.

    cflib sends nothing twice over TCP, so no packet may be lost: a client that leaves `WAITING`
    packets unread is sent away instead.

    Args:
        host: Address of the interface.
        port: Number; 0 for any that is free.
        handle: Answers a CRTP packet with CRTP packets, in the switchboard's thread. If it raises,
            the client is sent away.
        switchboard: Shared switchboard; it has its own if not given.

    Attributes:
        address: Host and port on which it listens.

    Raises:
        PluginError: The port cannot be had.
    """

    def __init__(
        self,
        host: str,
        port: int,
        handle: Callable[[bytes], Iterable[bytes]],
        *,
        switchboard: Switchboard | None = None,
    ) -> None:
        self._handle = handle
        self._port = listen(host, port, self._heard, switchboard)
        self.address = self._port.address

    @property
    def connected(self) -> bool:
        """Whether a client is there."""
        return self._port.connected

    def push(self, packet: bytes) -> None:
        """Send an unsolicited CRTP packet, such as a log report, from any thread."""
        message = encode(Packet(Target.STM32, Target.HOST, Function.CRTP, packet))
        if self._port.put(message, WAITING):
            self._port.hang_up()

    def close(self) -> None:
        """Hang up and stop listening. Safe to call twice."""
        self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _heard(self, packet: Packet) -> None:
        """Answer CRTP packets; others, such as keep-alive packets, need no answer."""
        if packet.function is Function.CRTP and 0 < len(packet.data) <= MOST:
            for answer in self._handle(packet.data):
                self.push(answer)
