"""A TCP port for one client at a time, with non-blocking transfers."""

from __future__ import annotations

import logging
import selectors
import socket
import threading
from collections import deque
from collections.abc import Callable
from typing import Final

from star_fleet.cpx import Decoder, Packet, SyncError

CHUNK: Final = 65_536  # bytes to read at a time
KERNEL: Final = 80_000  # bytes, about an image, to leave waiting with the kernel (Linux doubles it)
CLOSING: Final = 1.0  # s to wait for the switchboard to close a port

_log = logging.getLogger(__name__)


class Port:
    """One listening socket and its client's; `Switchboard.open` makes it.

    As on an AI-deck, a second client waits, connected, until the first has disconnected.

    Attributes:
        address: Host and port on which it listens.
        released: Called after `close`.
        hung_up: Number of clients disconnected for invalid data or for not reading.
    """

    def __init__(
        self,
        listener: socket.socket,
        selector: selectors.BaseSelector,
        heard: Callable[[Packet], object],
        soon: Callable[[Callable[[], None]], None],
    ) -> None:
        host, port = listener.getsockname()[:2]
        self.address: tuple[str, int] = (host, port)
        self.released: Callable[[], object] = lambda: None
        self.hung_up = 0
        self._listener, self._selector, self._heard, self._soon = listener, selector, heard, soon
        listener.settimeout(0)
        self._lock = threading.Lock()  # for the two below
        self._waiting: deque[bytes] = deque()
        self._client: socket.socket | None = None
        self._decoder = Decoder()
        self._sending = memoryview(b"")
        self._watched = selectors.EVENT_READ
        self._closed = threading.Event()

    @property
    def connected(self) -> bool:
        """Whether a client is connected."""
        return self._client is not None

    def put(self, message: bytes, room: int) -> int:
        """Send a message as soon as the client takes it; without a client it is lost.

        Args:
            message: Whole frames. Once it is begun it is sent to its end.
            room: How many messages may wait behind the one that is being sent.

        Returns:
            How many older messages were thrown away to make room: 0 or 1.
        """
        with self._lock:
            if self._client is None:
                return 0
            thrown = int(len(self._waiting) >= room)
            if thrown:
                self._waiting.popleft()
            idle = not self._waiting
            self._waiting.append(message)
        if idle:
            self._soon(self._send)
        return thrown

    def hang_up(self) -> None:
        """Send the client away."""
        self._soon(self._refuse)

    def close(self) -> None:
        """Close it, and wait until that is done. Safe to call twice."""
        self._soon(self.end)
        self._closed.wait(CLOSING)
        self.released()

    def begin(self) -> None:
        """Accept clients. For the switchboard's thread only, as is `end`."""
        if not self._closed.is_set():
            self._selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def end(self) -> None:
        """Release the sockets."""
        if self._closed.is_set():
            return
        self._lose()
        if self._listener in self._selector.get_map():
            self._selector.unregister(self._listener)
        self._listener.close()
        self._closed.set()

    def _accept(self, events: int) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:  # gone again
            return
        client.settimeout(0)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL)
        self._selector.unregister(self._listener)
        self._selector.register(client, selectors.EVENT_READ, self._serve)
        self._decoder, self._watched = Decoder(), selectors.EVENT_READ
        with self._lock:
            self._client = client

    def _serve(self, events: int) -> None:
        if events & selectors.EVENT_WRITE:
            self._send()
        if events & selectors.EVENT_READ:
            self._read()

    def _read(self) -> None:
        if self._client is None:
            return
        try:
            data = self._client.recv(CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._lose()
            return
        try:
            for packet in self._decoder.feed(data):
                self._heard(packet)
        except SyncError as error:
            _log.warning("%s:%d: client sent away: %s", *self.address, error)
            self._refuse()
        except Exception:  # noqa: BLE001 -- the other ports are served on
            _log.exception("%s:%d: client sent away", *self.address)
            self._refuse()

    def _send(self) -> None:
        """Send until the client takes no more, and go on when it does."""
        while self._client is not None:
            if not self._sending:
                with self._lock:
                    if not self._waiting:
                        break
                    self._sending = memoryview(self._waiting.popleft())
            try:
                self._sending = self._sending[self._client.send(self._sending) :]
            except BlockingIOError:
                break
            except OSError:
                self._lose()
        self._watch(selectors.EVENT_WRITE if self._sending else 0)

    def _watch(self, more: int) -> None:
        events = selectors.EVENT_READ | more
        if self._client is not None and events != self._watched:
            self._watched = events
            self._selector.modify(self._client, events, self._serve)

    def _refuse(self) -> None:
        if self._client is not None:
            self.hung_up += 1
            self._lose()

    def _lose(self) -> None:
        """Let the client go and accept the next one."""
        with self._lock:
            client, self._client = self._client, None
            self._waiting.clear()
        self._sending = memoryview(b"")
        if client is not None:
            self._selector.unregister(client)
            client.close()
            self._selector.register(self._listener, selectors.EVENT_READ, self._accept)
