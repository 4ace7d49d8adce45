"""Tables of reports, and their lines of text that fit a terminal."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from pathlib import Path


GAP: Final = "  "
NOTE_WIDTH: Final = 100  # columns, of the text above a table, at most
MIN_NAME: Final = 8  # columns, of a name that is longer


class ReportTable(NamedTuple):
    """A table of a report.

    Attributes:
        title: Heading.
        note: Paragraph before the table.
        names: Columns with levels, whose texts are aligned to the left.
        measures: Columns with numbers: name and, if it differs, key in the files.
        rows: Cells.
    """

    title: str
    note: str
    names: Sequence[str]
    measures: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[str]]


class WrittenReport(NamedTuple):
    """A report and what commands print of it.

    Attributes:
        page: Its file.
        summary: One sentence, or nothing.
        tables: Those on the page, the most important first.
    """

    page: Path
    summary: str = ""
    tables: Sequence[ReportTable] = ()


class _Column(NamedTuple):
    """A column as lines of text.

    Attributes:
        head: Lines of its head.
        cells: Lines of each cell.
        right: Whether it is aligned to the right.
    """

    head: Sequence[str]
    cells: Sequence[Sequence[str]]
    right: bool

    @property
    def width(self) -> int:
        return max(len(line) for cell in (self.head, *self.cells) for line in cell)

    def line(self, lines: Sequence[str], k: int) -> str:
        text = lines[k] if 0 <= k < len(lines) else ""
        return text.rjust(self.width) if self.right else text.ljust(self.width)


def table_lines(table: ReportTable, width: int | None) -> Iterator[str]:
    """Yield the lines of a table, without its title.

    Columns of numbers that do not fit beside the others follow in a table of their own, with the
    names again.

    Args:
        table: What is printed.
        width: Of the terminal, in characters; None if lines may have any length.
    """
    yield from wrap(table.note, min(width or NOTE_WIDTH, NOTE_WIDTH))
    names, measures = _columns(table, width)
    while measures:
        block = [*names, measures.pop(0)]
        while measures and (width is None or _width([*block, measures[0]]) <= width):
            block.append(measures.pop(0))
        yield ""
        yield from _block(block, len(table.rows))


def _columns(table: ReportTable, width: int | None) -> tuple[list[_Column], list[_Column]]:
    """Return the columns that are repeated, names and number of runs, and the others."""
    number = len(table.names)
    heads = [name for name, _ in table.measures]
    cells = list(zip(*table.rows, strict=True))
    measures = [_numbers(*each, width) for each in zip(heads, cells[number:], strict=True)]
    first = sum(name == "n" for name in heads[:1])
    left, others = measures[:first], measures[first:]
    names = [_names(*each, None) for each in zip(table.names, cells, strict=False)]
    if width is not None and names and others:
        free = width - _width([*left, max(others, key=lambda each: each.width)]) - len(GAP)
        most = max(each.width for each in names)
        while most > MIN_NAME and sum(min(each.width, most) + len(GAP) for each in names) > free:
            most -= 1
        names = [_names(*each, most) for each in zip(table.names, cells, strict=False)]
    return names + left, others


def _names(head: str, cells: Sequence[str], width: int | None) -> _Column:
    """Return a column of texts in lines of a width."""
    lines = [
        wrap(cell, width) or [""] if width else [" ".join(cell.split())] for cell in (head, *cells)
    ]
    return _Column(lines[0], lines[1:], right=False)


def _numbers(head: str, cells: Sequence[str], width: int | None) -> _Column:
    """Return a column of numbers; on a terminal, intervals stand below their means."""
    if width is None:
        return _Column([head], [[cell] for cell in cells], right=True)
    lines = [cell.replace(" [", "\n[").split("\n") for cell in cells]
    widest = max(len(line) for cell in lines for line in cell)
    words = head.replace("-", "- ").split()
    return _Column(wrap(head, max(widest, *map(len, words))), lines, right=True)


def _width(columns: Sequence[_Column]) -> int:
    return sum(column.width for column in columns) + len(GAP) * (len(columns) - 1)


def _block(columns: Sequence[_Column], rows: int) -> Iterator[str]:
    """Yield the lines of columns beside each other; heads end on one line."""
    height = max(len(column.head) for column in columns)
    for k in range(height):
        yield _joined(
            [column.line(column.head, k - height + len(column.head)) for column in columns]
        )
    yield "─" * _width(columns)
    for row in range(rows):
        for k in range(max(len(column.cells[row]) for column in columns)):
            yield _joined([column.line(column.cells[row], k) for column in columns])


def _joined(cells: Sequence[str]) -> str:
    return GAP.join(cells).rstrip()


def terminal_width() -> int | None:
    """Return the width of the terminal on stdout, in characters; None if there is none."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def print_table(table: ReportTable) -> None:
    """Print a table without its title, on a terminal as wide as that."""
    for line in table_lines(table, terminal_width()):
        sys.stdout.write(f"{line}\n")
