"""Sends packets over a link that may block, so that whoever posts them never waits."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable


class Outbox:
    """A thread that sends orders in their order, and between them the latest setpoint.

    Args:
        send: Sends a packet; may block.
        name: Of the agent.
    """

    def __init__(self, send: Callable[[bytes], None], name: str) -> None:
        self._send = send
        self._orders: deque[bytes] = deque()
        self._setpoint: bytes | None = None
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(
            target=self._run, name=f"star-radio-{name}-out", daemon=True
        )

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def order(self, packet: bytes) -> None:
        """Send a packet after those before it; a setpoint that waits is older, and is forgotten."""
        with self._changed:
            self._orders.append(packet)
            self._setpoint = None
            self._changed.notify()

    def steer(self, packet: bytes) -> None:
        """Send a setpoint in place of one that still waits."""
        with self._changed:
            self._setpoint = packet
            self._changed.notify()

    def stop(self) -> None:
        """Send what waits, as far as that takes no more than half a second, and end."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(0.5)

    def _run(self) -> None:
        while (packet := self._next()) is not None:
            self._send(packet)

    def _next(self) -> bytes | None:
        """Wait for a packet to send; None at the end."""
        with self._changed:
            while not self._orders and self._setpoint is None:
                if self._ended:
                    return None
                self._changed.wait()
            if self._orders:
                return self._orders.popleft()
            packet, self._setpoint = self._setpoint, None
            return packet
