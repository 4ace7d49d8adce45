"""What ``star check`` prints: text with excerpts, JSON, or annotations of GitHub."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Final, NamedTuple
from unicodedata import east_asian_width

from star_basics.check_problems import FileProblem
from star_core.formats import STDIN, printable
from star_core.toolkit import on_terminal, unescaped

WIDTH: Final = 100  # characters of an excerpt
TOKEN: Final = re.compile(r"\"[^\"]*\"|'[^']*'|[^\s,:\[\]{}#\"']+")
BOLD: Final = "1"
RED: Final = "1;31"
YELLOW: Final = "1;33"
BLUE: Final = "1;34"


class CheckedFile(NamedTuple):
    """A file that was checked.

    Attributes:
        path: The file, as the user named it.
        text: What it is good for, in words; None if it has an error.
        problems: Its errors, or its warnings.
    """

    path: Path
    text: str | None
    problems: Sequence[FileProblem]


def print_text(checked: Sequence[CheckedFile], standard_input: bytes) -> None:
    """Print what files are good for on stdout; problems with excerpts and a summary on stderr."""
    for file in checked:
        if file.text is not None:
            print(file.text)
    sys.stdout.flush()
    paint = _paint if on_terminal() and not os.environ.get("NO_COLOR") else _plain
    sources = {str(STDIN): _lines(standard_input)}
    lines = []
    problems = (problem for file in checked for problem in file.problems)
    for (name, _, _), some in groupby(problems, attrgetter("file", "line", "column")):
        at_same_position = list(some)
        if name not in sources:
            sources[name] = _lines_of(Path(name))
        lines += [_headline(problem, paint) for problem in at_same_position]
        lines += excerpt(at_same_position[-1], sources[name], paint)
    if lines:
        lines += [paint(_summary(checked), BOLD), ""]
    with suppress(OSError):  # nothing reads stderr any more
        unescaped(sys.stderr).write("\n".join(lines))


def print_json(checked: Sequence[CheckedFile], _standard_input: bytes) -> None:
    """Print a JSON object with the files and their problems on stdout."""
    files = [
        {
            "file": str(file.path),
            "valid": file.text is not None,
            "description": file.text,
            "problems": [
                {
                    "file": problem.file,
                    "line": problem.line,
                    "column": problem.column,
                    "severity": problem.severity,
                    "code": problem.code,
                    "message": problem.message,
                }
                for problem in file.problems
            ],
        }
        for file in checked
    ]
    print(json.dumps({"files": files}, indent=2))


def print_github(checked: Sequence[CheckedFile], _standard_input: bytes) -> None:
    """Print each problem on stdout as a workflow command, which GitHub shows beside its line."""
    for file in checked:
        for problem in file.problems:
            position = "" if problem.line is None else f",line={problem.line},col={problem.column}"
            location = f"file={_escaped(problem.file, ':,')}{position}"
            title = f"title={_escaped(f'star ({problem.code})', ':,')}"
            print(f"::{problem.severity} {location},{title}::{_escaped(problem.message)}")


OUTPUTS: Final[Mapping[str, Callable[[Sequence[CheckedFile], bytes], None]]] = {
    "text": print_text,
    "json": print_json,
    "github": print_github,
}
"""By ``--format``: prints the files that were checked, given the content of standard input."""


def excerpt(
    problem: FileProblem, lines: Sequence[str], paint: Callable[[str, str], str]
) -> list[str]:
    """Return the line of a problem, and carets below the word that it is about.

    Args:
        problem: Without a location, or on an empty line, it has no excerpt.
        lines: Of its file.
        paint: ``paint(text, colour)`` returns a text in a colour.
    """
    if problem.line is None or problem.column is None or problem.line > len(lines):
        return []
    line, start = lines[problem.line - 1], problem.column - 1
    if not line.strip():
        return []
    match = TOKEN.match(line, start)
    end = max(match.end() if match else 0, start + 1)
    left = max(0, min(start - WIDTH // 2, len(line) - WIDTH))
    before, marked = _shown(line[left:start]), _shown(line[start : min(end, left + WIDTH)])
    after = _shown(line[end : left + WIDTH])
    margin = len(str(problem.line))
    bar = paint("|", BLUE)
    carets = paint("^" * max(1, _cells(marked)), YELLOW if problem.warning else RED)
    return [
        f" {paint(str(problem.line), BLUE)} {bar} {before}{marked}{after}".rstrip(),
        f" {'':{margin}} {bar} {'':{_cells(before)}}{carets}",
    ]


def _headline(problem: FileProblem, paint: Callable[[str, str], str]) -> str:
    """Return the message as it is, its location and code in colour."""
    text = printable(problem.text)
    location, message = "", text
    if problem.line is not None:
        mark = f":{problem.line}:{problem.column}:"
        file, position, message = text.partition(mark)
        location = paint(f"{file}{position}", BOLD)
    colour = YELLOW if problem.warning else RED
    code = f"[{problem.code}]"
    if problem.code and message.endswith(code):
        message = f"{message.removesuffix(code)}{paint(code, colour)}"
    return f"{location}{message.replace('warning:', paint('warning:', colour), 1)}"


def _summary(checked: Sequence[CheckedFile]) -> str:
    """Return the numbers of problems and of their files: ``Found 1 error in 1 file``."""
    problems = [problem for file in checked for problem in file.problems]
    warnings = sum(problem.warning for problem in problems)
    counts = [(len(problems) - warnings, "error"), (warnings, "warning")]
    listed = " and ".join(_many(count, noun) for count, noun in counts if count)
    faulty = len({problem.file for problem in problems})
    others = f", {len(checked)} files checked" if len(checked) > 1 else ""
    return f"Found {listed} in {_many(faulty, 'file')}{others}"


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"


def _lines_of(path: Path) -> list[str]:
    try:
        return _lines(path.read_bytes())
    except (OSError, ValueError):  # a message may name what is no file
        return []


def _lines(content: bytes) -> list[str]:
    """Return the lines of a file, as locations count them."""
    return re.split(r"\r\n?|\n", content.decode("utf-8-sig", "replace"))


def _shown(text: str) -> str:
    """Return text of an excerpt: tabs as a space, other control characters escaped."""
    return printable(text.replace("\t", " "))


def _cells(text: str) -> int:
    """Return how many columns of a terminal a text takes."""
    return sum(2 if east_asian_width(character) in "WF" else 1 for character in text)


def _paint(text: str, colour: str) -> str:
    return f"\x1b[{colour}m{text}\x1b[0m"


def _plain(text: str, _colour: str) -> str:
    return text


def _escaped(text: str, others: str = "") -> str:
    """Return text of a workflow command, in which some characters have a meaning."""
    for character in f"%\r\n{others}":
        text = text.replace(character, f"%{ord(character):02X}")
    return text
