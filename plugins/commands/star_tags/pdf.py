"""Writes pages as PDF 1.4, using little of it: fills, and text in a standard font."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from star_tags.page import Fill, Page, Text, number

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
        box = f"[0 0 {number(page.width * POINTS)} {number(page.height * POINTS)}]"
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
        lines += _fill(mark) if isinstance(mark, Fill) else [_text(mark)]
    return "\n".join(lines)


def _fill(mark: Fill) -> list[str]:
    lines = [f"{number(mark.gray)} g"]
    for outline in mark.outlines:
        first, *others = (f"{number(x)} {number(y)}" for x, y in outline)
        lines.append(" ".join([f"{first} m", *(f"{other} l" for other in others), "h"]))
    return [*lines, "f"]


def _text(mark: Text) -> str:
    known = mark.content.encode("cp1252", "replace").decode("latin-1")
    escaped = known.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    x, y = mark.at
    return f"0 g BT /F {number(mark.size)} Tf {number(x)} {number(y)} Td ({escaped}) Tj ET"


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
