"""Images come out of a deck's stream whole or not at all, whatever else is in it."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import Image
from star_fleet.aideck import framed
from star_fleet.cpx import Function, Packet, Target, encode
from star_radio.camera.stream import Counts, Stream

SHAPE = (244, 324)
SMALL = (48, 64)


def app(data: bytes) -> bytes:
    return encode(Packet(Target.GAP8, Target.HOST, Function.APP, data))


def head(width: int, height: int, form: int, size: int) -> bytes:
    return app(struct.pack("<BHHBBI", 0xBC, width, height, 1, form, size))


def small(seed: int) -> Image:
    return np.random.default_rng(seed).integers(0, 256, SMALL, np.uint8)


def read(stream: bytes, shape: tuple[int, int] = SMALL) -> tuple[list[Image], Counts]:
    counts = Counts()
    return [a.image for a in Stream(shape, counts).feed(stream, 0.0)], counts


# What is right


def test_a_raw_image_is_79_packets() -> None:
    stream = framed(np.zeros(SHAPE, np.uint8))
    assert len(stream) == 79 * 4 + 11 + 244 * 324


@given(st.lists(st.integers(0, 99), max_size=4), st.lists(st.integers(0, 5000), max_size=9))
def test_raw_images_survive_any_fragmentation_of_the_stream(
    seeds: list[int], sizes: list[int]
) -> None:
    counts = Counts()
    stream, images = Stream(SMALL, counts), []
    rest = b"".join(framed(small(seed)) for seed in seeds)
    for size in [*sizes, len(rest)]:
        images += [a.image for a in stream.feed(rest[:size], 0.0)]
        rest = rest[size:]
    assert len(images) == len(seeds)
    assert all((i == small(seed)).all() for i, seed in zip(images, seeds, strict=True))
    assert counts == Counts(images=len(seeds))


def test_a_jpeg_image_comes_out_nearly_as_it_went_in(picture: Image) -> None:
    (image,), counts = read(framed(picture, jpeg=True), SHAPE)
    assert abs(image.astype(int) - picture).max() <= 4
    assert counts == Counts(images=1)


def test_a_jpeg_image_in_three_parts_of_any_length_comes_out(picture: Image) -> None:
    body = cv2.imencode(".jpg", picture)[1].tobytes()
    parts = [body[:623], body[623:-2], body[-2:]]  # as the deck sends it: header, body, footer
    chunks = [parts[1][i : i + 1020] for i in range(0, len(parts[1]), 1020)]
    frames = [head(324, 244, 1, len(body)), *map(app, [parts[0], *chunks, b"", parts[2]])]
    assert len(read(b"".join(frames), SHAPE)[0]) == 1


def test_the_transfer_is_timed_from_the_first_packet_to_the_last() -> None:
    stream, whole = Stream(SMALL, Counts()), framed(small(0))
    assert stream.feed(whole[:20], 1.0) == []
    assert stream.feed(whole[20:-1], 1.2) == []
    (arrival,) = stream.feed(whole[-1:], 1.5)
    assert (arrival.began, arrival.arrived) == (1.0, 1.5)


def test_images_are_read_only() -> None:
    for jpeg in (False, True):
        (image,), _ = read(framed(small(0), jpeg=jpeg))
        assert not image.flags.writeable


def test_packets_of_other_functions_do_not_disturb_an_image() -> None:
    whole = framed(small(0))
    console = encode(Packet(Target.GAP8, Target.HOST, Function.CONSOLE, b"capture=59ms"))
    images, counts = read(whole[:15] + console + whole[15:])
    assert (len(images), counts) == (1, Counts(images=1))


def test_eleven_bytes_that_begin_like_a_head_may_be_pixels() -> None:
    pixels = small(0)
    pixels.reshape(-1)[-11:] = 0xBC
    body = pixels.tobytes()
    chunks = [body[i : i + 1020] for i in range(0, len(body) - 11, 1020)]
    chunks[-1] = chunks[-1][:-11]
    frames = [head(64, 48, 0, len(body)), *map(app, [*chunks, body[-11:]])]
    assert len(read(b"".join(frames))[0]) == 1


# What is wrong


@pytest.mark.parametrize(
    "wrong",
    [
        head(324, 324, 0, 324 * 324),
        head(64, 48, 0, 64 * 48 - 1),
        head(64, 48, 1, 0),
        head(64, 48, 1, 4_000_000_000),
    ],
    ids=["another size", "too few bytes", "nothing at all", "more bytes than pixels"],
)
def test_an_image_of_another_size_is_counted_and_dropped(wrong: bytes) -> None:
    images, counts = read(wrong + app(bytes(1000)) + framed(small(0)))
    assert (len(images), counts) == (1, Counts(images=1, wrong=1))


def test_an_image_that_is_cut_short_is_counted_and_dropped() -> None:
    images, counts = read(framed(small(1))[: 15 + 1024] + framed(small(0)))
    assert (images[0] == small(0)).all()
    assert counts == Counts(images=1, broken=1)


def test_an_image_that_is_too_long_is_counted_and_dropped() -> None:
    whole = framed(small(1))
    images, counts = read(whole[: 15 + 1024] + app(bytes(1020)) * 2 + framed(small(0)))
    assert (len(images), counts) == (1, Counts(images=1, broken=1))


def test_an_image_that_the_connection_ends_in_is_counted() -> None:
    counts = Counts()
    stream = Stream(SMALL, counts)
    stream.feed(framed(small(0))[:-1], 0.0)
    stream.end()
    assert counts == Counts(broken=1)


def test_a_jpeg_image_that_is_none_is_counted_and_dropped() -> None:
    bodies = [bytes(100), b"\xff\xd8" + bytes(96) + b"\xff\xd9"]
    frames = [head(64, 48, 1, len(body)) + app(body) for body in bodies]
    assert read(b"".join(frames)) == ([], Counts(broken=2))


def test_jpeg_images_of_an_unannounced_size_are_dropped(picture: Image) -> None:
    body = cv2.imencode(".jpg", picture[:32, :32])[1].tobytes()
    assert read(head(64, 48, 1, len(body)) + app(body)) == ([], Counts(broken=1))


def test_jpeg_images_with_a_huge_header_size_are_not_decoded(
    picture: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = cv2.imencode(".jpg", picture)[1].tobytes()
    size = struct.pack(">HH", 244, 324)
    assert body.count(size) == 1
    body = body.replace(size, struct.pack(">HH", 65_000, 65_000))
    monkeypatch.setattr(cv2, "imdecode", None)
    stream = head(324, 244, 1, len(body))
    stream += b"".join(app(body[i : i + 1020]) for i in range(0, len(body), 1020))
    assert read(stream, SHAPE) == ([], Counts(broken=1))


@given(st.lists(st.tuples(st.integers(0, 99_999), st.integers(0, 255)), min_size=1, max_size=9))
def test_corrupted_jpeg_images_are_whole_or_dropped(changes: list[tuple[int, int]]) -> None:
    body = bytearray(cv2.imencode(".jpg", small(0))[1].tobytes())
    for at, value in changes:
        body[at % len(body)] = value
    frames = [app(bytes(body[i : i + 1020])) for i in range(0, len(body), 1020)]
    images, counts = read(head(64, 48, 1, len(body)) + b"".join(frames))
    assert all(image.shape == SMALL for image in images)
    assert counts.images + counts.broken + counts.wrong == 1


def test_streams_joined_midway_resume_at_the_next_image() -> None:
    images, counts = read(framed(small(1))[2000:] + framed(small(0)))
    assert (images[0] == small(0)).all()
    assert counts.images == 1


@given(st.binary(min_size=1, max_size=40), st.integers(0, 3300))
def test_an_image_after_bytes_that_belong_nowhere_is_found(junk: bytes, at: int) -> None:
    whole = framed(small(1))
    images, _ = read(whole[:at] + b"\xff\xff" + junk + framed(small(0)) + framed(small(2)))
    assert any((image == small(2)).all() for image in images)


def test_a_thousand_malformed_frames_hide_no_image() -> None:
    random = np.random.default_rng(5)
    counts = Counts()
    stream, images = Stream(SMALL, counts), 0
    for _ in range(1000):
        frame = bytearray(app(random.bytes(int(random.integers(60)))))
        for _ in range(random.integers(1, 4)):
            frame[random.integers(len(frame))] = random.integers(256)
        stream.feed(bytes(frame), 0.0)
    stream.feed(b"\xff\xff" * 600, 0.0)  # longer than any frame: whatever it was in is over
    for seed in range(3):
        images += len(stream.feed(framed(small(seed)), 0.0))
    assert images == 3
    assert counts.malformed > 0


@given(st.lists(st.binary(max_size=300), max_size=6))
def test_what_is_left_over_never_grows_beyond_a_frame(pieces: list[bytes]) -> None:
    stream = Stream(SMALL, Counts())
    for piece in pieces:
        stream.feed(piece, 0.0)
        assert len(stream._rest) < 2 + 1022
