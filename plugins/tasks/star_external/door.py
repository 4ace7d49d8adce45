"""A port that one other process at a time can connect to, and the lines that pass through it."""

from __future__ import annotations

import os
import selectors
import socket
import time
from contextlib import suppress
from typing import Final, NamedTuple

from star_core import PluginError

LONGEST: Final = 65536
"""Bytes of a line: some 500 goals."""

UNREAD: Final = 262144
"""Bytes that are kept for a client that does not read."""

CHUNKS: Final = 16
"""Reads in a tick of a line that is too long: the rest is dropped in later ticks."""

BUSY: Final = b'{"error": "another process is connected", "line": 0}\n'


class Line(NamedTuple):
    """What a client said.

    Attributes:
        number: Counted from 1 in each connection.
        text: Without its end; None if it was longer than `LONGEST`.
    """

    number: int
    text: bytes | None


class Door:
    """Listens on a port, lets one client in at a time, and never waits unless it is told to.

    Steps that follow each other use one door in turns: the one that holds it adds to `turn` in
    every tick.

    Args:
        listen: IPv4 address.
        port: 0 for any that is free.

    Attributes:
        address: Where it listens: address and port.
        visitor: How many clients were let in so far.
        holder: Who uses it.
        turn: How often it was used.
        closed: Whether it is closed for good.

    Raises:
        PluginError: The port cannot be opened.
    """

    def __init__(self, listen: str, port: int) -> None:
        try:
            self._server = socket.create_server((listen, port))
        except OSError as error:
            why = os.strerror(error.errno or 0)  # the error's own text names the address once more
            raise PluginError(
                f"cannot listen on {listen}:{port}: {why}; choose another 'port'"
            ) from error
        self._server.settimeout(0.0)
        self.address: tuple[str, int] = self._server.getsockname()
        self.visitor = 0
        self.holder: object | None = None
        self.turn = 0
        self.closed = False
        self._client: socket.socket | None = None
        self._forget()

    @property
    def connected(self) -> bool:
        """Whether a client is there, or has left lines that were not heard yet."""
        return self._client is not None

    def meet(self, wait: float) -> bool:
        """Let a client in, waiting for one for `wait` seconds at most; return whether one is there.

        Any other is told that it is one too many.
        """
        until = time.monotonic() + wait
        while True:
            self._accept()
            left = until - time.monotonic()
            if self.connected or left <= 0:
                return self.connected
            self._sleep(left)

    def say(self, line: bytes, *, now: bool = False) -> bool:
        """Send a line, as far as the client reads; return whether it is sent or kept.

        Args:
            line: With its end.
            now: Drop it if there is something that the client has not read yet.
        """
        self._flush()
        most = 0 if now else UNREAD - len(line)
        if self._client is None or self._gone or len(self._unsent) > most:
            return False
        self._unsent += line
        self._flush()
        return True

    def hear(self, most: int, wait: float) -> list[Line]:
        """Return up to `most` lines, waiting for the first for `wait` seconds at most."""
        until = time.monotonic() + wait
        lines: list[Line] = []
        while True:
            self._accept()
            self._receive()
            while len(lines) < most and (line := self._next()) is not None:
                lines.append(line)
            if self._gone and b"\n" not in self._unheard:
                self.hang_up()
            left = until - time.monotonic()
            if lines or not self.connected or left <= 0:
                return lines
            self._flush()
            self._sleep(left)

    def hang_up(self) -> None:
        """Send the client away; what it said and was to be told is forgotten."""
        if self._client is not None:
            self._client.close()
        self._client = None
        self._forget()

    def close(self) -> None:
        """Close the port."""
        self.hang_up()
        self._server.close()
        self.closed = True

    def _forget(self) -> None:
        self._unheard, self._unsent = bytearray(), bytearray()
        self._gone = False  # the client has said its last
        self._dropping = False  # what is left of a line that is too long
        self._count = 0

    def _accept(self) -> None:
        with suppress(OSError):  # there is none, or it has gone again
            while True:
                client, _ = self._server.accept()
                client.settimeout(0.0)
                if self._client is None:
                    self._client = client
                    self.visitor += 1
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    continue
                with client, suppress(OSError):
                    client.send(BUSY)
                    client.shutdown(socket.SHUT_WR)

    def _receive(self) -> None:
        """Take in what the client has said, as far as there is room."""
        for _ in range(CHUNKS):
            if self._client is None or self._gone or len(self._unheard) > LONGEST:
                return
            try:
                said = self._client.recv(LONGEST)
            except BlockingIOError:
                return
            except OSError:
                said = b""
            self._gone = not said
            self._unheard += said
            if self._dropping:
                self._drop()

    def _drop(self) -> None:
        end = self._unheard.find(b"\n")
        self._dropping = end < 0
        del self._unheard[: None if end < 0 else end + 1]

    def _next(self) -> Line | None:
        """Take the next line that is not empty, if it is there."""
        while not self._dropping:
            end = self._unheard.find(b"\n")
            if end < 0 and len(self._unheard) <= LONGEST:
                return None
            self._count += 1
            if not 0 <= end <= LONGEST:
                self._dropping = True
                self._drop()
                return Line(self._count, None)
            text = bytes(self._unheard[:end])
            del self._unheard[: end + 1]
            if text.strip():
                return Line(self._count, text)
        return None

    def _flush(self) -> None:
        if self._client is None or not self._unsent:
            return
        try:
            sent = self._client.send(self._unsent)
        except BlockingIOError:
            return
        except OSError:  # it does not listen any more; what it has said is still to be heard
            sent = len(self._unsent)
        del self._unsent[:sent]

    def _sleep(self, seconds: float) -> None:
        """Wait until something can be done at the door, or for some seconds."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._server, selectors.EVENT_READ)
            if self._client is not None:
                wanted = selectors.EVENT_WRITE if self._unsent else 0
                selector.register(self._client, selectors.EVENT_READ | wanted)
            selector.select(seconds)
