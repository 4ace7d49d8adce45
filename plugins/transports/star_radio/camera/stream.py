"""Decoder of an AI-deck's image stream; recovers from malformed data.

A frame of CPX over TCP is a u16 with the length of the rest, two bytes of routing
(``RSV:1 LP:1 source:3 destination:3``, ``version:2 function:6``) and data, little endian. An image
is one packet of function APP, ``0xBC, u16 width, u16 height, u8 depth, u8 form, u32 size``, and
then the packets whose data make up its ``size`` bytes (Bitcraze, aideck-gap8-examples,
``wifi-img-streamer.c``).
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np

from star_core import Image

MTU: Final = 1022  # bytes after the length, maximum of the AI-deck's ESP32
ROUTING: Final = 2  # bytes
LENGTH: Final = 2  # bytes of the length itself
APP: Final = 5
FUNCTIONS: Final = frozenset({1, 2, 3, 4, APP, 14, 15})  # defined by CPX
MAGIC: Final = 0xBC
DEPTH: Final = 1  # byte per pixel
RAW, JPEG = 0, 1
MAX_SIDE: Final = 4096  # px, plausible width or height of an image
JPEG_END: Final = b"\xff\xd9"

_FRAME: Final = struct.Struct("<HBB")
_HEAD: Final = struct.Struct("<BHHBBI")
_BEGINNING: Final = re.compile(rb"\x0d\x00.\x05\xbc", re.DOTALL)  # start of a frame with a header
_SIZE: Final = re.compile(rb"\xff[\xc0-\xc2]\x00[\x0b\x11]\x08(....)", re.DOTALL)  # SOF, ITU T.81
_OVERLAP: Final = 4  # bytes at the end of a chunk that may be an incomplete `_BEGINNING`


class Shot(NamedTuple):
    """One complete image.

    Attributes:
        image: (height, width) grey values, read-only.
        began: Shot of its first packet, s.
        arrived: Shot of its last packet, s.
    """

    image: Image
    began: float
    arrived: float


@dataclass(slots=True)
class Counts:
    """Counters of a camera's stream.

    Attributes:
        images: Complete images.
        wrong: Images of another size or format than this camera's.
        broken: Images with missing or surplus data, or that could not be decoded.
        malformed: Invalid frames, and resynchronisations of the stream.
        dropped: Images that were not fetched in time.
        connections: Connections made to the deck.
    """

    images: int = 0
    wrong: int = 0
    broken: int = 0
    malformed: int = 0
    dropped: int = 0
    connections: int = 0


class _Head(NamedTuple):
    magic: int
    width: int
    height: int
    depth: int
    form: int
    size: int


class Stream:
    """Decoder of one connection's bytes, in chunks of any size.

    Args:
        shape: Height and width of the images, px.
        counts: Counters to update.
    """

    def __init__(self, shape: tuple[int, int], counts: Counts) -> None:
        self._shape, self._counts = shape, counts
        self._rest = b""
        self._lost = False
        self._head: _Head | None = None
        self._body = bytearray()
        self._began = 0.0

    def feed(self, data: bytes, now: float) -> list[Shot]:
        """Return the images completed by `data`, which arrived at `now`, s.

        After an invalid length, decoding resumes at the start of the next image.
        """
        stream, at, arrivals = self._rest + data, 0, list[Shot]()
        view = memoryview(stream)
        while True:
            if self._lost:
                at = self._beginning(stream, at)
            if self._lost or len(stream) - at < LENGTH + ROUTING:
                break
            length, _, function = _FRAME.unpack_from(stream, at)
            if not ROUTING <= length <= MTU:
                self._counts.malformed += 1
                self._abandon()
                self._lost = True
                continue
            end = at + LENGTH + length
            if end > len(stream):
                break
            if function == APP:
                self._take(view[at + LENGTH + ROUTING : end], now, arrivals)
            elif function not in FUNCTIONS:  # also of another version, in the upper bits
                self._counts.malformed += 1
            at = end
        self._rest = stream[at:]
        return arrivals

    def end(self) -> None:
        """End the stream; an incomplete image is counted as broken."""
        self._abandon()

    def _beginning(self, stream: bytes, at: int) -> int:
        """Return the offset of the next image, or near the end of the data if there is none."""
        match = _BEGINNING.search(stream, at)
        self._lost = match is None
        return max(at, len(stream) - _OVERLAP) if match is None else match.start()

    def _take(self, data: memoryview, now: float, arrivals: list[Shot]) -> None:
        head = _head(data)
        if head is not None:
            self._abandon()
            if self._expected(head):
                self._head, self._began = head, now
            else:
                self._counts.wrong += 1
        elif self._head is not None:
            self._body += data
            if len(self._body) > self._head.size:
                self._abandon()
            elif len(self._body) == self._head.size:
                self._finish(self._head, now, arrivals)

    def _expected(self, head: _Head) -> bool:
        pixels = head.width * head.height
        size = head.size == pixels if head.form == RAW else 0 < head.size <= pixels
        return size and (head.height, head.width) == self._shape

    def _finish(self, head: _Head, now: float, arrivals: list[Shot]) -> None:
        body = bytes(self._body)
        self._head, self._body = None, bytearray()
        image = _raw(body, self._shape) if head.form == RAW else _jpeg(body, self._shape)
        if image is None:
            self._counts.broken += 1
            return
        image.flags.writeable = False
        self._counts.images += 1
        arrivals.append(Shot(image, self._began, now))

    def _abandon(self) -> None:
        if self._head is not None:
            self._counts.broken += 1
            self._head, self._body = None, bytearray()


def _head(data: memoryview) -> _Head | None:
    """Return the image header in a packet; None if it is not a header."""
    if len(data) != _HEAD.size or data[0] != MAGIC:
        return None
    head = _Head(*_HEAD.unpack(data))
    sane = head.depth == DEPTH and head.form in {RAW, JPEG}
    return head if sane and 0 < head.width <= MAX_SIDE and 0 < head.height <= MAX_SIDE else None


def _raw(body: bytes, shape: tuple[int, int]) -> Image:
    return np.frombuffer(body, np.uint8).reshape(shape)


def _jpeg(body: bytes, shape: tuple[int, int]) -> Image | None:
    size = _SIZE.search(body)  # checked first: a corrupt size could exhaust memory
    if size is None or struct.unpack(">HH", size[1]) != shape:
        return None
    if not body.endswith(JPEG_END):  # OpenCV fills what is missing with grey
        return None
    try:
        image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        return None
    return np.asarray(image, np.uint8) if image is not None and image.shape == shape else None
