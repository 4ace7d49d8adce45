"""The camera of one simulated AI-deck, streamed over TCP as the deck does."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Final, Self

import numpy as np

from star_core import ContractError, Image
from star_fleet.aideck.image import framed
from star_fleet.aideck.switchboard import Switchboard, listen
from star_fleet.cpx import Packet

PORT: Final = 5000  # of an AI-deck's ESP32
SHAPE: Final = (244, 324)  # height and width of an HM01B0's image, px
WAITING: Final = 1  # images behind the one that is being sent


class AideckServer:
    """Streams images to one client at a time, from the moment it connects.

    Sending never blocks: while a client is still receiving an image, one more waits, and a newer
    one replaces it. So a slow client misses whole images, and those it receives are complete.

    Args:
        host: Address of the interface.
        port: Number; 0 for any that is free.
        shape: Height and width of the images, px.
        jpeg: Whether to compress them.
        switchboard: Shared switchboard; it has its own if not given.

    Attributes:
        address: Host and port on which it listens.
        dropped: Number of images that a client has missed.

    Raises:
        PluginError: The port cannot be had.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = PORT,
        *,
        shape: tuple[int, int] = SHAPE,
        jpeg: bool = False,
        switchboard: Switchboard | None = None,
    ) -> None:
        self._shape, self._jpeg = shape, jpeg
        self._port = listen(host, port, _ignore, switchboard)
        self.address = self._port.address
        self.dropped = 0
        self._lock = threading.Lock()

    @property
    def connected(self) -> bool:
        """Whether a client is there."""
        return self._port.connected

    def publish(self, image: Image, taken: float) -> None:
        """Send an image to the client, if there is one, without waiting.

        Args:
            image: (height, width) grey values.
            taken: When it was taken, s. The deck's format has no place for it, so it goes no
                further; it is asked for so that a format which has one can take this one's place.

        Raises:
            ContractError: The image has another shape or other values.
        """
        if image.shape != self._shape or image.dtype != np.uint8:
            raise ContractError(
                f"image of an AI-deck has shape {image.shape} and dtype {image.dtype}, expected"
                f" {self._shape} and uint8"
            )
        if not self._port.connected:
            return
        message = framed(image, jpeg=self._jpeg)
        with self._lock:
            self.dropped += self._port.put(message, WAITING)

    def close(self) -> None:
        """Hang up and stop listening. Safe to call twice."""
        self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _ignore(packet: Packet) -> None:
    """Hear nothing: the stock streamer takes no orders."""
