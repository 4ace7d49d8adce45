"""The journal of a study, by which an unfinished one is resumed, and the progress on a terminal."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

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


class StudyProgress:
    """Writes to standard error.

    Args:
        title: The study's name.
        total: Number of runs.
        done: Number of runs completed before.
        console: Output console.

    Attributes:
        bar: The live bar, a context manager; it does nothing if piped.
    """

    def __init__(self, title: str, total: int, done: int, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._total = total
        self._done = done
        self._others: Counter[str] = Counter()  # outcomes other than completed
        self.bar = Progress(
            TextColumn(title),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[others]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        self._task = self.bar.add_task("", total=total, completed=done, others="")

    def add(self, run: Run, result: Result) -> None:
        """Report a completed run; with a bar, only if its mission did not complete."""
        self._done += 1
        because = f": {result.reason}" if result.reason else ""
        line = f"{run}: {result.outcome}{because}"
        if not self._console.is_terminal:
            self._print(f"[{self._done}/{self._total}] {line}, in {result.wall_time:.1f} s")
        elif result.outcome != "completed":
            self._others[result.outcome] += 1
            self._print(line)
        others = ", ".join(f"{n} {outcome}" for outcome, n in self._others.items())
        self.bar.update(self._task, completed=self._done, others=others)

    def _print(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)
