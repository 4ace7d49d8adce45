"""Content of a page: filled shapes and lines of text, in millimeters."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

Point: TypeAlias = tuple[float, float]
"""x to the right and y up from the lower left corner of the page, mm."""

Outline: TypeAlias = tuple[Point, ...]


class Fill(NamedTuple):
    """An area of one gray level.

    Its outlines are filled together, so that no hairline is visible between adjacent ones.
    """

    outlines: tuple[Outline, ...]  # corners of polygons, all anticlockwise
    gray: float = 0.0  # gray level: 0 is black, 1 is white


class Text(NamedTuple):
    """A line of text."""

    at: Point  # beginning of its base line
    size: float  # height of the font, mm
    content: str  # the text


class Page(NamedTuple):
    """One side of paper: width and height, mm, and content."""

    width: float
    height: float
    marks: tuple[Fill | Text, ...]


def rectangle(low: Point, width: float, height: float) -> Outline:
    """Return a rectangle by its lower left corner.

    >>> rectangle((1, 2), 3, 4)
    ((1, 2), (4, 2), (4, 6), (1, 6))
    """
    x, y = low
    return ((x, y), (x + width, y), (x + width, y + height), (x, y + height))


def number(value: float) -> str:
    """Return a coordinate to a tenth of a micrometer, as both formats write it.

    >>> number(21.0), number(0.25), number(-0.00001)
    ('21', '0.25', '0')
    """
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
