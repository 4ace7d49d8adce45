"""Lays out a tag on paper, in true size, with aids for printing and placing it."""

from __future__ import annotations

from itertools import pairwise
from typing import Final, NamedTuple

from star_core import InputError
from star_core.toolkit import PAPERS, TAG_RIM, Fill, Outline, Page, Point, Text, rectangle

MODULES: Final = 8  # per row of a tag of family 36h11: six for its number, two for its border
STRIP: Final = 44.0  # mm at the bottom of the page for the text, the bar and the arrow
MARGIN: Final = 14.0  # mm beside the text: more than the unprintable margin of printers
BAR: Final = 100.0  # mm
CLOSE: Final = 1e-6  # mm, tolerance: 1.25 times 0.168 m exactly fills an A4 sheet


class Sheet(NamedTuple):
    """Properties of a tag."""

    number: int  # number of the tag
    size: float  # edge of its black square, m
    about: tuple[str, ...]  # description, one line each

    @property
    def width(self) -> float:
        """Width of the tag with its white border, mm."""
        return 1000 * self.size * TAG_RIM


def lay_out(sheet: Sheet, paper: str) -> Page:
    """Return the page for a tag. Its up direction is that of the page.

    Raises:
        InputError: It does not fit the paper; suggests a paper that it fits.
    """
    width, height = PAPERS[paper]
    if not _fits(sheet, paper):
        raise InputError(_too_large(sheet, paper), "paper-too-small")
    center = (width / 2, (STRIP + height) / 2)
    about = (Text((MARGIN, 28 - 5.5 * i), 3.5, line) for i, line in enumerate(sheet.about))
    edge = f"{1000 * sheet.size:g}"
    return Page(
        width,
        height,
        (
            Fill(_modules(sheet, center)),
            Fill(_frame(sheet, center), gray=0.7),
            Text((MARGIN, 35), 7, f"tag {sheet.number}"),
            *about,
            Fill(_bar((MARGIN, 11))),
            Text((MARGIN, 6), 3.5, f"The bar is {BAR:g} mm, the black square {edge} mm wide:"
                 " print at 100 %, not fitted to the paper."),
            Fill(_arrow((width - MARGIN - 6, 13))),
            Text((width - MARGIN - 8, 35), 3.5, "up"),
        ),
    )  # fmt: skip


def _fits(sheet: Sheet, paper: str) -> bool:
    width, height = PAPERS[paper]
    return sheet.width <= min(width, height - STRIP) + CLOSE


def _too_large(sheet: Sheet, paper: str) -> str:
    wide = f"tag {sheet.number} is {sheet.width:g} mm wide with its border, too wide for {paper}"
    larger = next((name for name in PAPERS if _fits(sheet, name)), None)
    return f"{wide}; " + (f"use --paper {larger}" if larger else "no larger paper is supported")


def _modules(sheet: Sheet, center: Point) -> tuple[Outline, ...]:
    """Return the black modules of a tag, adjacent ones merged."""
    edge = 1000 * sheet.size
    side = edge / MODULES
    left, top = center[0] - edge / 2, center[1] + edge / 2
    return tuple(
        rectangle((left + first * side, top - (row + 1) * side), (last - first) * side, side)
        for row, first, last in _black(sheet.number)
    )


def _black(number: int) -> list[tuple[int, int, int]]:
    """Return the runs of black modules of a tag: row from the top, first column, last column + 1.

    The pattern is OpenCV's, in the orientation in which it draws and detects it. (The AprilTag
    library contains the same pattern rotated by 180°.)
    """
    import cv2

    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    image = family.generateImageMarker(number, MODULES)  # a pixel for each module
    runs = []
    for row, line in enumerate(image):
        edges = [0, *(i for i in range(1, MODULES) if line[i] != line[i - 1]), MODULES]
        runs += [(row, first, last) for first, last in pairwise(edges) if line[first] == 0]
    return runs


def _frame(sheet: Sheet, center: Point) -> tuple[Outline, ...]:
    """Return a thin frame around the white border: the cutting line."""
    thin, edge = 0.2, sheet.width
    x, y = center[0] - edge / 2, center[1] - edge / 2
    return (
        rectangle((x - thin, y - thin), edge + 2 * thin, thin),
        rectangle((x - thin, y + edge), edge + 2 * thin, thin),
        rectangle((x - thin, y), thin, edge),
        rectangle((x + edge, y), thin, edge),
    )


def _bar(low: Point) -> tuple[Outline, ...]:
    """Return a bar with a serif at each end, its outer edges `BAR` apart."""
    (x, y), thin = low, 0.5
    return (
        rectangle((x, y), thin, 4),
        rectangle((x + thin, y + 1.75), BAR - 2 * thin, thin),
        rectangle((x + BAR - thin, y), thin, 4),
    )


def _arrow(low: Point) -> tuple[Outline, ...]:
    """Return an arrow that points up: a shaft and a head."""
    x, y = low
    return rectangle((x - 1, y), 2, 12), ((x - 4, y + 12), (x + 4, y + 12), (x, y + 20))
