"""What a simulated Crazyflie's AI-deck serves over TCP: its camera, and the drone's own link."""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from typing import Final

import cv2
import numpy as np

from star_core import Image, Scene
from star_fleet.cpx import ROOM, Function, Packet, Switchboard, Target, TcpPort, encode
from star_fleet.server import Fleet

PORT: Final = 5000  # of an AI-deck's ESP32
MAGIC, DEPTH = 0xBC, 1
RAW, JPEG = 0, 1
QUALITY: Final = 90  # of 100, of a JPEG image
MAX_PACKET: Final = 31  # bytes of a CRTP packet, its header included
MAX_WAITING: Final = 2000  # packets: 2 s of a busy link

_HEAD: Final = struct.Struct("<BHHBBI")  # magic, width, height, depth, form, size


class AideckServer(TcpPort):
    """Streams images to one client at a time, from the moment it connects.

    Sending never blocks: while a client is still receiving an image, one more waits, and a newer
    one replaces it. So a slow client misses whole images, and those it receives are complete.

    Attributes:
        dropped: Number of images that a client has missed.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = PORT,
        *,
        jpeg: bool = False,
        switchboard: Switchboard | None = None,
    ) -> None:
        super().__init__(host, port, 1, switchboard)
        self._jpeg = jpeg
        self.dropped = 0
        self._counting = threading.Lock()

    def publish(self, image: Image, taken: float) -> None:
        """Send an image to the client, if there is one, without waiting.

        Args:
            image: (height, width) grey values.
            taken: Time of the exposure, s; the deck's format has no field for it.
        """
        if self.connected:
            message = framed(image, jpeg=self._jpeg)
            with self._counting:
                self.dropped += self.put(message)


class CrtpOverTcp(TcpPort):
    """Serves one vehicle's CRTP to one client at a time, such as cflib's ``tcp://HOST:PORT``.

    cflib sends nothing twice over TCP, so no packet may be lost: a client that leaves `MAX_WAITING`
    packets unread is disconnected instead.

    Args:
        host: Address of the interface.
        port: Number; 0 for any that is free.
        handle: Answers a CRTP packet with CRTP packets, in the switchboard's thread. If it raises,
            the client is disconnected.
        switchboard: Shared switchboard; the port has its own if not given.
    """

    def __init__(
        self,
        host: str,
        port: int,
        handle: Callable[[bytes], Iterable[bytes]],
        *,
        switchboard: Switchboard | None = None,
    ) -> None:
        self._handle = handle
        super().__init__(host, port, MAX_WAITING, switchboard)

    def push(self, packet: bytes) -> None:
        """Send an unsolicited CRTP packet, such as a log report, from any thread."""
        if self.put(encode(Packet(Target.STM32, Target.HOST, Function.CRTP, packet))):
            self.hang_up()

    def heard(self, packet: Packet) -> None:
        if packet.function is Function.CRTP and 0 < len(packet.data) <= MAX_PACKET:
            for answer in self._handle(packet.data):
                self.push(answer)


def framed(image: Image, *, jpeg: bool = False) -> bytes:
    """Return the frames of a (height, width) image, ready to be sent.

    One packet contains width, height, depth, format and size, and the following ones only the bytes
    of the image (Bitcraze, aideck-gap8-examples, ``wifi-img-streamer.c``). The header has no field
    for the time of the exposure.
    """
    height, width = image.shape
    if jpeg:
        body = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    else:
        body = np.ascontiguousarray(image).tobytes()
    head = _HEAD.pack(MAGIC, width, height, DEPTH, JPEG if jpeg else RAW, len(body))
    chunks = [body[start : start + ROOM] for start in range(0, len(body), ROOM)]
    return _frame(head) + b"".join(_frame(chunk, chunk is chunks[-1]) for chunk in chunks)


def _frame(data: bytes, last: bool = True) -> bytes:  # noqa: FBT001, FBT002
    return encode(Packet(Target.GAP8, Target.HOST, Function.APP, data, last))


class Wifi:
    """TCP ports for the agents of a fleet, in the order of their rows.

    Args:
        fleet: Fleet whose vehicles are reached, and whose cameras are streamed.
        scene: That of the fleet.
        host: Address to serve at.
        links: Port of the first agent's link, 0 for free ones; None for no links.
        cameras: Port of the first camera, 0 for free ones; None for no cameras.
        jpeg: Whether cameras compress their images.

    Attributes:
        links: ``tcp://host:port`` by the row of the agent.
        cameras: ``host:port`` by the row of the agent, of those that have a camera.

    Raises:
        PluginError: A port is not available.
    """

    def __init__(
        self,
        fleet: Fleet,
        scene: Scene,
        host: str,
        *,
        links: int | None,
        cameras: int | None,
        jpeg: bool = False,
    ) -> None:
        self.links: dict[int, str] = {}
        self.cameras: dict[int, str] = {}
        opened: dict[int, CrtpOverTcp] = {}
        decks: dict[int, AideckServer] = {}
        with ExitStack() as stack:
            board = Switchboard()
            stack.callback(board.close)
            for row, agent in enumerate(scene.agents):
                if links is not None:
                    handle, port = partial(fleet.handle, row, tcp=True), links and links + row
                    opened[row] = CrtpOverTcp(host, port, handle, switchboard=board)
                    stack.callback(opened[row].close)
                    self.links[row] = "tcp://{}:{}".format(*opened[row].address)
                if cameras is not None and agent.camera is not None:
                    port = cameras and cameras + len(decks)
                    decks[row] = AideckServer(host, port, jpeg=jpeg, switchboard=board)
                    stack.callback(decks[row].close)
                    self.cameras[row] = "{}:{}".format(*decks[row].address)
            self._opened = stack.pop_all()
        for row, link in opened.items():
            fleet.listen(row, link.push)
        for row, deck in decks.items():  # while no client is connected, no images are rendered
            fleet.watch(row, deck.publish, partial(getattr, deck, "connected"))

    def close(self) -> None:
        """Disconnect all clients and close the ports."""
        self._opened.close()
