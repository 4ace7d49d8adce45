"""What a plugin has written of a run or a study, by the hook ``star_report``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


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
