"""The guardian's end of the connection to the flight: it never waits for the flight."""

from __future__ import annotations

import logging
import os
import pickle
import socket
import struct
from contextlib import suppress
from multiprocessing.connection import Connection
from queue import Empty, Queue
from threading import Thread
from typing import Any, Final

log = logging.getLogger(__name__)

MAX_MESSAGE: Final = 1 << 26  # bytes; a longer one ends the connection
MAX_WAITING: Final = 100  # messages that are read ahead
SEND_TIMEOUT: Final = 0.5  # s, while the flight reads nothing


class Mailbox:
    """Reads whole messages in a thread, so that an incomplete one keeps nothing from flying.

    A message that cannot be read is left out, and is no sign of life of the flight.

    Args:
        connection: To the flight; closed once a message is too long, or is not taken in time.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._socket = socket.socket(fileno=os.dup(connection.fileno()))
        seconds = int(SEND_TIMEOUT), round(1e6 * (SEND_TIMEOUT % 1))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("@ll", *seconds))
        self._messages: Queue[Any] = Queue(MAX_WAITING)
        self._next: list[Any] = []  # at most one, or the error that ends the connection
        Thread(target=self._read, daemon=True).start()

    def poll(self, timeout: float | None = 0.0) -> bool:
        """Wait for a message or the end of the connection, up to `timeout`, s; None: no limit."""
        if not self._next:
            with suppress(Empty):
                self._next.append(self._messages.get(timeout is None or timeout > 0, timeout))
        return bool(self._next)

    def recv(self) -> Any:
        """Return the next message.

        Raises:
            OSError: There is none, and the connection is closed.
        """
        self.poll(None)
        if isinstance(self._next[0], OSError):  # it stays the last
            raise self._next[0]
        return self._next.pop()

    def send(self, message: object) -> None:
        """Send a message.

        Raises:
            OSError: The flight does not read; the connection is closed.
        """
        try:
            self._connection.send(message)
        except OSError:
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)  # part of it may have been sent
            raise

    def _read(self) -> None:
        try:
            while True:
                data = self._connection.recv_bytes(MAX_MESSAGE)
                try:
                    message = pickle.loads(data)  # noqa: S301 -- from the flight
                except Exception as error:  # noqa: BLE001 -- data may raise any type
                    log.warning("guardian: a message cannot be read: %s", error)
                    continue
                self._messages.put(message)
        except (EOFError, OSError) as error:
            self._messages.put(error if isinstance(error, OSError) else ConnectionResetError())
