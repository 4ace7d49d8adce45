"""Pages of filled polygons and text, in millimeters, and their SVG and PDF."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple, TypeAlias
from xml.sax.saxutils import escape

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


PAPERS: Final = {"a4": (210.0, 297.0), "letter": (215.9, 279.4), "a3": (297.0, 420.0)}
"""Width and height, mm, in ascending order of width."""


def rectangle(low: Point, width: float, height: float) -> Outline:
    """Return a rectangle by its lower left corner.

    >>> rectangle((1, 2), 3, 4)
    ((1, 2), (4, 2), (4, 6), (1, 6))
    """
    x, y = low
    return ((x, y), (x + width, y), (x + width, y + height), (x, y + height))


def coordinate(value: float) -> str:
    """Return a coordinate to a tenth of a micrometer, as both formats write it.

    >>> coordinate(21.0), coordinate(0.25), coordinate(-0.00001)
    ('21', '0.25', '0')
    """
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def svg(page: Page) -> str:
    """Return a page as an SVG file; its units are millimeters, with y down."""
    width, height = coordinate(page.width), coordinate(page.height)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm"'
            f' viewBox="0 0 {width} {height}">',
            *(
                _svg_fill(mark, page.height)
                if isinstance(mark, Fill)
                else _svg_text(mark, page.height)
                for mark in page.marks
            ),
            "</svg>\n",
        ]
    )


def _svg_fill(mark: Fill, height: float) -> str:
    outlines = (
        "M" + " L".join(f"{coordinate(x)} {coordinate(height - y)}" for x, y in outline) + " Z"
        for outline in mark.outlines
    )
    return f'<path fill="rgb({",".join([f"{mark.gray:.0%}"] * 3)})" d="{" ".join(outlines)}"/>'


def _svg_text(mark: Text, height: float) -> str:
    x, y = mark.at
    return (
        f'<text x="{coordinate(x)}" y="{coordinate(height - y)}"'
        f' font-size="{coordinate(mark.size)}"'
        f' font-family="Helvetica, Arial, sans-serif">{escape(mark.content)}</text>'
    )


POINTS: Final = 72 / 25.4  # per millimeter; the point, PDF's unit, is 1/72 inch

CATALOG: Final = "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>"
FONT: Final = "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>"
FIRST: Final = 4  # object number of the first page, after the catalog, the pages and the font


def pdf(pages: Sequence[Page]) -> bytes:
    """Return a PDF file of these pages.

    Its coordinates are millimeters. Readers are requested not to scale pages to the paper.
    """
    numbers = range(FIRST, FIRST + 2 * len(pages), 2)
    kids = " ".join(f"{n} 0 R" for n in numbers)
    objects = [CATALOG, f"<< /Type /Pages /Count {len(pages)} /Kids [{kids}] >>", FONT]
    for n, page in zip(numbers, pages, strict=True):
        box = f"[0 0 {coordinate(page.width * POINTS)} {coordinate(page.height * POINTS)}]"
        fonts = "<< /Font << /F 3 0 R >> >>"
        content = _content(page)
        objects += [
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Resources {fonts}"
            f" /Contents {n + 1} 0 R >>",
            f"<< /Length {len(content)} >>\nstream\n{content}\nendstream",
        ]
    return _file(objects)


def _content(page: Page) -> str:
    """Return the drawing of a page; each of its characters is one byte."""
    lines = [f"{POINTS:.9f} 0 0 {POINTS:.9f} 0 0 cm"]
    for mark in page.marks:
        lines += _pdf_fill(mark) if isinstance(mark, Fill) else [_pdf_text(mark)]
    return "\n".join(lines)


def _pdf_fill(mark: Fill) -> list[str]:
    lines = [f"{coordinate(mark.gray)} g"]
    for outline in mark.outlines:
        first, *others = (f"{coordinate(x)} {coordinate(y)}" for x, y in outline)
        lines.append(" ".join([f"{first} m", *(f"{other} l" for other in others), "h"]))
    return [*lines, "f"]


def _pdf_text(mark: Text) -> str:
    encodable = mark.content.encode("cp1252", "replace").decode("latin-1")
    escaped = encodable.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    x, y = mark.at
    return (
        f"0 g BT /F {coordinate(mark.size)} Tf {coordinate(x)} {coordinate(y)} Td ({escaped}) Tj ET"
    )


def _file(objects: Sequence[str]) -> bytes:
    """Return a file of objects, numbered from 1, with a table of their offsets."""
    file = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n"  # the second line marks the file as binary
    table = [b"0000000000 65535 f \n"]
    for n, content in enumerate(objects, start=1):
        table.append(b"%010d 00000 n \n" % len(file))
        file += b"%d 0 obj\n%s\nendobj\n" % (n, content.encode("latin-1"))
    size = len(table)
    trailer = b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n" % (size, len(file))
    return b"%sxref\n0 %d\n%s%s%%%%EOF\n" % (file, size, b"".join(table), trailer)
