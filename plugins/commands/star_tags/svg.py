"""Writes a page as SVG."""

from __future__ import annotations

from xml.sax.saxutils import escape

from star_tags.page import Fill, Page, Text, number


def svg(page: Page) -> str:
    """Return a page as an SVG file; its units are millimeters, with y down."""
    width, height = number(page.width), number(page.height)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm"'
            f' viewBox="0 0 {width} {height}">',
            *(
                _fill(mark, page.height) if isinstance(mark, Fill) else _text(mark, page.height)
                for mark in page.marks
            ),
            "</svg>\n",
        ]
    )


def _fill(mark: Fill, height: float) -> str:
    outlines = (
        "M" + " L".join(f"{number(x)} {number(height - y)}" for x, y in outline) + " Z"
        for outline in mark.outlines
    )
    return f'<path fill="rgb({",".join([f"{mark.gray:.0%}"] * 3)})" d="{" ".join(outlines)}"/>'


def _text(mark: Text, height: float) -> str:
    x, y = mark.at
    return (
        f'<text x="{number(x)}" y="{number(height - y)}" font-size="{number(mark.size)}"'
        f' font-family="Helvetica, Arial, sans-serif">{escape(mark.content)}</text>'
    )
