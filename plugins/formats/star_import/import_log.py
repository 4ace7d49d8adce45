"""Log of what an import refused, changed, assumed and ignored, with source locations."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from enum import StrEnum
from textwrap import fill
from typing import Any, Final

from star_core import InputError
from star_core.formats import Value, code_of
from star_core.toolkit import shortlist

NOT_SUPPORTED: Final = "is not supported"  # why a key of Crazyswarm2 is ignored
SIMILAR: Final = 0.8  # of a key to that which is probably meant, by `difflib`
WIDEST: Final = 48  # characters of a location, above which the message begins a line of its own
LOCATED: Final = re.compile(r"(.+?):(\d+):(\d+)")


class Severity(StrEnum):
    """What became of something in a file, the most important first."""

    REFUSED = "refused"
    CHANGED = "changed"
    ASSUMED = "assumed"
    IGNORED = "ignored"


@dataclass(frozen=True, slots=True)
class Note:
    """One remark about a file.

    Attributes:
        severity: What became of it.
        location: ``file:line:col``, or what else it is about.
        message: In words; equal for all that the same is true of.
        about: Name of what it is true of; empty if the location says it.
    """

    severity: Severity
    location: str
    message: str
    about: str = ""

    @property
    def file(self) -> str:
        """Name of the file, or the location if that is none."""
        match = LOCATED.fullmatch(self.location)
        return match[1] if match else self.location

    def plain(self) -> dict[str, Any]:
        """Return it as data."""
        match = LOCATED.fullmatch(self.location)
        place = {"line": int(match[2]), "column": int(match[3])} if match else {}
        about = {"about": self.about} if self.about else {}
        return {"severity": self.severity, "file": self.file, **place, "message": self.message} | (
            about
        )


@dataclass(slots=True)
class ImportLog:
    """Collects remarks, and all problems of the files before any is raised.

    Attributes:
        new_agent: How an agent that the files lack is added, with ``{}`` for its name.
        notes: Remarks, in the order of the files.
        problems: Why the files cannot be imported, one line each.
    """

    new_agent: str = "--agent {}=X,Y"
    notes: list[Note] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def changed(self, location: str, message: str, about: str = "") -> None:
        """Log what is flown differently than the files have it."""
        self.notes.append(Note(Severity.CHANGED, location, message, about))

    def assumed(self, location: str, message: str, about: str = "") -> None:
        """Log how something is understood that the files leave open."""
        self.notes.append(Note(Severity.ASSUMED, location, message, about))

    def ignored(self, location: str, message: str, about: str = "") -> None:
        """Log what has no effect."""
        self.notes.append(Note(Severity.IGNORED, location, message, about))

    def refuse(self, error: InputError) -> None:
        """Log why something was not imported."""
        for problem in error.problems:
            match = LOCATED.match(problem)
            where, _, message = problem.partition(": ")
            if match and problem.startswith(f"{match[0]}: "):
                where, message = match[0], problem.removeprefix(f"{match[0]}: ")
            self.notes.append(Note(Severity.REFUSED, where, message))

    def ignore_keys(
        self,
        entry: Value,
        read: Collection[str],
        of: str = "",
        why: str = "is not read by the original",
    ) -> None:
        """Log the keys of a map that are not `read`; `of` precedes them in the messages.

        One that is similar to a key that is read and absent is misspelled.
        """
        absent = [key for key in read if key not in entry.map()]
        for key, value in entry.map().items():
            if key in read:
                continue
            if close := get_close_matches(key, absent, n=1, cutoff=SIMILAR):
                text = f"has no effect: unknown key; did you mean {close[0]!r}?"
                self.changed(value.begins_at, text, f"{of}{key}")
            else:
                self.ignored(value.begins_at, why, f"{of}{key}")

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

    def warnings(self) -> list[str]:
        """Return what was changed, one line each: ``file:line:col: warning: message``."""
        notes = [note for note in self.notes if note.severity is Severity.CHANGED]
        return [f"{note.location}: warning: {note.message}" for note in grouped(notes)]


def grouped(notes: Iterable[Note]) -> list[Note]:
    """Return one remark for all that the same is true of in a file, the most important first."""
    groups: dict[tuple[Severity, str, str], list[Note]] = {}
    for note in dict.fromkeys(notes):
        groups.setdefault((note.severity, note.file, note.message), []).append(note)
    order = list(Severity)
    rows = []
    for (severity, _, message), members in groups.items():
        names = dict.fromkeys(note.about for note in members if note.about)
        count = "" if names or len(members) == 1 else f" ({len(members)} times)"
        text = f"{shortlist(names)}: {message}" if names else message + count
        rows.append(Note(severity, members[0].location, text))
    return sorted(rows, key=lambda row: order.index(row.severity))


def table(notes: Iterable[Note], columns: int | None = None) -> str:
    """Return remarks as lines with severity, location and message.

    Args:
        notes: Remarks.
        columns: Width of the terminal, on which messages stand below their locations.
    """
    rows = grouped(notes)
    if columns is not None:
        indent = " " * 9
        return "".join(
            f"{row.severity:8} {row.location}\n"
            + fill(row.message, columns, initial_indent=indent, subsequent_indent=indent)
            + "\n"
            for row in rows
        )
    width = max((len(row.location) for row in rows if len(row.location) <= WIDEST), default=0)
    lines = []
    for row in rows:
        indent = " " * (9 + width + 1)
        gap = " " * (width - len(row.location) + 1)
        gap = f"\n{indent}" if len(row.location) > width else gap
        lines.append(f"{row.severity:8} {row.location}{gap}{row.message}\n")
    return "".join(lines)


def as_json(notes: Iterable[Note], written: Iterable[str]) -> str:
    """Return remarks, and the files that were written, as JSON."""
    order = list(Severity)
    listed = sorted(notes, key=lambda note: order.index(note.severity))
    rows = [note.plain() for note in dict.fromkeys(listed)]
    for row in rows:
        if row["severity"] is Severity.REFUSED and (code := code_of(row["message"])):
            row["code"] = code
    return json.dumps({"written": list(written), "notes": rows}, indent=2) + "\n"


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
