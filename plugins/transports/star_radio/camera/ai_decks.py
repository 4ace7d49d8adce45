"""The swarm's AI-decks: connections that read images, collected as `Frames`; lost cameras."""

from __future__ import annotations

import dataclasses
import logging
import socket
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from star_core import Frames, Image, Scene
from star_radio.address import host_and_port
from star_radio.camera.stream import Counts, Shot, Stream

log = logging.getLogger(__name__)


class AiDecks:
    """One client for each agent with a camera.

    A deck that is unreachable, disconnects or sends images of the wrong size causes one warning,
    and another only after an image of it has arrived again.

    The stock streamer sends no timestamps. An exposure is assumed to be `latency` before the
    arrival of the image's first packet: the second half of the exposure, the read-out and, with
    JPEG, the compression. The duration of the transfer is measured.

    Args:
        scene: The agents with their cameras.
        addresses: host or host:port, by the agent's name.
        latency: From the middle of the exposure to the first packet of an image, s.
    """

    def __init__(self, scene: Scene, addresses: Mapping[str, str], latency: float) -> None:
        self._latency = latency
        self._decks: dict[int, _AiDeck] = {}
        for row, agent in enumerate(scene.agents):
            if agent.name in addresses:
                host, port = host_and_port(addresses[agent.name])
                camera = agent.camera
                shape = (camera.height, camera.width) if camera else SHAPE
                client = CameraClient(host, port, shape=shape)
                self._decks[row] = _AiDeck(agent.name, shape, client)

    def connect(self, timeout: float) -> None:
        """Wait up to `timeout` s until all decks are connected; warn of those that are not.

        A missing camera does not ground its agent.
        """
        until = time.monotonic() + timeout
        for deck in self._decks.values():
            deck.client.reached(max(0.0, until - time.monotonic()))
        for deck in self._decks.values():
            deck.watch(has_image=False)

    def survey(self, timeout: float) -> dict[int, tuple[Image | None, str]]:
        """Wait up to `timeout` s for an image of each deck.

        Returns:
            By row, the newest image, None without one, and then the reason.
        """
        until = time.monotonic() + timeout
        images: dict[int, Image] = {}
        while len(images) < len(self._decks) and time.monotonic() < until:
            for row, deck in self._decks.items():
                if shots := deck.client.arrived():
                    images[row] = shots[-1].image
            time.sleep(POLL_PERIOD)
        silent = f"no image in {timeout:g} s"
        return {
            row: (images.get(row), "" if row in images else deck.fault() or silent)
            for row, deck in self._decks.items()
        }

    def frames(self, began: float) -> Frames:
        """Return the images since the last call.

        Args:
            began: When mission time was 0, s of the computer's clock.
        """
        shots = []
        for row, deck in self._decks.items():
            arrived = deck.client.arrived()
            deck.watch(has_image=bool(arrived))
            shots += [(row, shot) for shot in arrived]
        shots.sort(key=lambda shot: shot[1].arrived)
        if not shots:
            return Frames.none()
        return Frames(
            agent=np.array([row for row, _shot in shots]),
            taken=np.array([shot.began - self._latency - began for _row, shot in shots]),
            arrived=np.array([shot.arrived - began for _row, shot in shots]),
            image=tuple(shot.image for _row, shot in shots),
        )

    def close(self) -> None:
        """Close all connections."""
        for deck in self._decks.values():
            deck.client.hang_up()
        for deck in self._decks.values():
            deck.client.close()


@dataclass(slots=True)
class _AiDeck:
    """One deck, and whether its loss has been logged."""

    name: str
    shape: tuple[int, int]
    client: CameraClient
    lost: bool = False

    def watch(self, *, has_image: bool) -> None:
        """Log when the camera is lost and when it is back.

        Args:
            has_image: Whether an image has just arrived. Only that counts as back: a deck that
                accepts connections and sends nothing would otherwise alternate between back and
                lost.
        """
        if has_image:
            if self.lost:
                log.info("radio: the camera of %s is back", self.name)
            self.lost = False
        elif not self.lost and (why := self.fault()) is not None:
            log.warning("radio: the camera of %s is not available: %s", self.name, why)
            self.lost = True

    def fault(self) -> str | None:
        """Return why no image can arrive; None if one can."""
        fault = self.client.fault
        if fault is None and (counts := self.client.counts).wrong and not counts.images:
            height, width = self.shape
            return f"it sends images that are not {width} x {height} px"
        return fault


SHAPE: Final = (244, 324)  # height and width of an HM01B0 image, px
CHUNK: Final = 65_536  # bytes per read
CONNECT_TIMEOUT: Final = 0.5  # s; with the pause, a deck is reconnected within 1 s
RETRY_PERIOD: Final = 0.25  # s, between two connection attempts
SILENCE_TIMEOUT: Final = 2.0  # s without a byte, then reconnect; decks send 8 images per second
POLL_PERIOD: Final = 0.02  # s, between two looks for the first images
MAX_WAITING: Final = 8  # images: 1 s of a deck's stream; of more, the oldest is dropped
CLOSE_TIMEOUT: Final = 2.0  # s, for the thread to end


class CameraClient:
    """Reads one deck's images of a shape, (height, width) px; reconnects within a second."""

    def __init__(self, host: str, port: int, shape: tuple[int, int] = SHAPE) -> None:
        self._host, self._port, self._shape = host, port, shape
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

    def __exit__(self, *_error: object) -> None:
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
                    for shot in stream.feed(data, time.monotonic()):
                        self._keep(shot)
                if time.monotonic() - heard > SILENCE_TIMEOUT:
                    return f"silent for {SILENCE_TIMEOUT:g} s"
            return "closed"
        finally:
            stream.end()

    def _keep(self, shot: Shot) -> None:
        with self._lock:
            if len(self._waiting) >= MAX_WAITING:
                self._waiting.popleft()
                self._counts.dropped += 1
            self._waiting.append(shot)
