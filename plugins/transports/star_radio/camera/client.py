"""Client of one AI-deck's camera, which reads in its own thread."""

from __future__ import annotations

import dataclasses
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Final, Self

from star_radio.camera.address import PORT
from star_radio.camera.stream import Counts, Shot, Stream

SHAPE: Final = (244, 324)  # height and width of an HM01B0 image, px
CHUNK: Final = 65_536  # bytes per read
CONNECT_TIMEOUT: Final = 0.5  # s; with the pause, a deck is reconnected within 1 s
RETRY_PERIOD: Final = 0.25  # s, between two connection attempts
SILENCE_TIMEOUT: Final = 2.0  # s without a byte, then reconnect; decks send 8 images per second
MAX_WAITING: Final = 8  # images: 1 s of a deck's stream
CLOSE_TIMEOUT: Final = 2.0  # s, for the thread to end


class CameraClient:
    """Reads one deck's stream, and reconnects within a second when it is lost.

    Args:
        host: The deck's host.
        port: Its port.
        shape: Height and width of its images, px.
        clock: Clock for timestamps, s.
        silence: Time without a byte after which to reconnect, s.
        waiting: Maximum number of buffered images; older ones are dropped.
    """

    def __init__(
        self,
        host: str,
        port: int = PORT,
        *,
        shape: tuple[int, int] = SHAPE,
        clock: Callable[[], float] = time.monotonic,
        silence: float = SILENCE_TIMEOUT,
        waiting: int = MAX_WAITING,
    ) -> None:
        self._host, self._port = host, port
        self._shape, self._clock = shape, clock
        self._silence, self._most = silence, waiting
        self._counts = Counts()
        self._lock = threading.Lock()  # for `_waiting`
        self._waiting: deque[Shot] = deque()
        self._connected, self._closed = threading.Event(), threading.Event()
        self._fault = "not connected yet"
        self._thread = threading.Thread(target=self._run, name=f"camera {host}", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> Counts:
        """A snapshot of the stream's counters."""
        return dataclasses.replace(self._counts)

    @property
    def fault(self) -> str | None:
        """Why the deck is not connected; None while it is."""
        return None if self._connected.is_set() else f"{self._host}:{self._port}: {self._fault}"

    def reached(self, within: float) -> bool:
        """Wait up to `within` s for the connection; return whether there is one."""
        return self._connected.wait(within)

    def arrived(self) -> list[Shot]:
        """Return the images that arrived since the last call, oldest first, without waiting."""
        with self._lock:
            shots = list(self._waiting)
            self._waiting.clear()
        return shots

    def hang_up(self) -> None:
        """Make the thread end, without waiting for it."""
        self._closed.set()

    def close(self) -> None:
        """End the thread and wait for it. Safe to call twice."""
        self.hang_up()
        self._thread.join(CLOSE_TIMEOUT)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _run(self) -> None:
        try:
            while not self._closed.is_set():
                self._call()
                self._connected.clear()
                self._closed.wait(RETRY_PERIOD)
        finally:
            self._connected.clear()

    def _call(self) -> None:
        """Connect and read until the connection ends; record the reason."""
        try:
            with socket.create_connection((self._host, self._port), CONNECT_TIMEOUT) as deck:
                self._counts.connections += 1
                self._connected.set()
                self._fault = self._read(deck)
        except (OSError, OverflowError, UnicodeError) as error:  # the last two: invalid address
            self._fault = str(getattr(error, "strerror", None) or error)

    def _read(self, deck: socket.socket) -> str:
        """Read until the stream ends; return the reason.

        Raises:
            OSError: The connection broke.
        """
        deck.settimeout(RETRY_PERIOD)  # so that `close` is noticed
        stream, heard = Stream(self._shape, self._counts), time.monotonic()
        try:
            while not self._closed.is_set():
                with suppress(TimeoutError):
                    data = deck.recv(CHUNK)
                    if not data:
                        return "closed by the deck"
                    heard = time.monotonic()
                    for shot in stream.feed(data, self._clock()):
                        self._keep(shot)
                if time.monotonic() - heard > self._silence:
                    return f"silent for {self._silence:g} s"
            return "closed"
        finally:
            stream.end()

    def _keep(self, shot: Shot) -> None:
        with self._lock:
            if len(self._waiting) >= self._most:
                self._waiting.popleft()
                self._counts.dropped += 1
            self._waiting.append(shot)
