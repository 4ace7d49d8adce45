"""Reads pictures and finds the board in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np

from star_calibrate.board import Board, Corners
from star_core import Image, InputError

SIDES: Final = range(16, 4097)  # px: what a mission's cameras may have


class View(NamedTuple):
    """A picture in which the board was found.

    Attributes:
        name: Its file's.
        corners: (K, 2) the board's inner corners, row by row, px.
    """

    name: str
    corners: Corners


class Views(NamedTuple):
    """What was seen in all pictures.

    Attributes:
        width: Of every picture, px.
        height: px.
        found: Those with the board.
        without: Names of the files in which it was not found.
    """

    width: int
    height: int
    found: tuple[View, ...]
    without: tuple[str, ...]


def look(names: Sequence[str], board: Board) -> Views:
    """Find the board in pictures.

    Raises:
        InputError: Files cannot be read, or their sizes differ or are no camera's; every one is
            named.
    """
    problems: list[str] = []
    images: dict[str, Image] = {}
    for name in names:
        try:
            images[name] = _read(name)
        except InputError as error:
            problems += error.problems
    problems += [f"{name}: is there twice" for name in _twice(names)]
    problems += list(_sizes(images))
    if problems:
        raise InputError(problems)
    height, width = next(iter(images.values())).shape
    seen = {name: board.find(image) for name, image in images.items()}
    return Views(
        width,
        height,
        tuple(View(name, corners) for name, corners in seen.items() if corners is not None),
        tuple(name for name, corners in seen.items() if corners is None),
    )


def _read(name: str) -> Image:
    try:
        content = Path(name).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError([f"{name}: cannot be read: {reason}"]) from error
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:  # an empty file
        image = None
    if image is None:
        raise InputError([f"{name}: is no picture that can be read; expected PNG, JPEG, PGM, ..."])
    return np.asarray(image, np.uint8)


def _sizes(images: dict[str, Image]) -> Iterator[str]:
    """Yield what is wrong with the sizes of pictures."""
    if not images:
        return
    first, example = next(iter(images.items()))
    if not all(side in SIDES for side in example.shape):
        yield (
            f"{first}: is {_size(example)} px, expected {SIDES[0]} to {SIDES[-1]} px each way,"
            " as missions have it"
        )
    for name, image in images.items():
        if image.shape != example.shape:
            yield f"{name}: is {_size(image)} px, but {first} is {_size(example)}"


def _size(image: Image) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"


def _twice(names: Sequence[str]) -> list[str]:
    return [name for name in dict.fromkeys(names) if names.count(name) > 1]
