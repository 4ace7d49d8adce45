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
    """Return a problem with the locations that the lines of an output file were imported from.

    Args:
        problem: Message of a check, ``file:line:col: message`` if it is about this file.
        file: Name of the file in that message.
        shown: Name of the file to use if a line has no origin.
        lines: Lines of the file.

    >>> lines = [Line("a: 1", "o.yaml:7:3"), Line("b: 2")]
    >>> traced("/tmp/m.yaml:1:4: as at /tmp/m.yaml:2", "/tmp/m.yaml", "m.yaml", lines)
    'o.yaml:7:3: as STAR reads it: as at m.yaml:2'
    """

    def origin(match: re.Match[str]) -> str:
        number = int(match[1])
        text = lines[number - 1].origin if number <= len(lines) else ""
        read = ": as STAR reads it" if text and not match.start() else ""
        return f"{text or f'{shown}:{number}'}{read}"

    return re.sub(re.escape(file) + r":(\d+)(?::\d+)?", origin, problem)
