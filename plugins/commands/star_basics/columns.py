"""Lists with two columns, wrapped to the terminal."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterable, Iterator
from typing import Final

MAX_WIDTH: Final = 100  # characters; also the width where there is no terminal


def text_width() -> int:
    """Return the number of characters in a line."""
    return min(MAX_WIDTH, shutil.get_terminal_size((MAX_WIDTH, 24)).columns)


def columns(rows: Iterable[tuple[str, str]], indent: int = 2) -> Iterator[str]:
    """Yield the lines of a list: names, and texts beside them.

    >>> list(columns([("a", "The first."), ("abc", "")]))
    ['  a    The first.', '  abc']
    """
    listed = list(rows)
    start = indent + 2 + max((len(name) for name, _ in listed), default=0)
    for name, text in listed:
        first = f"{'':{indent}}{name:<{start - indent}}"
        lines = textwrap.wrap(
            text, text_width(), initial_indent=first, subsequent_indent=" " * start
        )
        yield from lines or [first.rstrip()]
