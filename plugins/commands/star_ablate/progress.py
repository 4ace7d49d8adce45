"""Displays the progress of a study: a live bar, or one line per run if piped."""

from __future__ import annotations

from collections import Counter

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
