"""Lines of YAML that remember which line of another file they were made from."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

WORDS: Final = ("true", "false", "null")


@dataclass(frozen=True, slots=True)
class Line:
    """A line, and the place of what it was made from; empty if it is from nowhere."""

    text: str
    origin: str = ""


def whole(lines: Sequence[Line]) -> str:
    """Return lines as a file."""
    return "".join(f"{line.text}\n" for line in lines)


def word(text: str) -> str:
    """Return text as a key or a value of YAML, in quotes if it needs them.

    >>> word("cf1"), word("true"), word("a: b")
    ('cf1', '"true"', '"a: b"')
    """
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_./-]*", text) and text.lower() not in WORDS:
        return text
    return json.dumps(text)


def traced(problem: str, file: str, shown: str, lines: Sequence[Line]) -> str:
    """Return a problem of a file that was made, at the place of what that line was made from.

    Args:
        problem: What a check said, ``file:line:col: message`` for this file.
        file: The file, as the check called it.
        shown: What to call the file if the line is from nowhere.
        lines: Of the file.
    """
    found = re.fullmatch(re.escape(file) + r":(\d+):\d+: (.*)", problem, re.DOTALL)
    if not found:
        return problem
    number, message = int(found[1]), found[2]
    line = lines[number - 1] if number <= len(lines) else Line("")
    if line.origin:
        return f"{line.origin}: as STAR reads it: {message}"
    return f"{shown}:{number}: {message}"
