"""Send queue of a link whose driver may block, so that callers never wait."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable


class SendQueue:
    """A thread that sends queued packets in order, and the latest setpoint after them.

    Args:
        send: Sends a packet; may block.
        name: Name of the agent.
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
        """Start the thread."""
        self._thread.start()

    def order(self, packet: bytes) -> None:
        """Queue a packet; a queued setpoint is older and is dropped."""
        with self._changed:
            self._orders.append(packet)
            self._setpoint = None
            self._changed.notify()

    def steer(self, packet: bytes) -> None:
        """Queue a setpoint; it replaces one that is still queued."""
        with self._changed:
            self._setpoint = packet
            self._changed.notify()

    def stop(self) -> None:
        """Send what is queued, for at most 0.5 s, and end."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(0.5)

    def _run(self) -> None:
        while (packet := self._next()) is not None:
            self._send(packet)

    def _next(self) -> bytes | None:
        """Wait for the next packet to send; None at the end."""
        with self._changed:
            while not self._orders and self._setpoint is None:
                if self._ended:
                    return None
                self._changed.wait()
            if self._orders:
                return self._orders.popleft()
            packet, self._setpoint = self._setpoint, None
            return packet
