"""Why a text is not YAML, in the terms of its author: indentation, colons, brackets, characters.

The parser reports where it stopped, which is often below the mistake, and in its own terms. The
lines around that point show what the mistake is.
"""

from __future__ import annotations

import re
import unicodedata
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from ruamel.yaml.error import MarkedYAMLError

CLOSING = {"[": "]", "{": "}"}
MINUS = "\u2212"
PUNCTUATION = set("-:,[]{}#'\"")
_QUOTES = {"\u2018": "'", "\u2019": "'", "\u201c": '"', "\u201d": '"'}
_BLANK = re.compile(r"\s*(#.*)?")
_NO_COLON = re.compile(r"\s*(?:- +)*(?P<key>[A-Za-z_][\w-]*) +[\[{]")
_NO_SPACE = re.compile(r"\s*(?:- +)*(?P<key>[A-Za-z_][\w-]*):(?P<value>[^\s/].*)")


class _Point(NamedTuple):
    """A point in a text: line and column, from 0."""

    line: int
    column: int

    def __str__(self) -> str:
        return f"line {self.line + 1}, column {self.column + 1}"


class _Stop(NamedTuple):
    """Where and why the parser stopped, and the lines of the text.

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


_Answer: TypeAlias = tuple[_Point, str] | None
"""Where a mistake is and what it is; None if it is another one."""


def explain(error: MarkedYAMLError, text: str) -> tuple[int, int, str]:
    """Return the line and the column of a mistake, from 1, and what is wrong there."""
    lines = re.split(r"\r\n?|\n", text)
    last = len(lines) - 1
    at, begun = (
        _Point(min(mark.line, last), mark.column)
        for mark in (
            error.problem_mark or error.context_mark,
            error.context_mark or error.problem_mark,
        )
    )
    stop = _Stop(str(error.problem), str(error.context), at, begun, lines)
    for kind in (_by_words, _in_quotes, _character, _no_space, _colon, _bracket, _indentation):
        if (answer := kind(stop)) is not None:
            point, message = answer
            break
    else:
        point = at
        rest = lines[at.line][at.column :].split()
        what = f"{rest[0]!r} cannot stand here" if rest else f"not YAML: {stop.problem}"
        message = f"{what}; check the punctuation here and on the line before"
    return point.line + 1, point.column + 1, " ".join(message.split())


def odd_character(text: str) -> tuple[int, str]:
    """Return where a text has a character that looks like one of YAML's, and a hint; -1 if nowhere.

    >>> odd_character("\u22121.0")
    (0, "'\u2212' is U+2212 (minus sign), not '-'; replace it")
    """
    for i, character in enumerate(text):
        if character.isascii() or character == "\ufeff":
            continue
        category = unicodedata.category(character)
        name = unicodedata.name(character, "unnamed").lower()
        code = f"U+{ord(character):04X} ({name})"
        if category == "Zs":
            return i, f"a {name} (U+{ord(character):04X}) stands here; replace it with a space"
        if category == "Cf":
            return i, f"an invisible character stands here, {code}; remove it"
        meant = "-" if category == "Pd" or character in MINUS else _QUOTES.get(character)
        alike = unicodedata.normalize("NFKC", character)
        meant = meant or (alike if alike in PUNCTUATION else None)
        if meant:
            return i, f"{character!r} is {code}, not {meant!r}; replace it"
    return -1, ""


def _by_words(stop: _Stop) -> _Answer:
    """Explain what the parser's words identify."""
    line = stop.lines[stop.at.line]
    for words, message in {
        "'\\t'": "a tab stands here; YAML is indented with spaces",
        "another document": "a second document begins here, expected one; remove the '---'",
        "sequence entries are not": "a list begins on the line below its key; move this '-' there",
    }.items():
        if words in stop.problem:
            return stop.at, message
    if match := re.search("undefined alias '(.*)'", stop.problem):
        return stop.at, f"alias '*{match[1]}' is refused; write the value out"
    if "cannot start any token" in stop.problem and stop.at.column < len(line):
        return stop.at, f"text cannot begin with {line[stop.at.column]!r}; put it in quotes"
    return None


def _in_quotes(stop: _Stop) -> _Answer:
    if "quoted scalar" not in stop.context:
        return None
    if "escape character" in stop.problem:
        escape = stop.lines[stop.at.line][max(0, stop.at.column - 1) :][:2]
        return stop.at, f"'{escape}' is no escape sequence; write '\\\\', or use single quotes"
    quote = stop.lines[stop.begun.line][stop.begun.column]
    return stop.begun, f"the text that begins here does not end; add the closing {quote}"


def _character(stop: _Stop) -> _Answer:
    for number in dict.fromkeys((stop.at.line, stop.begun.line)):
        column, hint = odd_character(_bare(stop.lines[number]))
        if hint:
            return _Point(number, column), hint
    return None


def _no_space(stop: _Stop) -> _Answer:
    for number in dict.fromkeys((stop.begun.line, stop.at.line)):
        if match := _NO_SPACE.fullmatch(_bare(stop.lines[number])):
            text = f"put a space after the colon: `{match['key']}: {match['value']}`"
            return _Point(number, match.end("key")), text
    return None


