"""Texts of missions, records and clients in the Markdown of a page."""

from __future__ import annotations

import re
from typing import Final

BREAK: Final = "\u200b"  # no width; a line may end there
ADDRESS: Final = re.compile(r":(?=/)|www(?=\.)|@", re.IGNORECASE)
"""What makes an address of a text, which viser would turn into a link."""
LONG: Final = re.compile(rf"[^\s{BREAK}]{{30}}(?=[^\s{BREAK}])")
"""What would not fit the width of a panel without a break."""


def escaped(text: str) -> str:
    """Return a text as Markdown that shows it as it is, in one paragraph, without links.

    viser renders HTML in Markdown, scripts included, so each character that could mean something to
    either is written as its number. It also looks for addresses in what is shown, numbers or not:
    these have a break.

    >>> escaped("<b>*cf1*</b>")
    '&#60;b&#62;&#42;cf1&#42;&#60;&#47;b&#62;'
    >>> escaped("a@b")
    'a&#64;&#8203;b'
    """
    broken = LONG.sub(rf"\g<0>{BREAK}", ADDRESS.sub(rf"\g<0>{BREAK}", text))
    return "".join(
        c if c.isalnum() or c == " " else f"&#{ord(c)};" if c.isprintable() or c == BREAK else " "
        for c in broken
    )
