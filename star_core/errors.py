"""Every error that STAR raises on purpose.

Catch `StarError` at a boundary (the command line does); catch a child only to act on it. A message
states what is wrong, where, what was expected and, where there is one, the next step. It starts in
lower case, has no full stop, shows values through ``!r``, and ends with its code in brackets.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from pathlib import Path

MAX_LISTED = 10  # names of agents in a message


def coded(message: str, code: str) -> str:
    """Return a message that ends with a stable code; one that ends with a code keeps it.

    Every code has a hyphen and an entry in the catalogue of ``star errors``.

    >>> coded("no such file", "file-not-found")
    'no such file [file-not-found]'
    >>> coded("m.yaml: no such file [file-not-found]", "invalid-input")
    'm.yaml: no such file [file-not-found]'
    """
    if code_of(message) or not message:
        return message
    return f"{message} [{code}]"


def code_of(message: str) -> str:
    """Return the code that a message ends with, or an empty string."""
    code = re.search(r" \[([a-z]+(?:-[a-z]+)+)\]\Z", message)
    return code[1] if code else ""


def printable(text: str) -> str:
    r"""Return a text with its control characters escaped, for a terminal.

    Names of files and texts of clients may hold sequences that move the cursor, rename the window
    or hide what is printed. Line breaks stay.

    >>> printable("a\x1b[2J.yaml")
    'a\\x1b[2J.yaml'
    """
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)


class Problem(NamedTuple):
    """A mistake in a file that its schema cannot detect.

    Attributes:
        path: Keys and indices from the plugin's options to the value; empty for the whole.
        message: What is wrong and what was expected.
        code: Identifies the kind of mistake, see ``star errors``.
        warning: Whether the mission can be flown all the same.
    """

    path: tuple[str | int, ...]
    message: str
    code: str = "invalid-option"
    warning: bool = False


class SourceFile(Protocol):
    """A file as read, whose problems are reported with their locations."""

    @property
    def path(self) -> Path:
        """The file, as the user named it."""

    @property
    def data(self) -> dict[str, Any]:
        """The content: maps, lists, text, numbers, booleans and None."""

    def problem(
        self, path: tuple[str | int, ...], message: str, code: str = ..., *, key: bool = False
    ) -> str:
        """Return ``file:line:column: message [code]``.

        Args:
            path: Keys and indices from the top of the file to the value.
            message: What is wrong and what was expected.
            code: Identifies the kind of mistake.
            key: Whether it is the key that is wrong.
        """

    def located(self, problems: Iterable[Problem]) -> list[str]:
        """Return problems as one line each with its location, in the order of the file."""


class StarError(Exception):
    """Base of the errors that a user or a plugin author can correct.

    Args:
        message: What is wrong, and what to do.
        code: Identifies the kind of error, see ``star errors``; the last
            words of the text.
            If the message already ends with a code, such as that of another error, it is kept.
    """

    code = "invalid-argument"

    def __init__(self, message: str, code: str = "") -> None:
        super().__init__(coded(message, code or self.code))
        self.code = code_of(str(self))

    @property
    def message(self) -> str:
        """The text without its code, to be embedded in another message."""
        return str(self).removesuffix(f" [{self.code}]")


class InputError(StarError):
    """A file or an option that a user wrote cannot be used as it is.

    Args:
        problems: One message, or several.
        code: Of the problems that have none yet.

    Attributes:
        problems: One line each, with its location: ``file:line:col: what is wrong [code]``.
    """

    code = "invalid-input"

    def __init__(self, problems: Sequence[str] | str, code: str = "") -> None:
        problems = [problems] if isinstance(problems, str) else problems
        self.problems = tuple(coded(problem, code or self.code) for problem in problems)
        super().__init__("\n".join(self.problems), code)


class PluginError(StarError):
    """A plugin is missing, broken, in conflict with another, or failed in flight."""

    code = "plugin-failed"


class ContractError(StarError):
    """A table or a return value that breaks its contract."""

    code = "contract-broken"


class CommandError(ContractError):
    """A command that cannot be sent; its task does not give it again."""


def shortlist(items: Iterable[str], separator: str = ", ", most: int = MAX_LISTED) -> str:
    """Return the first items of a list, such as the names of agents, and how many more it has.

    >>> shortlist(["cf1", "cf3"]), shortlist(map(str, range(1, 351)))
    ('cf1, cf3', '1, 2, 3, 4, 5, 6, 7, 8, 9, 10 and 340 more')
    """
    texts = list(items)
    rest = len(texts) - most
    return separator.join(texts[:most]) + (f" and {rest} more" if rest > 0 else "")


def suggestion(
    word: object, known: Iterable[str], listing: str = "", most: int | None = None
) -> str:
    """Name what was perhaps meant or, after `listing`, all there is; of it at most `most`.

    >>> suggestion("orcaa", ["none", "orca"]), suggestion("x", ["none", "orca"], "installed")
    ("; did you mean 'orca'?", '; installed: none, orca')
    """
    from difflib import get_close_matches

    names = list(known)
    if close := get_close_matches(str(word).lower(), names, n=1):
        return f"; did you mean {close[0]!r}?"
    listed = shortlist(names, most=len(names) if most is None else most)
    return f"; {listing}: {listed}" if names and listing else ""
