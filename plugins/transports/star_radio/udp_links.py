"""UDP links, where one datagram is one packet: one thread receives for all of them.

cflib 0.1.34 reads each UDP link in a thread that passes packets on to a second thread. With many
drones these threads compete for the interpreter when a tick is due.
"""

from __future__ import annotations

import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Final
from urllib.parse import urlsplit

from star_radio.link_protocol import LinkListener

SCHEME: Final = "udp://"
POLL_PERIOD: Final = 0.1  # s, between keep-alive checks
MAX_DATAGRAM: Final = 64  # bytes: longer than a packet, so that an oversized one is noticed
RECEIVE_BUFFER: Final = 1 << 20  # bytes, for a thread that is late


class UdpLinks:
    """The UDP links of a swarm; its thread runs from the first that is opened to `close`."""

    def __init__(self) -> None:
        self._starting = threading.Lock()
        self._thread: _Thread | None = None

    def open(self, uri: str, listener: LinkListener) -> UdpLink:
        """Open a link to ``udp://host:port`` and deliver what it receives to `listener`.

        Raises:
            OSError: There is no such host.
        """
        parts = urlsplit(uri)
        family, kind, protocol, _name, address = socket.getaddrinfo(
            parts.hostname, parts.port, type=socket.SOCK_DGRAM
        )[0]
        line = socket.socket(family, kind, protocol)
        try:
            line.setblocking(False)  # noqa: FBT003 -- a positional-only argument
            line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            line.connect(address)
        except OSError:
            line.close()
            raise
        with self._starting:
            if self._thread is None:
                self._thread = _Thread()
                self._thread.start()
        return UdpLink(line, listener, self._thread)

    def close(self) -> None:
        """End the thread. Safe to call twice."""
        with self._starting:
            thread, self._thread = self._thread, None
        if thread is not None:
            thread.end()


class _Thread(threading.Thread):
    """Receives from all sockets."""

    def __init__(self) -> None:
        super().__init__(name="star-radio", daemon=True)
        self._selector = selectors.DefaultSelector()
        self._listeners: list[LinkListener] = []
        self._jobs: deque[Callable[[], None]] = deque()
        self._waker, self._woken = socket.socketpair()
        for end in (self._waker, self._woken):
            end.setblocking(False)  # noqa: FBT003
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._ended = False

    def add(self, line: socket.socket, listener: LinkListener) -> None:
        """Start to receive from a socket."""
        self._soon(partial(self._add, line, listener))

    def remove(self, line: socket.socket, listener: LinkListener) -> None:
        """Close a socket, and wait until that is done."""
        done = threading.Event()
        self._soon(partial(self._remove, line, listener, done))
        done.wait(POLL_PERIOD)

    def end(self) -> None:
        """Stop the thread."""
        self._ended = True
        self._soon(lambda: None)
        self.join()
        for resource in (self._selector, self._waker, self._woken):
            resource.close()

    def run(self) -> None:
        idle_due = 0.0
        while not self._ended:
            ready = self._selector.select(POLL_PERIOD)
            now = time.monotonic()
            for key, _events in ready:
                if key.data is None:
                    self._do_jobs()
                else:
                    _read(key.fileobj, key.data, now)  # type: ignore[arg-type]
            if now >= idle_due:
                idle_due = now + POLL_PERIOD
                for listener in self._listeners:
                    listener.idle(now)

    def _soon(self, job: Callable[[], None]) -> None:
        """Run a job in the thread."""
        self._jobs.append(job)
        with suppress(BlockingIOError):  # already awake
            self._waker.send(b"\0")

    def _do_jobs(self) -> None:
        with suppress(BlockingIOError):
            self._woken.recv(MAX_DATAGRAM)
        while self._jobs:
            self._jobs.popleft()()

    def _add(self, line: socket.socket, listener: LinkListener) -> None:
        self._listeners.append(listener)
        self._selector.register(line, selectors.EVENT_READ, listener)

    def _remove(self, line: socket.socket, listener: LinkListener, done: threading.Event) -> None:
        self._listeners.remove(listener)
        self._selector.unregister(line)
        line.close()
        done.set()


class UdpLink:
    """Driver of one drone's link, made by `UdpLinks.open`. Sending a datagram does not block."""

    def __init__(self, line: socket.socket, listener: LinkListener, thread: _Thread) -> None:
        self._line, self._listener, self._thread = line, listener, thread
        self._closed = False
        thread.add(line, listener)

    def send(self, packet: bytes) -> None:
        if self._closed:
            return
        try:
            self._line.send(packet)
        except OSError as error:
            self._listener.complain(str(error))

    steer = send

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._thread.remove(self._line, self._listener)


def _read(line: socket.socket, listener: LinkListener, now: float) -> None:
    """Receive one datagram; the selector reports any that follow."""
    try:
        packet = line.recv(MAX_DATAGRAM)
    except BlockingIOError:
        return
    except OSError as error:  # connection refused: raised once for each packet sent
        listener.complain(str(error))
        return
    if packet:
        listener.hear(packet, now)
