"""TCP server for one client at a time, which exchanges lines of text."""

from __future__ import annotations

import hmac
import json
import os
import selectors
import socket
import time
from contextlib import suppress
from typing import Final, NamedTuple

from star_core import PluginError

MAX_LINE: Final = 65536  # bytes: about 500 goals
MAX_UNREAD: Final = 262144  # bytes buffered for a client that does not read
MAX_READS: Final = 16  # per tick of a line that is too long: the rest is dropped in later ticks

BUSY: Final = b'{"error": "another process is connected", "line": 0}\n'
DENIED: Final = b'{"error": "the first line must be {\\"token\\": ...} with the flight\'s token"}\n'


class Line(NamedTuple):
    """A line received from a client.

    Attributes:
        number: Counted from 1 in each connection.
        text: Without the line break; None if it was longer than `MAX_LINE`.
    """

    number: int
    text: bytes | None


class TcpServer:
    """Listens on a port, accepts one client at a time, and blocks only where a wait is given.

    Successive steps share one server: the step that holds it increments `turn` in every tick.

    Args:
        listen: IPv4 address.
        port: 0 for any free port.
        token: What a client's first line, ``{"token": "..."}``, must contain; None accepts any
            client.

    Attributes:
        address: Address and port it listens on.
        client_count: Number of clients accepted so far.
        holder: The step that uses it.
        turn: Number of ticks in which it was used.
        closed: Whether it is closed.

    Raises:
        PluginError: The port cannot be opened.
    """

    def __init__(self, listen: str, port: int, token: str | None = None) -> None:
        try:
            self._server = socket.create_server((listen, port))
        except OSError as error:
            why = os.strerror(error.errno or 0)  # the error's text repeats the address
            message = f"cannot listen on {listen}:{port}: {why}; choose another 'port'"
            raise PluginError(message, code="address-in-use") from error
        self._server.settimeout(0.0)
        self.address: tuple[str, int] = self._server.getsockname()
        self.client_count = 0
        self.holder: object | None = None
        self.turn = 0
        self.closed = False
        self._client: socket.socket | None = None
        self._token = token
        self._forget()

    @property
    def connected(self) -> bool:
        """Whether a client is connected, or has sent lines that were not read yet."""
        return self._client is not None and self._trusted

    def accept(self, wait: float) -> bool:
        """Wait up to `wait` seconds for a client; return whether one is connected.

        Any other client is sent an error and disconnected.
        """
        until = time.monotonic() + wait
        while True:
            self._accept()
            remaining = until - time.monotonic()
            if self.connected or remaining <= 0:
                return self.connected
            self._sleep(remaining)

    def send(self, line: bytes, *, now: bool = False) -> bool:
        """Send a line without blocking; return whether it was sent or buffered.

        Args:
            line: With its line break.
            now: Drop the line if the client has not read the earlier ones.
        """
        self._flush()
        most = 0 if now else MAX_UNREAD - len(line)
        if not self.connected or self._ended or len(self._unsent) > most:
            return False
        self._unsent += line
        self._flush()
        return True

    def receive(self, most: int, wait: float) -> list[Line]:
        """Return up to `most` lines, waiting up to `wait` seconds for the first."""
        until = time.monotonic() + wait
        lines: list[Line] = []
        while True:
            self._accept()
            self._receive()
            while len(lines) < most and (line := self._next()) is not None:
                lines.append(line)
            if self._ended and b"\n" not in self._received:
                self.disconnect()
            remaining = until - time.monotonic()
            if lines or not self.connected or remaining <= 0:
                return lines
            self._flush()
            self._sleep(remaining)

    def disconnect(self) -> None:
        """Disconnect the client; unread and unsent lines are discarded."""
        if self._client is not None:
            self._client.close()
        self._client = None
        self._forget()

    def close(self) -> None:
        """Close the port."""
        self.disconnect()
        self._server.close()
        self.closed = True

    def _forget(self) -> None:
        self._received, self._unsent = bytearray(), bytearray()
        self._trusted = self._token is None
        self._ended = False  # the client's stream has ended
        self._dropping = False  # the rest of a line that is too long
        self._count = 0

    def _accept(self) -> None:
        with suppress(OSError):  # there is none, or it has disconnected already
            while True:
                client, _ = self._server.accept()
                client.settimeout(0.0)
                if not self.connected:
                    self.disconnect()  # one that has not sent its token
                    self._client = client
                    self.client_count += self._trusted
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    continue
                _dismiss(client, BUSY)
        if self._client is not None and not self._trusted:
            self._check_token(self._client)

    def _check_token(self, client: socket.socket) -> None:
        """Accept the client if its first line has the token, disconnect it after any other."""
        self._receive()
        if (line := self._next()) is None:
            if self._ended:
                self.disconnect()
            return
        try:
            sent = str(json.loads(line.text or b"")["token"])
        except (ValueError, TypeError, KeyError, RecursionError):
            sent = ""
        if hmac.compare_digest(sent.encode(errors="replace"), (self._token or "").encode()):
            self._trusted = True
            self.client_count += 1
        else:
            _dismiss(client, DENIED)
            self.disconnect()

    def _receive(self) -> None:
        """Read from the client, as far as the buffer has room."""
        for _ in range(MAX_READS):
            if self._client is None or self._ended or len(self._received) > MAX_LINE:
                return
            try:
                data = self._client.recv(MAX_LINE)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            self._ended = not data
            self._received += data
            if self._dropping:
                self._drop()

    def _drop(self) -> None:
        end = self._received.find(b"\n")
        self._dropping = end < 0
        del self._received[: None if end < 0 else end + 1]

    def _next(self) -> Line | None:
        """Return the next non-empty line, None if it is not complete yet."""
        while not self._dropping:
            end = self._received.find(b"\n")
            if end < 0 and len(self._received) <= MAX_LINE:
                return None
            self._count += 1
            if not 0 <= end <= MAX_LINE:
                self._dropping = True
                self._drop()
                return Line(self._count, None)
            text = bytes(self._received[:end])
            del self._received[: end + 1]
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
        except OSError:  # it no longer reads; lines it has sent are still to be received
            sent = len(self._unsent)
        del self._unsent[:sent]

    def _sleep(self, seconds: float) -> None:
        """Wait until a socket is ready, but at most `seconds`."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._server, selectors.EVENT_READ)
            if self._client is not None:
                write_events = selectors.EVENT_WRITE if self._unsent else 0
                selector.register(self._client, selectors.EVENT_READ | write_events)
            selector.select(seconds)


def _dismiss(client: socket.socket, why: bytes) -> None:
    """Send a client an error and disconnect it."""
    with client, suppress(OSError):
        client.send(why)
        client.shutdown(socket.SHUT_WR)
