"""Command line of ``star report``."""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

from star_core import InputError, Registry, read_run
from star_core.commands import replace_file, writing
from star_core.toolkit import Progress, WrittenReport
from star_report.study import FILE


def run(options: argparse.Namespace, _registry: Registry) -> int:
    """Write the page and return the exit status, 0.

    Raises:
        InputError: The folder holds no complete record, or the page cannot be written.
    """
    report = write(Path(options.run), Path(options.out) if options.out else None)
    sys.stdout.write(f"{report.page}\n")
    return 0


def require_plotly() -> None:
    """Raise `InputError` if the package that draws is not installed."""
    if find_spec("plotly") is None:
        text = "star report needs plotly: pip install 'star-swarm[report]'"
        raise InputError(text, "missing-package")


def write(folder: Path, out: Path | None = None) -> WrittenReport:
    """Write the page of a run or a study, to ``report.html`` in its folder if not given.

    Tables, statistics and figures of a study are written beside its page, unless that is elsewhere.

    Raises:
        InputError: The folder holds no complete record, the page cannot be written, or the package
            that draws is not installed.
    """
    path = out or folder / "report.html"
    with Progress(f"drawing the report of {folder}"), writing(path):
        if (folder / FILE).is_file():
            from star_report.study_page import page, report, summary, write_tables

            study = report(folder)
            text = page(study)
            written = WrittenReport(path, summary(study.study), study.tables)
            if out is None:
                write_tables(study, folder)
        else:
            require_plotly()
            from star_report.page import page as page_of_flight

            text = page_of_flight(read_run(folder, flown=True))
            written = WrittenReport(path)
        if out is None:  # the folder may be of others
            replace_file(path, text)
        else:
            path.write_text(text, encoding="utf-8")
    return written


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Write a recorded flight or a study as one HTML page that needs no network. "
        "Of a flight: outcome, events, top view, 3-D replay, and error, separation, altitude and "
        "battery over time. Of a study: measures by condition, differences, marginal means; "
        "and beside the page tables (Markdown, LaTeX), statistics (CSV) and figures (SVG)."
    )
    line.add_argument("run", help="folder of a run or of a study: runs/TIME-NAME")
    line.add_argument("-o", "--out", metavar="FILE", help="file to write (RUN/report.html)")
