"""Every error that STAR raises on purpose.

Catch `StarError` at a boundary (the command line does); catch a child only to act on it. A message
says what was wrong, where, what was expected and, where there is one, the next step. It starts in
lower case, has no full stop, and shows values through ``!r``.
"""

from __future__ import annotations

TYPE_CHECKING = False  # what type checkers take for true; `typing` itself is slow to import
if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


class StarError(Exception):
    """Base of the errors that a user or a plugin author can put right."""


class InputError(StarError):
    """A file or an option that a user wrote cannot be used as it is.

    Attributes:
        problems: One line each, with its place: ``file:line:col: what is wrong``.
    """

    def __init__(self, problems: Sequence[str] | str) -> None:
        problems = [problems] if isinstance(problems, str) else problems
        super().__init__("\n".join(problems))
        self.problems = tuple(problems)


class PluginError(StarError):
    """A plugin is missing, broken, in conflict with another, or failed in flight."""


class ContractError(StarError):
    """A table or an answer that breaks its contract."""


def instead(word: object, known: Iterable[str], listing: str = "") -> str:
    """Name what was perhaps meant or, after `listing`, all there is.

    >>> instead("orcaa", ["none", "orca"]), instead("x", ["none", "orca"], "installed")
    ("; did you mean 'orca'?", '; installed: none, orca')
    """
    from difflib import get_close_matches

    names = list(known)
    if close := get_close_matches(str(word).lower(), names, n=1):
        return f"; did you mean {close[0]!r}?"
    return f"; {listing}: {', '.join(names)}" if names and listing else ""
