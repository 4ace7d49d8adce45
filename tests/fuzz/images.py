"""Targets: the stream of an AI-deck's camera, and the JPEG images in it.

Images come out whole or not at all, everything else is counted, and the buffer is bounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from star_core import Image
from star_fleet.aideck import framed
from star_fleet.cpx import ROOM, Function, Packet, encode
from star_fleet.cpx import Target as Processor
from star_radio.camera.stream import MTU, Counts, Stream
from tests.fuzz.harness import Draw, Target, Try
from tests.fuzz.mutants import damaged

SHAPE: Final = (48, 64)


def picture(seed: int) -> Image:
    """Return an image of blurred noise, which JPEG takes well."""
    noise = np.random.default_rng(seed).integers(0, 256, SHAPE, np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), 3), np.uint8)


@contextmanager
def streams(_folder: Path) -> Iterator[Try]:
    """Two images with faults, in pieces; of two good ones after them the second is found."""
    originals = [framed(picture(seed), jpeg=jpeg) for seed in (1, 2) for jpeg in (False, True)]
    good = framed(picture(3))
    counts = Counts()
    stream = Stream(SHAPE, counts)

    def attempt(draw: Draw) -> str:
        data = damaged(draw.choice(originals) + draw.choice(originals), draw)
        images = counts.images
        while data:
            size = draw.choice((1, 7, 500, 5000))
            for shot in stream.feed(data[:size], 0.0):
                assert shot.image.shape == SHAPE
            assert len(stream._rest) < MTU + 2
            assert len(stream._body) <= SHAPE[0] * SHAPE[1]
            data = data[size:]
        new_images = counts.images - images
        lost_frame = b"\xff\xff" * (MTU // 2 + 1)  # whatever frame it was in is over
        assert stream.feed(lost_frame + good + good, 0.0)
        return f"{new_images} images"

    yield attempt


@contextmanager
def jpegs(_folder: Path) -> Iterator[Try]:
    """A JPEG image with faults, in a stream without."""
    bodies = [cv2.imencode(".jpg", picture(seed))[1].tobytes() for seed in range(5)]

    def attempt(draw: Draw) -> str:
        body = damaged(draw.choice(bodies), draw)[: SHAPE[0] * SHAPE[1]] or b"\0"
        if draw.random() < 0.5:  # the end is what is checked first
            body = body[:-2] + b"\xff\xd9"
        counts = Counts()
        shots = Stream(SHAPE, counts).feed(_stream(body), 0.0)
        assert all(shot.image.shape == SHAPE for shot in shots)
        assert counts.images == len(shots)
        assert counts.images + counts.broken + counts.wrong == 1
        return "image" if shots else "dropped"

    yield attempt


def _stream(body: bytes) -> bytes:
    head = framed(picture(0), jpeg=True)[:15]
    head = head[:-4] + len(body).to_bytes(4, "little")
    return head + b"".join(
        encode(Packet(Processor.GAP8, Processor.HOST, Function.APP, body[at : at + ROOM]))
        for at in range(0, len(body), ROOM)
    )


TARGETS: Final = (
    Target("camera stream", 200, 20_000, streams),
    Target("JPEG images", 300, 50_000, jpegs),
)
