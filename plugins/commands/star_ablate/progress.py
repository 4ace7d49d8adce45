"""Displays the progress of a study: a live bar, or one line per run if piped."""

from __future__ import annotations

from collections import Counter
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar

from star_ablate.flight import Result
from star_ablate.study import Run


class Progress:
    """Writes to standard error.

    Args:
        title: The study's name.
        total: Number of runs.
        done: Number of runs completed before.
        console: Output console.

    Attributes:
        outcomes: Number of runs with each outcome since the start.
    """

    def __init__(self, title: str, total: int, done: int, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._total = total
        self._done = done
        self.outcomes: Counter[str] = Counter()
        self._bar = Bar(
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
        self._task = self._bar.add_task("", total=total, completed=done, others="")

    def add(self, run: Run, result: Result) -> None:
        """Report a completed run; with a bar, only if its mission did not complete."""
        self._done += 1
        self.outcomes[result.outcome] += 1
        because = f": {result.reason}" if result.reason else ""
        line = f"{run}: {result.outcome}{because}"
        if not self._console.is_terminal:
            self._print(f"[{self._done}/{self._total}] {line}, in {result.wall_time:.1f} s")
        elif result.outcome != "completed":
            self._print(line)
        others = (f"{n} {name}" for name, n in self.outcomes.items() if name != "completed")
        self._bar.update(self._task, completed=self._done, others=", ".join(others))

    def _print(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._bar.stop()
