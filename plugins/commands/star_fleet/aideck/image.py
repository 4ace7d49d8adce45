"""An image as the AI-deck's stock streamer sends it."""

from __future__ import annotations

import struct
from typing import Final

import cv2
import numpy as np

from star_core import Image
from star_fleet.cpx import ROOM, Function, Packet, Target, encode

MAGIC: Final = 0xBC
DEPTH: Final = 1  # byte a pixel
RAW, JPEG = 0, 1
QUALITY: Final = 90  # of 100, of a JPEG image

_HEAD: Final = struct.Struct("<BHHBBI")  # magic, width, height, depth, form, size


def framed(image: Image, *, jpeg: bool = False) -> bytes:
    """Return an image's frames, ready to be sent.

    One packet contains width, height, depth, format and size, and the following ones only the bytes
    of the image (Bitcraze, aideck-gap8-examples, ``wifi-img-streamer.c``). The header has no field
    for the time of the exposure.

    Args:
        image: (height, width) grey values.
        jpeg: Whether to compress it.
    """
    height, width = image.shape
    if jpeg:
        body = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    else:
        body = np.ascontiguousarray(image).tobytes()
    head = _HEAD.pack(MAGIC, width, height, DEPTH, JPEG if jpeg else RAW, len(body))
    starts = range(0, len(body), ROOM)
    chunks = (body[start : start + ROOM] for start in starts)
    return _frame(head, last=True) + b"".join(
        _frame(chunk, last=start == starts[-1]) for start, chunk in zip(starts, chunks, strict=True)
    )


def _frame(data: bytes, *, last: bool) -> bytes:
    return encode(Packet(Target.GAP8, Target.HOST, Function.APP, data, last))
