"""Stores every run as soon as it is done, so that an unfinished study can be resumed."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from star_ablate.flight import Result
from star_ablate.study import Run


class Journal:
    """A file with one line of JSON per run, including its summary, in order of completion.

    Args:
        path: The file; created if it does not exist.

    Attributes:
        done: Results of the runs that have a summary, by their key. Runs that raised or crashed are
            omitted: they are flown again.
    """

    def __init__(self, path: Path) -> None:
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        self.done = dict(run for line in text.splitlines() if (run := _parsed(line)) is not None)
        self._file = path.open("a", encoding="utf-8")
        if text and not text.endswith("\n"):  # a previous writer was killed in the middle of a line
            self._file.write("\n")

    def add(self, run: Run, result: Result) -> None:
        """Store the result of a run."""
        about = {"key": run.key, "mission": run.condition.file, "seed": run.seed}
        levels = {"levels": dict(run.condition.levels)}
        self._file.write(json.dumps(about | levels | asdict(result)) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _parsed(line: str) -> tuple[str, Result] | None:
    """Return the key and result of a run with a summary; None for any other line."""
    try:
        found = json.loads(line)
        result = Result(*(found[name] for name in Result.__slots__))
        return (found["key"], result) if result.summary is not None else None
    except (ValueError, KeyError, TypeError):
        return None
