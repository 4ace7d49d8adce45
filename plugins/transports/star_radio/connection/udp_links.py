"""UDP links, where one datagram is one packet: one thread receives for all of them.

cflib 0.1.34 reads each UDP link in a thread that passes packets on to a second thread. With many
drones these threads compete for the interpreter when a tick is due.
"""

from __future__ import annotations

import selectors
import socket
import threading
import time
from typing import Final
from urllib.parse import urlsplit

from star_radio.connection.packets import LinkListener

SCHEME: Final = "udp://"
POLL_PERIOD: Final = 0.1  # s, between keep-alive checks, and checks whether to end
MAX_DATAGRAM: Final = 64  # bytes: longer than a packet, so that an oversized one is noticed
RECEIVE_BUFFER: Final = 1 << 20  # bytes, for a thread that is late


class UdpLinks:
    """The UDP links of a swarm; its thread runs from the first that is opened to `close`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._links: dict[int, UdpLink] = {}  # by file descriptor
        self._selector = selectors.DefaultSelector()  # epoll and kqueue are thread-safe
        self._thread: threading.Thread | None = None
        self._ended = False

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
        link = UdpLink(line, listener, self)
        with self._lock:
            self._links[line.fileno()] = link
            self._selector.register(line, selectors.EVENT_READ)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="star-radio", daemon=True)
                self._thread.start()
        return link

    def remove(self, line: socket.socket) -> None:
        """Close a socket."""
        with self._lock:
            self._selector.unregister(line)
            del self._links[line.fileno()]
            line.close()

    def close(self) -> None:
        """End the thread. Safe to call twice."""
        self._ended = True
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._selector.close()

    def _run(self) -> None:
        idle_due = 0.0
        while not self._ended:
            ready = self._selector.select(POLL_PERIOD)
            now = time.monotonic()
            for key, _events in ready:
                if (link := self._links.get(key.fd)) is not None:  # not closed meanwhile
                    link.receive(now)
            if now >= idle_due:
                idle_due = now + POLL_PERIOD
                for link in list(self._links.values()):
                    link.listener.idle(now)


class UdpLink:
    """Driver of one drone's link, made by `UdpLinks.open`. Sending a datagram does not block."""

    def __init__(self, line: socket.socket, listener: LinkListener, links: UdpLinks) -> None:
        self._line, self.listener, self._links = line, listener, links
        self._closed = False

    def send(self, packet: bytes) -> None:
        if self._closed:
            return
        try:
            self._line.send(packet)
        except OSError as error:
            self.listener.complain(str(error))

    steer = send

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._links.remove(self._line)

    def receive(self, now: float) -> None:
        """Pass on one datagram; the selector reports any that follow."""
        try:
            packet = self._line.recv(MAX_DATAGRAM)
        except BlockingIOError:
            return
        except OSError as error:  # connection refused: raised once for each packet sent
            if not self._closed:
                self.listener.complain(str(error))
            return
        if packet and not self._closed:
            self.listener.hear(packet, now)
