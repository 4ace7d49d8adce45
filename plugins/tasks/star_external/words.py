"""How what was given is shown, kept and refused, in few words. Nothing here imports numpy."""

from __future__ import annotations

from collections.abc import Collection
from reprlib import Repr
from typing import Any, Final, NoReturn

from star_core import InputError

LONGEST_REASON: Final = 200
"""Of why a step failed this many characters are kept."""

LONGEST_QUOTE: Final = 60
"""Of a value that is refused this many characters are shown."""


def refuse(why: str) -> NoReturn:
    """Refuse what was given.

    Raises:
        InputError: Always.
    """
    raise InputError([why])


def quoted(value: Any) -> str:
    """Show a value in few characters, however much there is of it."""
    quote = Repr()
    quote.maxlevel = 2
    text = quote.repr(value)
    return text if len(text) <= LONGEST_QUOTE else f"{text[: LONGEST_QUOTE - 3]}..."


def listed(names: Collection[str]) -> str:
    """Name every one: ``'goals', 'done' and 'fail'``."""
    *others, last = (repr(name) for name in names)
    return f"{', '.join(others)} and {last}" if others else last


def reason(why: str) -> str:
    """Return why a step failed as it is kept: short, and on one line."""
    return "".join(c if c.isprintable() else " " for c in why[:LONGEST_REASON])
