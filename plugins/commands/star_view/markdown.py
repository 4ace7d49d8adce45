"""Texts of missions, records and clients in the Markdown of a page."""

from __future__ import annotations


def escaped(text: str) -> str:
    """Return a text as Markdown that shows it as it is, on one line.

    viser renders HTML in Markdown, scripts included, so each character that could mean something to
    either is written as its number.

    >>> escaped("<b>*cf1*</b>")
    '&#60;b&#62;&#42;cf1&#42;&#60;&#47;b&#62;'
    """
    return "".join(
        c if c.isalnum() or c == " " else f"&#{ord(c)};" if c.isprintable() else " " for c in text
    )
