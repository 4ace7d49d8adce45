"""Texts of missions, records and clients in the Markdown of a page."""

from __future__ import annotations

import re
from typing import Final

ADDRESS: Final = re.compile("&#58;(?=&#47;)|www(?=&#46;)|&#64;", re.IGNORECASE)
"""What makes an escaped text an address, which viser would turn into a link: ``:/``, ``www.``, @"""

JOINER: Final = "&#8288;"  # no width


def escaped(text: str) -> str:
    """Return a text as Markdown that shows it as it is, on one line, without links.

    viser renders HTML in Markdown, scripts included, so each character that could mean something to
    either is written as its number. It also looks for addresses in what is shown, numbers or not:
    these are interrupted.

    >>> escaped("<b>*cf1*</b>")
    '&#60;b&#62;&#42;cf1&#42;&#60;&#47;b&#62;'
    >>> escaped("a@b")
    'a&#64;&#8288;b'
    """
    numbers = "".join(
        c if c.isalnum() or c == " " else f"&#{ord(c)};" if c.isprintable() else " " for c in text
    )
    return ADDRESS.sub(rf"\g<0>{JOINER}", numbers)