def _colon(stop: _Stop) -> _Answer:
    """Explain a colon that is missing, or is where none can stand."""
    at, lines = stop.at, stop.lines
    if match := _NO_COLON.match(_bare(lines[at.line])):
        return _Point(at.line, match.end("key")), f"put a colon after {match['key']!r}"
    if "expected ':'" in stop.problem:
        return stop.begun, _no_colon(lines[stop.begun.line])
    if "mapping values are not allowed" not in stop.problem:
        return None
    above = _line_above(at.line, lines)
    if re.search(r":\s", lines[at.line][: at.column]) or above is None:
        return at, "a second ': ' on this line; put the text after the first in quotes"
    indent, indent_above = _indent(lines[at.line]), _indent(lines[above])
    if not re.search(r":(\s|$)", _content(lines[above])):
        return _Point(above, indent_above), _no_colon(lines[above])
    spaces = f"this line is indented by {indent}, line {above + 1} by {indent_above}"
    return at, f"{spaces}, which has a value already; indent both alike"


def _bare(line: str) -> str:
    """Return a line without its comment, and with an x for each character in quotes."""
    unquoted = re.sub(r"\"[^\"]*\"|'[^']*'", lambda match: "x" * len(match[0]), line)
    return re.sub(r"(^|\s)#.*", "", unquoted)


def _no_colon(line: str) -> str:
    """Say that a line lacks the colon between a key and its value."""
    content = _content(line)
    key, _, value = content.partition(" ")
    return f"{content!r} has no colon; write `{key}: {value or '...'}`"


def _content(line: str) -> str:
    """Return a line without its indentation, the dash of a list and its comment."""
    return re.sub(r"(^|\s)#.*", "", re.sub(r"\s*(- +)*", "", line, count=1)).strip()


def _line_above(line: int, lines: list[str]) -> int | None:
    """Return the number of the nearest line above that has content."""
    return next((i for i in range(line - 1, -1, -1) if not _BLANK.fullmatch(lines[i])), None)


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _indentation(stop: _Stop) -> _Answer:
    """Name the line above with which the line at which the parser stopped should be aligned.

    That is the nearest one with the least difference in indentation, among those that are of a
    list too, or not.
    """
    at, lines = stop.at, stop.lines
    ended = "<block end>" in stop.problem or "<document start>" in stop.problem
    above = _line_above(at.line, lines)
    if not ended or above is None or lines[at.line][: at.column].strip(" -"):
        return None
    indent, indent_above = _indent(lines[at.line]), _indent(lines[above])
    listed = _is_item(lines[at.line])
    if listed != _is_item(lines[above]) and indent >= indent_above:
        kinds = ("an item of a list", "a key") if listed else ("a key", "an item of a list")
        if indent == indent_above:
            text = f"this is {kinds[0]}, line {above + 1} is {kinds[1]}; write both alike"
        else:
            text = f"this line is indented by {indent}, but line {above + 1} is complete without it"
        return at, text
    _, _, i = min(
        (abs(_indent(line) - indent), at.line - i, i)
        for i, line in enumerate(lines[: at.line])
        if not _BLANK.fullmatch(line) and (_is_item(line) == listed or i == above)
    )
    expected = "the items of a list" if listed else "keys that belong together"
    spaces = f"this line is indented by {indent}, line {i + 1} by {_indent(lines[i])}"
    return at, f"{spaces}; {expected} begin in the same column"


def _is_item(line: str) -> bool:
    return line.lstrip().startswith("-")


def _bracket(stop: _Stop) -> _Answer:
    at, lines = stop.at, stop.lines
    stack = _open(at, lines)
    line = lines[at.line]
    character = line[at.column : at.column + 1]
    if character and character in CLOSING.values():
        if not stack:
            return at, f"'{character}' closes nothing; remove it"
        opened, bracket = stack[-1]
        if CLOSING[bracket] != character:
            what = f"'{bracket}' is open since {opened}"
            return at, f"{what}; expected '{CLOSING[bracket]}' before this '{character}'"
    if not stack:
        return None
    opened, bracket = stack[-1]
    if len(_open(_Point(at.line, len(line)), lines)) < len(stack):  # closed further to the right
        form = f"{bracket}...{CLOSING[bracket]}"
        return at, f"a ',' is missing before this, in the {form} that begins at {opened}"
    return opened, f"'{bracket}' is not closed; add '{CLOSING[bracket]}'"


def _open(until: _Point, lines: list[str]) -> list[tuple[_Point, str]]:
    """Return the brackets that are open at a point, with where they are."""
    stack: list[tuple[_Point, str]] = []
    quote = ""
    for number, line in enumerate(lines[: until.line + 1]):
        end = until.column if number == until.line else len(line)
        column = 0
        while column < min(end, len(line)):
            character, before = line[column], line[:column].rstrip()
            starts = not before or before[-1] in ":-,[{?"
            if quote:
                if character == "\\" and quote == '"':
                    column += 1
                elif character == quote:
                    quote = ""
            elif character in "'\"" and starts:
                quote = character
            elif character == "#" and (not column or line[column - 1] == " "):
                break
            elif character in CLOSING and (stack or starts):
                stack.append((_Point(number, column), character))
            elif stack and character == CLOSING[stack[-1][1]]:
                stack.pop()
            column += 1
    return stack
