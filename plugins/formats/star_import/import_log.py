"""Log of what an import assumed, changed or ignored, with source locations."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from star_core import InputError
from star_core.formats import Value

NOT_SUPPORTED: Final = (
    "is not supported"  # why a key of Crazyswarm2, or of a whole file, is ignored
)


@dataclass(slots=True)
class ImportLog:
    """Collects messages, and all problems of the files before any is raised.

    Attributes:
        new_agent: How an agent that the files lack is added, with ``{}`` for its name.
        assumptions: One line each, beginning with the location.
        warnings: One line each, beginning with the location.
        problems: Why the files cannot be imported, one line each.
    """

    new_agent: str = "--agent {}=X,Y"
    assumptions: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    @property
    def messages(self) -> list[str]:
        """The warnings, then the assumptions."""
        return [*dict.fromkeys(self.warnings), *self.assumptions]

    def add(self, location: str, message: str) -> None:
        """Log an assumption about a location."""
        self.assumptions.append(f"{location}: {message}")

    def warning(self, location: str, message: str) -> None:
        """Log a warning about a location."""
        self.warnings.append(f"{location}: warning: {message}")

    def ignored(
        self,
        entry: Value,
        read: Collection[str],
        of: str = "",
        why: str = "is not read by the original",
    ) -> None:
        """Log the keys of a map that are not `read`; `of` precedes them in the messages."""
        for key, value in entry.map().items():
            if key not in read:
                self.add(value.begins_at, f"{of}{key!r} {why}; ignored")

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Collect the problems raised inside this context, and continue after it."""
        try:
            yield
        except InputError as error:
            self.problems += error.problems

    def raise_problems(self) -> None:
        """Raise the problems collected so far, if any.

        Raises:
            InputError: All problems.
        """
        if self.problems:
            raise InputError(list(dict.fromkeys(self.problems)))


def show(values: object) -> str:
    """Format numbers as short YAML: ``[1, -0.5]``.

    >>> show([1.0, -0.50, 0.1 + 0.2]), show(0.157)
    ('[1, -0.5, 0.3]', '0.157')
    """
    if isinstance(values, list | tuple):
        return "[" + ", ".join(show(value) for value in values) + "]"
    if isinstance(values, float | int):
        short = f"{values:.6f}".rstrip("0").rstrip(".")
        return "0" if short == "-0" else short
    raise TypeError(values)
