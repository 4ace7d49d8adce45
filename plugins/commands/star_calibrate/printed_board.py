"""A chessboard to print in true size, for ``star calibrate camera``."""

from __future__ import annotations

import math
from typing import Final

from star_calibrate.board import Board
from star_core import InputError
from star_core.toolkit import PAPERS, Fill, Outline, Page, Point, Text, rectangle

MARGIN: Final = 9.0  # mm: more than the unprintable margin of printers
STRIP: Final = 22.0  # mm at the bottom of the page for the text and the ruler
RULER: Final = 100.0  # mm
CLOSE: Final = 1e-6  # mm, tolerance


def board_page(board: Board, paper: str) -> Page:
    """Return a page, on its side, with a board.

    Raises:
        InputError: It does not fit the paper; suggests a square that does.
    """
    height, width = PAPERS[paper]
    columns, rows = board.columns + 1, board.rows + 1
    edge = 1000 * board.square
    up = height - MARGIN - STRIP
    if _largest(board, paper) < edge:
        square = math.floor(_largest(board, paper)) / 1000
        larger = next((name for name in PAPERS if _largest(board, name) >= edge), None)
        hint = f"--square {square:g}" + (f", or --paper {larger}" if larger else "")
        raise InputError(
            f"a board of {columns} by {rows} squares of {edge:g} mm is larger than {paper}; "
            f"use {hint if square else 'fewer squares'}",
            "paper-too-small",
        )
    left, low = (width - columns * edge) / 2, STRIP + (up - rows * edge) / 2
    squares = tuple(
        rectangle((left + column * edge, low + row * edge), edge, edge)
        for row in range(rows)
        for column in range(columns)
        if (row + column) % 2 == 0
    )
    size = f"{board.columns}x{board.rows}"
    return Page(
        width,
        height,
        (
            Fill(squares),
            Fill(_ruler((MARGIN, 11))),
            Text((MARGIN, 6), 3.5, "The ruler is 100 mm, a tick each 10 mm: print at 100 %, not"
                 " fitted to the paper, and glue it to a flat board."),
            Text((MARGIN + 108, 13), 3.5, f"{size} inner corners, squares of {edge:g} mm:"
                 f" star calibrate camera ... --board {size} --square {board.square:g}"),
        ),
    )  # fmt: skip


def _ruler(low: Point) -> tuple[Outline, ...]:
    """Return a ruler with a tick each 10 mm, its outer edges `RULER` apart."""
    (x, y), thin = low, 0.5
    ticks = (rectangle((x + 10 * i - 0.25, y + 1), 0.5, 2.5) for i in range(1, 10))
    return (
        rectangle((x, y), thin, 4),
        rectangle((x + thin, y + 1.75), RULER - 2 * thin, thin),
        rectangle((x + RULER - thin, y), thin, 4),
        *ticks,
    )


def _largest(board: Board, paper: str) -> float:
    """Return the largest edge of a square with which a board fits a paper on its side, mm."""
    height, width = PAPERS[paper]
    across, up = width - 2 * MARGIN, height - MARGIN - STRIP
    return min(across / (board.columns + 1), up / (board.rows + 1)) + CLOSE
