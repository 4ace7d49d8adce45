"""Reports beside results: the command ``report``, called by commands that write a folder."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path

from star_core.errors import StarError
from star_core.registry import Registry


def write_report(folder: Path, registry: Registry) -> str:
    """Write the report of a run or a study; return a line with its file, or why there is none."""
    printed = io.StringIO()
    try:
        with redirect_stdout(printed):
            registry.find("command", "report").offer.make([str(folder)])
    except StarError as error:
        return f"no report: {error.message}"
    return f"report: {printed.getvalue().strip()}"
