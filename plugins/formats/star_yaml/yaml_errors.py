"""Why a text is not YAML: frequent mistakes in the terms of its author, others in the parser's.

The parser reports where it stopped, which is often below the mistake. The lines around that point
show what the mistake is.
"""

from __future__ import annotations

import re
import unicodedata
from contextlib import suppress
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from ruamel.yaml.error import MarkedYAMLError

_CLOSING: Final = {"[": "]", "{": "}"}
_ALIKE: Final = {*"-:,[]{}#'\" ", *"\u2018\u2019\u201c\u201d\u2212"}
_BLANK: Final = re.compile(r"\s*(#.*)?")
_KEY: Final = re.compile(r"\s*(?:- +)*([A-Za-z_][\w-]*)(?=:[^\s/]| +[\[{])")
"""A key without its colon, or without the space after it."""

_WORDS: Final = {
    r"'\\t'": "a tab stands here; YAML is indented with spaces",
    "character (.+) that cannot start": r"text cannot begin with \1; put it in quotes",
    "undefined alias '(.*)'": r"alias '*\1' is refused; write the value out",
}
"""What a pattern in the parser's words stands for."""


class _Point(NamedTuple):
    """A point in a text: line and column, from 0."""

    line: int
    column: int


class _Stop(NamedTuple):
    """Where and why the parser stopped.

    Attributes:
        problem: In the parser's words.
        context: What it was reading.
        at: Where it stopped.
        begun: Where what it was reading begins.
        lines: Of the text.
    """

    problem: str
    context: str
    at: _Point
    begun: _Point
    lines: list[str]

    def near(self) -> list[tuple[int, str]]:
        """Return the lines where it stopped and where it began, without comments, with numbers.

        Characters in quotes are replaced by an x each.
        """
        return [(i, _bare(self.lines[i])) for i in {self.at.line: 0, self.begun.line: 0}]


_Answer: TypeAlias = tuple[_Point, str] | None
"""Where a mistake is and what it is; None if it is another one."""


def explain(error: MarkedYAMLError, text: str) -> tuple[int, int, str]:
    """Return the line and the column of a mistake, from 1, and what is wrong there."""
    lines = re.split(r"\r\n?|\n", text)
    first, last = error.context_mark, error.problem_mark
    at, begun = (
        _Point(min(mark.line, len(lines) - 1), mark.column)
        for mark in (last or first, first or last)
    )
    stop = _Stop(str(error.problem), str(error.context), at, begun, lines)
    for mistake in (_words, _open_quote, _character, _colon, _bracket, _indentation):
        if (answer := mistake(stop)) is not None:
            point, message = answer
            break
    else:
        point, message = at, f"not YAML: {error.context or ''} {stop.problem}"
    return point.line + 1, point.column + 1, " ".join(message.split())


def odd_character(text: str) -> tuple[int, str]:
    """Return where a text has a character that looks like one of YAML's, and a hint; -1 if nowhere.

    >>> odd_character("\u22121.0")
    (0, 'U+2212 (minus sign) has no meaning here; replace or remove it')
    """
    for i, character in enumerate(text):
        alike = {character, unicodedata.normalize("NFKC", character)} & _ALIKE
        invisible_or_dash = unicodedata.category(character) in {"Cf", "Pd"}
        if not character.isascii() and (alike or invisible_or_dash):
            name = unicodedata.name(character, "unnamed").lower()
            return i, f"U+{ord(character):04X} ({name}) has no meaning here; replace or remove it"
    return -1, ""


def _words(stop: _Stop) -> _Answer:
    for pattern, message in _WORDS.items():
        if match := re.search(pattern, stop.problem):
            return stop.at, match.expand(message)
    return None


def _open_quote(stop: _Stop) -> _Answer:
    if "quoted scalar" not in stop.context or "escape" in stop.problem:
        return None
    quote = stop.lines[stop.begun.line][stop.begun.column]
    return stop.begun, f"the text that begins here does not end; add the closing {quote}"


def _character(stop: _Stop) -> _Answer:
    for number, line in stop.near():
        column, hint = odd_character(line)
        if hint:
            return _Point(number, column), hint
    return None


