"""The chessboard that a camera is calibrated by, and where it is in a picture."""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from star_core import Array, Image

Corners = NDArray[np.float32]
"""(K, 2) px."""

WINDOW: Final = 0.45  # of the least way from one corner to the next, to either side
NARROWEST, WIDEST = 2, 11  # px to either side
ENOUGH: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)  # px


class Board(NamedTuple):
    """A printed chessboard.

    Attributes:
        columns: Inner corners along a row: one less than its squares.
        rows: Inner corners along a column.
        square: Edge of a square, m.
    """

    columns: int
    rows: int
    square: float

    @property
    def points(self) -> Array:
        """(K, 3) its inner corners, row by row, z = 0, m.

        >>> Board(3, 2, 0.5).points[:, :2].tolist()
        [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [0.0, 0.5], [0.5, 0.5], [1.0, 0.5]]
        """
        row, column = np.indices((self.rows, self.columns)).reshape(2, -1)
        return self.square * np.stack([column, row, 0.0 * row], axis=1)

    def find(self, image: Image) -> Corners | None:
        """Return its inner corners in a picture, row by row; None unless all are to be seen.

        What OpenCV's older detector misses is asked of its newer one. Both are then refined by
        the gradients around each corner, in as wide a window as holds no other: the newer one's
        own places made focal lengths 0.8 % too long in rendered pictures of 324 x 244 px.
        """
        size = self.columns, self.rows
        found, corners = cv2.findChessboardCorners(
            image, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        )
        if not found:
            found, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_ACCURACY)
        if not found:
            return None
        grid = np.asarray(corners, np.float32).reshape(self.rows, self.columns, 2)
        apart = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
        half = int(np.clip(round(WINDOW * float(apart)), NARROWEST, WIDEST))
        refined = cv2.cornerSubPix(
            image, np.ascontiguousarray(grid.reshape(-1, 1, 2)), (half, half), (-1, -1), ENOUGH
        )
        return np.asarray(refined, np.float32).reshape(-1, 2)
