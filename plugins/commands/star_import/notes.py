"""What an import assumed, changed or left out, said about the place it was read at."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from star_core import InputError


@dataclass(slots=True)
class Notes:
    """Collects what is to be told, and every problem of the files before any of them is raised.

    Attributes:
        told: One line each, after its place.
        problems: Why the files cannot be imported, one line each.
    """

    told: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def say(self, place: str, message: str) -> None:
        """Tell something about a place."""
        self.told.append(f"{place}: {message}")

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Keep what is wrong in here for later, and go on after it."""
        try:
            yield
        except InputError as error:
            self.problems += error.problems

    def settle(self) -> None:
        """Raise what was wrong so far, if anything was.

        Raises:
            InputError: Every problem that was found.
        """
        if self.problems:
            raise InputError(list(dict.fromkeys(self.problems)))


def show(values: object) -> str:
    """Write numbers as short as they are, and as YAML: ``[1, -0.5]``.

    >>> show([1.0, -0.50, 0.1 + 0.2]), show(0.157)
    ('[1, -0.5, 0.3]', '0.157')
    """
    if isinstance(values, list | tuple):
        return "[" + ", ".join(show(value) for value in values) + "]"
    if isinstance(values, float | int):
        short = f"{values:.6f}".rstrip("0").rstrip(".")
        return "0" if short == "-0" else short
    raise TypeError(values)
