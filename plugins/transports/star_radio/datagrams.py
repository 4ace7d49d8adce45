"""Links over UDP, where one datagram is one packet: one thread hears all of them.

cflib 0.1.34 reads every UDP link in a thread that hands on to a second one, so that a packet wakes
two threads of as many as there are drones, and they all want the interpreter when a tick is due.
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

from star_radio.wire import Ear

SCHEME: Final = "udp://"
POLL: Final = 0.1  # s between two looks whether something is to be said
SIZE: Final = 64  # bytes: more than a packet has, so that one that is too long shows
ROOM: Final = 1 << 20  # bytes, that the system may keep for a thread that is late


class Datagrams:
    """The UDP links of a swarm; its thread runs from the first that is opened to `close`."""

    def __init__(self) -> None:
        self._starting = threading.Lock()
        self._thread: _Thread | None = None

    def open(self, uri: str, ear: Ear) -> Datagram:
        """Carry packets to ``udp://host:port``, and have `ear` hear what comes from there.

        Raises:
            OSError: There is no such host.
        """
        parts = urlsplit(uri)
        family, kind, protocol, _name, address = socket.getaddrinfo(
            parts.hostname, parts.port, type=socket.SOCK_DGRAM
        )[0]
        line = socket.socket(family, kind, protocol)
        try:
            line.setblocking(False)  # noqa: FBT003 -- it has no name
            line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM)
            line.connect(address)
        except OSError:
            line.close()
            raise
        with self._starting:
            if self._thread is None:
                self._thread = _Thread()
                self._thread.start()
        return Datagram(line, ear, self._thread)

    def close(self) -> None:
        """End the thread. Safe to call twice."""
        with self._starting:
            thread, self._thread = self._thread, None
        if thread is not None:
            thread.end()


class _Thread(threading.Thread):
    """Waits for all lines at once."""

    def __init__(self) -> None:
        super().__init__(name="star-radio", daemon=True)
        self._selector = selectors.DefaultSelector()
        self._ears: list[Ear] = []
        self._jobs: deque[Callable[[], None]] = deque()
        self._waker, self._woken = socket.socketpair()
        for end in (self._waker, self._woken):
            end.setblocking(False)  # noqa: FBT003
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._ended = False

    def add(self, line: socket.socket, ear: Ear) -> None:
        """Hear a line from now on."""
        self._soon(partial(self._add, line, ear))

    def remove(self, line: socket.socket, ear: Ear) -> None:
        """Close a line, and wait until that is done."""
        done = threading.Event()
        self._soon(partial(self._remove, line, ear, done))
        done.wait(POLL)

    def end(self) -> None:
        """Hear no more."""
        self._ended = True
        self._soon(lambda: None)
        self.join()
        for part in (self._selector, self._waker, self._woken):
            part.close()

    def run(self) -> None:
        look = 0.0
        while not self._ended:
            ready = self._selector.select(POLL)
            now = time.monotonic()
            for key, _events in ready:
                if key.data is None:
                    self._do_jobs()
                else:
                    _read(key.fileobj, key.data, now)  # type: ignore[arg-type]
            if now >= look:
                look = now + POLL
                for ear in self._ears:
                    ear.idle(now)

    def _soon(self, job: Callable[[], None]) -> None:
        """Have something done in the thread."""
        self._jobs.append(job)
        with suppress(BlockingIOError):  # it is awake already
            self._waker.send(b"\0")

    def _do_jobs(self) -> None:
        with suppress(BlockingIOError):
            self._woken.recv(SIZE)
        while self._jobs:
            self._jobs.popleft()()

    def _add(self, line: socket.socket, ear: Ear) -> None:
        self._ears.append(ear)
        self._selector.register(line, selectors.EVENT_READ, ear)

    def _remove(self, line: socket.socket, ear: Ear, done: threading.Event) -> None:
        self._ears.remove(ear)
        self._selector.unregister(line)
        line.close()
        done.set()


class Datagram:
    """The wire of one drone; `Datagrams.open` makes it. Sending a datagram does not block."""

    def __init__(self, line: socket.socket, ear: Ear, thread: _Thread) -> None:
        self._line, self._ear, self._thread = line, ear, thread
        self._closed = False
        thread.add(line, ear)

    def send(self, packet: bytes) -> None:
        if self._closed:
            return
        try:
            self._line.send(packet)
        except OSError as error:
            self._ear.complain(str(error))

    steer = send

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._thread.remove(self._line, self._ear)


def _read(line: socket.socket, ear: Ear, now: float) -> None:
    """Take one datagram in; if there are more, the selector says so again."""
    try:
        packet = line.recv(SIZE)
    except BlockingIOError:
        return
    except OSError as error:  # nobody is there: said once for each packet that is sent
        ear.complain(str(error))
        return
    if packet:
        ear.hear(packet, now)
