"""Formatting of values and reasons for messages. Does not import numpy."""

from __future__ import annotations

from collections.abc import Collection
from reprlib import Repr
from typing import Any, Final, NoReturn

from star_core import InputError

MAX_REASON: Final = 200
"""Characters kept of the reason of a failure."""

MAX_QUOTE: Final = 60
"""Characters shown of an invalid value."""


def refuse(why: str) -> NoReturn:
    """Reject an input.

    Raises:
        InputError: Always.
    """
    raise InputError([why])


def quoted(value: Any) -> str:
    """Return a short representation of a value of any size."""
    quote = Repr()
    quote.maxlevel = 2
    text = quote.repr(value)
    return text if len(text) <= MAX_QUOTE else f"{text[: MAX_QUOTE - 3]}..."


def listed(names: Collection[str]) -> str:
    """Return the names as an enumeration: ``'goals', 'done' and 'fail'``."""
    *others, last = (repr(name) for name in names)
    return f"{', '.join(others)} and {last}" if others else last


def reason(why: str) -> str:
    """Return the reason of a failure shortened, on one line."""
    return "".join(c if c.isprintable() else " " for c in why[:MAX_REASON])
