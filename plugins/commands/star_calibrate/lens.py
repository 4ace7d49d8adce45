"""Works out a camera's intrinsics from where it saw a board's corners."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Final, NamedTuple

import cv2
import numpy as np

from star_calibrate.board import Board, Corners
from star_calibrate.deviation import deviations
from star_calibrate.views import View, Views
from star_core import InputError

FEWEST: Final = 6  # pictures; three determine the matrix, and some are always poor
OUTLIER: Final = 3.0  # times the median of all pictures' errors
POOREST: Final = 1.0  # px: an RMS error beyond this is no lens of this model, or no such board
DOUBT: Final = 0.01  # of the focal length: its greatest deviation
CELLS: Final = (6, 4)  # of a picture, for how much of it was covered


class Seen(NamedTuple):
    """How well one picture fits.

    Attributes:
        name: Its file's.
        error: RMS distance of its corners from where they should be, px.
        distance: From the camera to the board's middle, m.
    """

    name: str
    error: float
    distance: float


class Lens(NamedTuple):
    """A camera as OpenCV's pinhole model has it.

    Attributes:
        width: px.
        height: px.
        matrix: fx, fy, cx, cy, px.
        deviation: Of each of these, px.
        distortion: k1, k2, p1, p2, k3; k3 is held at 0.
        error: RMS distance of all corners from where they should be, px.
        used: The pictures it rests on.
        left_out: Pictures that fit much worse than the others, with their errors then.
        covered: Share of the picture's cells in which there was a corner.
    """

    width: int
    height: int
    matrix: tuple[float, ...]
    deviation: tuple[float, ...]
    distortion: tuple[float, ...]
    error: float
    used: tuple[Seen, ...]
    left_out: tuple[Seen, ...]
    covered: float


def solve(views: Views, board: Board) -> Lens:
    """Return the lens that explains what was seen.

    This is Zhang's method (IEEE PAMI 22(11), 2000) as OpenCV has it. Pictures whose error is more
    than `OUTLIER` times the median are left out, and the rest is solved again. The third radial
    coefficient is held at 0: corners seldom reach where it could be told from the second.

    Raises:
        InputError: There are too few pictures, they do not fit, or they do not settle the focal
            length.
    """
    found, left_out = list(views.found), list[Seen]()
    while True:
        if len(found) < FEWEST:
            raise InputError(_too_few(views, board, left_out))
        lens = _solved(views, found, board)
        limit = OUTLIER * statistics.median(seen.error for seen in lens.used)
        poor = [seen for seen in lens.used if seen.error > limit]
        if not poor:
            break
        left_out += poor
        names = {seen.name for seen in poor}
        found = [view for view in found if view.name not in names]
    _check(lens, board)
    return lens._replace(left_out=tuple(left_out))


def _solved(views: Views, found: Sequence[View], board: Board) -> Lens:
    points = board.points.astype(np.float32)
    corners = [view.corners for view in found]
    try:
        error, matrix, bend, turns, places, _, _, errors = cv2.calibrateCameraExtended(
            [points] * len(found),
            corners,
            (views.width, views.height),
            np.eye(3),
            np.zeros(5),
            flags=cv2.CALIB_FIX_K3,
        )
    except cv2.error as failure:
        raise InputError([f"no lens explains these pictures: {failure.err}"]) from failure
    middle = board.points.mean(axis=0)
    return Lens(
        width=views.width,
        height=views.height,
        matrix=tuple(float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))),
        deviation=deviations(
            board.points,
            [
                (np.asarray(turn, np.float64), np.asarray(place, np.float64))
                for turn, place in zip(turns, places, strict=True)
            ],
            np.asarray(matrix, np.float64),
            np.asarray(bend, np.float64),
            float(error),
        ),
        distortion=tuple(map(float, np.ravel(bend)[:5])),
        error=float(error),
        used=tuple(
            Seen(
                view.name,
                float(poor),
                float(np.linalg.norm(cv2.Rodrigues(turn)[0] @ middle + np.ravel(place))),
            )
            for view, poor, turn, place in zip(found, np.ravel(errors), turns, places, strict=True)
        ),
        left_out=(),
        covered=_covered(np.concatenate(corners), views),
    )


def _covered(corners: Corners, views: Views) -> float:
    cells = np.floor(corners / (views.width, views.height) * CELLS).astype(int)
    return len({tuple(cell) for cell in cells.tolist()}) / (CELLS[0] * CELLS[1])


def _too_few(views: Views, board: Board, left_out: Sequence[Seen]) -> list[str]:
    size = f"{board.columns}x{board.rows}"
    usable = len(views.found) - len(left_out)
    return [
        *(f"{name}: no board of {size} inner corners found" for name in views.without),
        *(f"{seen.name}: fits {seen.error:.2f} px poorly" for seen in left_out),
        f"{usable} pictures with a board of {size} inner corners are too few, expected at least"
        f" {FEWEST}; take more, with the whole board in each, or give --board as it was printed",
    ]


def _check(lens: Lens, board: Board) -> None:
    """Refuse a lens that is not to be trusted.

    Raises:
        InputError: It is not.
    """
    if not lens.error <= POOREST:
        worst = max(lens.used, key=lambda seen: seen.error)
        raise InputError(
            [
                f"{worst.name}: fits worst, {worst.error:.2f} px",
                f"the pictures fit {lens.error:.2f} px RMS, expected at most {POOREST:g} px; is the"
                f" board flat, are the pictures sharp, and has it {board.columns}x{board.rows}"
                " inner corners?",
            ]
        )
    focal, deviation = max(lens.matrix[:2]), max(lens.deviation[:2])
    if not deviation <= DOUBT * focal:
        raise InputError(
            [
                f"the pictures do not settle the focal length: {focal:.1f} +- {deviation:.1f} px,"
                f" expected +- {DOUBT * focal:.1f} px or less; add some of the board tilted by 30"
                " to 45 degrees, to all sides"
            ]
        )