def _colon(stop: _Stop) -> _Answer:
    """Explain a colon that is missing, or is where none can stand."""
    at, lines = stop.at, stop.lines
    for number, line in stop.near():
        if match := _KEY.match(line):
            text = f"write `{match[1]}: ...`, with a colon and a space"
            return _Point(number, match.end()), text
    if "expected ':'" in stop.problem:
        return stop.begun, _no_colon(lines[stop.begun.line])
    if "mapping values are not allowed" not in stop.problem:
        return None
    above = next(iter(_above(stop)), None)
    second = re.search(r":\s", lines[at.line][: at.column])
    if above is not None and not second and not re.search(r":(\s|$)", _bare(lines[above])):
        return _Point(above, _indent(lines[above])), _no_colon(lines[above])
    text = "put a text with one in quotes, or indent this line like the one above"
    return at, f"a ': ' cannot stand here; {text}"


def _no_colon(line: str) -> str:
    """Say that a line lacks the colon between a key and its value."""
    content = re.sub(r"(^|\s)#.*", "", line).strip(" -")
    key, _, value = content.partition(" ")
    return f"{content!r} has no colon; write `{key}: {value or '...'}`"


def _bracket(stop: _Stop) -> _Answer:
    """Explain a bracket that is not closed, or that closes nothing."""
    if not stop.problem.startswith("expected"):
        return None
    at, opened = stop.at, _open_brackets(stop)
    if not opened:
        match = re.search(r"found '([\]}])'", stop.problem)
        return (at, f"'{match[1]}' closes nothing; remove it") if match else None
    bracket, point = opened[-1]
    closing = _CLOSING[bracket]
    if "<stream end>" in stop.problem:
        return point, f"'{bracket}' is not closed; add '{closing}'"
    if point.line < at.line:
        before = f", or a ',' before line {at.line + 1}"
        return point, f"'{bracket}' is not closed; add '{closing}'{before}"
    return (
        at,
        f"expected ',' or '{closing}' here; '{bracket}' is open since column {point.column + 1}",
    )


def _open_brackets(stop: _Stop) -> list[tuple[str, _Point]]:
    """Return the brackets that are open where the parser stopped."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError

    stack: list[tuple[str, _Point]] = []
    with suppress(MarkedYAMLError):  # which is the one that is explained
        for token in YAML(typ="safe", pure=True).scan("\n".join(stop.lines)):
            point = _Point(token.start_mark.line, token.start_mark.column)
            if point >= stop.at:
                break
            if token.id in _CLOSING:
                stack.append((token.id, point))
            elif stack and token.id in _CLOSING.values():
                stack.pop()
    return stack


def _indentation(stop: _Stop) -> _Answer:
    """Name the line above with which the line at which the parser stopped should be aligned.

    That is the nearest one with the least difference in indentation, among those that are of a
    list too, or not.
    """
    (number, column), lines, above = stop.at, stop.lines, _above(stop)
    ended = "<block end>" in stop.problem or "<document start>" in stop.problem
    if not ended or not above or lines[number][:column].strip(" -"):
        return None
    indent, is_item = _indent(lines[number]), _is_item(lines[number])
    if is_item != _is_item(lines[above[0]]) and indent >= _indent(lines[above[0]]):
        text = f"this line cannot follow line {above[0] + 1}"
        return stop.at, f"{text}; check its indentation and its '-'"
    alike = [i for i in above if _is_item(lines[i]) == is_item] or above
    near = min(alike, key=lambda i: abs(_indent(lines[i]) - indent))
    spaces = f"this line is indented by {indent}, line {near + 1} by {_indent(lines[near])}"
    return stop.at, f"{spaces}; what belongs together begins in the same column"


def _above(stop: _Stop) -> list[int]:
    """Return the numbers of the lines with content above the parser's, the nearest first."""
    return [i for i in range(stop.at.line - 1, -1, -1) if not _BLANK.fullmatch(stop.lines[i])]


def _bare(line: str) -> str:
    """Return a line without its comment, and with an x for each character in quotes."""
    unquoted = re.sub(r"\"[^\"]*\"|'[^']*'", lambda match: "x" * len(match[0]), line)
    return re.sub(r"(^|\s)#.*", "", unquoted)


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _is_item(line: str) -> bool:
    return line.lstrip().startswith("-")
