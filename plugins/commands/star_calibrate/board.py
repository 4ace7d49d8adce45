"""The chessboard of a calibration, and images of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from star_core import Array, Image, InputError
from star_core.toolkit import Progress, gray_from_mosaic

Corners = NDArray[np.float32]
"""(K, 2) px."""

WINDOW: Final = 0.45  # half width of the refinement, of the least distance between corners
MIN_WINDOW, MAX_WINDOW = 2, 11  # px
CRITERIA: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)  # px
SIDES: Final = range(16, 4097)  # px, of a mission's cameras


class Board(NamedTuple):
    """A printed chessboard."""

    columns: int  # inner corners along a row: one less than its squares
    rows: int  # inner corners along a column
    square: float  # edge of a square, m

    @property
    def points(self) -> Array:
        """(K, 3) its inner corners, row by row, z = 0, m.

        >>> Board(3, 2, 0.5).points[:, :2].tolist()
        [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [0.0, 0.5], [0.5, 0.5], [1.0, 0.5]]
        """
        row, column = np.indices((self.rows, self.columns)).reshape(2, -1)
        return self.square * np.stack([column, row, 0.0 * row], axis=1)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"

    def find(self, image: Image) -> Corners | None:
        """Return its inner corners in an image, row by row; None unless all are visible.

        OpenCV's newer detector is used if its older one fails. The corners of both are refined by
        the gradients around them, in the widest window without another corner: those of the newer
        detector made focal lengths 0.8 % too long in rendered images of 324 x 244 px.
        """
        size = self.columns, self.rows
        detected, corners = cv2.findChessboardCorners(
            image, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        )
        if not detected:
            detected, corners = cv2.findChessboardCornersSB(
                image, size, flags=cv2.CALIB_CB_ACCURACY
            )
        if not detected:
            return None
        grid = np.asarray(corners, np.float32).reshape(self.rows, self.columns, 2)
        apart = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
        half = int(np.clip(round(WINDOW * float(apart)), MIN_WINDOW, MAX_WINDOW))
        refined = cv2.cornerSubPix(
            image, np.ascontiguousarray(grid.reshape(-1, 1, 2)), (half, half), (-1, -1), CRITERIA
        )
        return np.asarray(refined, np.float32).reshape(-1, 2)


class View(NamedTuple):
    """An image in which the board was found."""

    name: str  # of its file
    corners: Corners  # (K, 2) the board's inner corners, row by row, px


class Views(NamedTuple):
    """The board in all images."""

    width: int  # of every image, px
    height: int  # px
    with_board: tuple[View, ...]  # those with the board
    without: tuple[str, ...]  # names of the files without it


def find_views(names: Sequence[str], board: Board, pixels: str = "gray") -> Views:
    """Find the board in image files, of a camera with a kind of `pixels`.

    Raises:
        InputError: Files cannot be read, or their sizes differ or are no camera's.
    """
    unreadable: list[str] = []
    images: dict[str, Image] = {}
    for name in names:
        try:
            images[name] = gray_from_mosaic(_read(name), pixels)
        except InputError as error:
            unreadable += error.problems
    if unreadable:
        raise InputError(unreadable)
    if twice := [f"{name}: given twice" for name in images if names.count(name) > 1]:
        raise InputError(twice, "invalid-argument")
    if sizes := list(_sizes(images)):
        raise InputError(sizes, "wrong-image-size")
    height, width = next(iter(images.values())).shape
    corners_by_name: dict[str, Any] = {}
    with Progress("finding the board", len(images), unit="images") as progress:
        for name, image in images.items():
            corners_by_name[name] = board.find(image)
            progress.done += 1
    return Views(
        width,
        height,
        tuple(
            View(name, corners) for name, corners in corners_by_name.items() if corners is not None
        ),
        tuple(name for name, corners in corners_by_name.items() if corners is None),
    )


def _read(name: str) -> Image:
    try:
        content = Path(name).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{name}: cannot be read: {reason}", "unreadable-file") from error
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:  # an empty file
        image = None
    if image is None:
        raise InputError(f"{name}: no image; expected PNG, JPEG, PGM, ...", "unreadable-file")
    return np.asarray(image, np.uint8)


def _sizes(images: dict[str, Image]) -> Iterator[str]:
    """Yield what is wrong with the sizes of images."""
    first, example = next(iter(images.items()))
    if not all(side in SIDES for side in example.shape):
        yield f"{first}: is {_size(example)} px, expected {SIDES[0]} to {SIDES[-1]} px each way"
    for name, image in images.items():
        if image.shape != example.shape:
            yield f"{name}: is {_size(image)} px, but {first} is {_size(example)}"


def _size(image: Image) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"
