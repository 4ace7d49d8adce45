"""One AI-deck's camera, read in a thread so that nobody waits for it."""

from __future__ import annotations

import dataclasses
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Final, NamedTuple, Self

from star_core import Image
from star_radio.camera.address import PORT
from star_radio.camera.stream import Arrival, Counts, Stream

LATENCY: Final = 0.15  # s: how late the original STAR's images were
SHAPE: Final = (244, 324)  # height and width of an HM01B0's image, px
CHUNK: Final = 65_536  # bytes to read at a time
CONNECTING: Final = 0.5  # s to wait for an answer; with the pause, a deck is back within 1 s
PAUSE: Final = 0.25  # s from one try to the next
SILENCE: Final = 2.0  # s without a byte, after which a deck is called anew; they send 8 images a s
WAITING: Final = 8  # images: 1 s of a deck's stream
CLOSING: Final = 2.0  # s to wait for the thread


class Shot(NamedTuple):
    """An image, and when.

    Attributes:
        image: (height, width) grey values, read-only.
        arrived: When all of it was here, s.
        taken: When it was taken, as well as that can be known, s.
    """

    image: Image
    arrived: float
    taken: float


class CameraClient:
    """Reads one deck's stream, and calls it again within a second when it is lost.

    The stock streamer does not say when an image was taken. It is taken to be `latency` before the
    image's first packet was here, so the time that the transfer needs, from the first packet to the
    last, counts as measured, and `latency` is what lies before it: the second half of the exposure,
    the read-out and, with JPEG, the compression.

    Args:
        host: The deck's address.
        port: Number.
        shape: Height and width of its images, px.
        latency: From the middle of the exposure to the first packet, s.
        clock: What times are told by, s.
        silence: After how long without a byte the deck is called anew, s.
        waiting: How many images may wait to be fetched; older ones are dropped.
    """

    def __init__(
        self,
        host: str,
        port: int = PORT,
        *,
        shape: tuple[int, int] = SHAPE,
        latency: float = LATENCY,
        clock: Callable[[], float] = time.monotonic,
        silence: float = SILENCE,
        waiting: int = WAITING,
    ) -> None:
        self._host, self._port = host, port
        self._shape, self._latency, self._clock = shape, latency, clock
        self._silence, self._most = silence, waiting
        self._counts = Counts()
        self._lock = threading.Lock()  # for what waits
        self._waiting: deque[Shot] = deque()
        self._there, self._closed = threading.Event(), threading.Event()
        self._fault = "not called yet"
        self._thread = threading.Thread(target=self._run, name=f"camera {host}", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> Counts:
        """What the stream has brought so far, as it is now."""
        return dataclasses.replace(self._counts)

    @property
    def fault(self) -> str | None:
        """Why the deck is not there; None while it is."""
        return None if self._there.is_set() else f"{self._host}:{self._port}: {self._fault}"

    def reached(self, within: float) -> bool:
        """Wait until the deck is there, but at most `within` s, and say whether it is."""
        return self._there.wait(within)

    def arrived(self) -> list[Shot]:
        """Return the images that arrived since the last call, oldest first, without waiting."""
        with self._lock:
            shots = list(self._waiting)
            self._waiting.clear()
        return shots

    def hang_up(self) -> None:
        """Have the thread end, without waiting for it."""
        self._closed.set()

    def close(self) -> None:
        """Hang up and wait for the thread to end. Safe to call twice."""
        self.hang_up()
        self._thread.join(CLOSING)

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
                self._there.clear()
                self._closed.wait(PAUSE)
        finally:
            self._there.clear()

    def _call(self) -> None:
        """Read the deck for as long as it is there, and keep why it no longer is."""
        try:
            with socket.create_connection((self._host, self._port), CONNECTING) as deck:
                self._counts.connections += 1
                self._there.set()
                self._fault = self._read(deck)
        except (OSError, OverflowError, UnicodeError) as error:  # the last two: no such address
            self._fault = str(getattr(error, "strerror", None) or error)

    def _read(self, deck: socket.socket) -> str:
        """Read until there is no more, and return why.

        Raises:
            OSError: The connection broke.
        """
        deck.settimeout(PAUSE)  # how soon a `close` is seen
        stream, heard = Stream(self._shape, self._counts), time.monotonic()
        try:
            while not self._closed.is_set():
                with suppress(TimeoutError):
                    data = deck.recv(CHUNK)
                    if not data:
                        return "closed by the deck"
                    heard = time.monotonic()
                    for arrival in stream.feed(data, self._clock()):
                        self._keep(arrival)
                if time.monotonic() - heard > self._silence:
                    return f"silent for {self._silence:g} s"
            return "closed"
        finally:
            stream.end()

    def _keep(self, arrival: Arrival) -> None:
        with self._lock:
            if len(self._waiting) >= self._most:
                self._waiting.popleft()
                self._counts.dropped += 1
            self._waiting.append(
                Shot(arrival.image, arrival.arrived, arrival.began - self._latency)
            )
