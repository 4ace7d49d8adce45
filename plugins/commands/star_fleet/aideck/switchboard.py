"""One thread that serves the TCP ports of any number of decks."""

from __future__ import annotations

import selectors
import socket
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Final

from star_core import PluginError
from star_fleet.aideck.port import Port
from star_fleet.cpx import Packet

MOST: Final = 65_535  # of all ports
WAITING: Final = 8  # clients behind the one that is served
_WAKES: Final = 4096  # to read at a time, a byte each


def listen(
    host: str, port: int, heard: Callable[[Packet], object], switchboard: Switchboard | None
) -> Port:
    """Listen on a port of `switchboard`, or of a new one that is closed with the port.

    Raises:
        PluginError: The port cannot be had.
    """
    if switchboard is not None:
        return switchboard.open(host, port, heard)
    own = Switchboard()
    try:
        opened = own.open(host, port, heard)
    except PluginError:
        own.close()
        raise
    opened.released = own.close
    return opened


class Switchboard:
    """Listens on ports and passes on the data of their clients, in its own thread.

    `open` adds a port. An exception in a handler disconnects only its own client.
    """

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._jobs: deque[Callable[[], None]] = deque()
        self._woken, self._waker = socket.socketpair()
        self._woken.settimeout(0)
        self._waker.settimeout(0)
        self._selector.register(self._woken, selectors.EVENT_READ, self._read_wakes)
        self._ports: set[Port] = set()
        self._closed = False
        self._thread = threading.Thread(target=self._serve, name="aideck", daemon=True)
        self._thread.start()

    def open(self, host: str, port: int, heard: Callable[[Packet], object]) -> Port:
        """Listen on a port.

        Args:
            host: Address of the interface.
            port: Number; 0 for any that is free.
            heard: Called with every packet of the port's client, in the switchboard's thread.

        Raises:
            PluginError: The port cannot be had.
        """
        if not 0 <= port <= MOST:
            raise PluginError(f"cannot listen on {host}:{port}: expected a port from 0 to {MOST}")
        try:
            listener = socket.create_server((host, port), backlog=WAITING)
        except OSError as error:
            reason = str(error.strerror or error).partition(" (while")[0]  # without the port
            raise PluginError(f"cannot listen on {host}:{port}: {reason}") from error
        opened = Port(listener, self._selector, heard, self.soon)
        self.soon(partial(self._add, opened))
        return opened

    def soon(self, job: Callable[[], None]) -> None:
        """Have something done in the switchboard's thread."""
        self._jobs.append(job)
        with suppress(BlockingIOError, OSError):  # it is awake already, or has been closed
            self._waker.send(b"\0")

    def close(self) -> None:
        """Close every port and end the thread. Safe to call twice."""
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self.soon(self._end)
            self._thread.join()

    def _add(self, port: Port) -> None:
        self._ports.add(port)
        port.begin()

    def _end(self) -> None:
        self._closed = True

    def _read_wakes(self, events: int) -> None:
        with suppress(BlockingIOError):
            self._woken.recv(_WAKES)

    def _serve(self) -> None:
        while not self._closed:
            for key, events in self._selector.select():
                key.data(events)
            while self._jobs:
                self._jobs.popleft()()
        for port in self._ports:
            port.end()
        self._selector.close()
        self._woken.close()
        self._waker.close()
