"""Lines of YAML that record the location they were imported from."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

WORDS: Final = ("true", "false", "null")


@dataclass(frozen=True, slots=True)
class Line:
    """A line, and the location it was imported from; empty if it has none."""

    text: str
    origin: str = ""


def whole(lines: Sequence[Line]) -> str:
    """Return lines as the text of a file."""
    return "".join(f"{line.text}\n" for line in lines)


def word(text: str) -> str:
    """Return text as a key or a value of YAML, quoted if necessary.

    >>> word("cf1"), word("true"), word("a: b")
    ('cf1', '"true"', '"a: b"')
    """
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_./-]*", text) and text.lower() not in WORDS:
        return text
    return json.dumps(text)


def traced(problem: str, file: str, shown: str, lines: Sequence[Line]) -> str:
    """Return a problem of an output file with the location its line was imported from.

    Args:
        problem: Message of a check, ``file:line:col: message`` for this file.
        file: Name of the file in that message.
        shown: Name of the file to use if the line has no origin.
        lines: Lines of the file.
    """
    match = re.fullmatch(re.escape(file) + r":(\d+):\d+: (.*)", problem, re.DOTALL)
    if not match:
        return problem
    number, message = int(match[1]), match[2]
    line = lines[number - 1] if number <= len(lines) else Line("")
    if line.origin:
        return f"{line.origin}: as STAR reads it: {message}"
    return f"{shown}:{number}: {message}"
