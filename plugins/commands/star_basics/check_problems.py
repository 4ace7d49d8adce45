"""Problems of files as data: the location, the code and the severity that a message states."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, NamedTuple

from star_core.formats import code_of

_WARNING: Final = "warning: "
_LOCATION: Final = re.compile(
    r"(?P<assignment>--set [^\n]*?: )?"
    r"(?P<file>(?:(?!: )[^\n])+?):(?P<line>\d+):(?P<column>\d+): "
)


class FileProblem(NamedTuple):
    """A problem of a file.

    Attributes:
        text: The message as it is printed: ``file:line:col: what is wrong [code]``.
        file: The file, as the message states it.
        line: From 1; None if the message has no location.
        column: From 1; None if the message has no location.
        message: The text without location, severity and code.
        code: Stable; an empty string if there is none.
        warning: Whether the file can be used all the same.
    """

    text: str
    file: str
    line: int | None
    column: int | None
    message: str
    code: str
    warning: bool

    @property
    def severity(self) -> str:
        return "warning" if self.warning else "error"


def problem_of(text: str, path: Path, *, warning: bool = False) -> FileProblem:
    """Return the problem that a message about a file reports.

    Example:
        >>> problem = problem_of("m.yaml:3:7: warning: too near [path-blocked]", Path("m.yaml"))
        >>> problem.line, problem.column, problem.severity, problem.code, problem.message
        (3, 7, 'warning', 'path-blocked', 'too near')
    """
    code = code_of(text)
    message = text.removesuffix(f" [{code}]")
    file, line, column = str(path), None, None
    if match := _LOCATION.match(message):
        file, line, column = match["file"], int(match["line"]), int(match["column"])
        message = (match["assignment"] or "") + message[match.end() :]
    message = message.removeprefix(f"{path}: ")
    warning = warning or message.startswith(_WARNING)
    return FileProblem(
        text, file, line, column, message.removeprefix(_WARNING), code, warning=warning
    )
