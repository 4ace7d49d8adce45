"""Progress of long work on stderr: bars on a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

from star_core.errors import printable
from star_core.toolkit.printable_output import escape_below_bars, unescaped

if TYPE_CHECKING:
    from rich.console import Group, RenderableType

LINE_PERIOD: Final = 3.0  # s, without a terminal: longest time without a line
SHOW_AFTER: Final = 0.5  # s, on a terminal: shorter work is not shown
REFRESH_PERIOD: Final = 0.2  # s
MAX_PAUSE: Final = 3.0  # s, between works that are short, but together long
MIN_ELAPSED: Final = 2.0  # s, before the remaining time is estimated
BAR_WIDTH: Final = 30  # columns
MINUTE: Final = 60  # s


@dataclass(eq=False, repr=False)
class Progress:
    """Long work, reported on stderr from `__enter__` to `__exit__`.

    It writes nothing if the work is done soon. A thread reads the attributes: assigning them costs
    no more than that. Within it, other work may begin; off a terminal the innermost is reported.

    Args:
        title: Describes the work.
        total: Amount of work, if known.
        unit: Unit of `total` and `done`; without one they are shown as a bar only.
        estimated: Whether the total is an estimate; amounts are shown with decimals.
        detail: More text, or a function that returns it.
        period: Longest time without a line if stderr is not a terminal, s; LINE_PERIOD by default.
        announced: Whether to write a line at the beginning, too, if stderr is not a terminal.
        view: Returns what is shown above the bar on a terminal.

    Attributes:
        done: Work done so far.
        begun: Time of `time.monotonic` from which the remaining time is estimated, s.
        before: Work done by then.

    Example:
        >>> with Progress("drawing sheets", 3, unit="sheets") as progress:
        ...     progress.done += 1
        ...     print(progress)
        drawing sheets: 1 of 3 sheets
    """

    title: str
    total: float | None = None
    _: KW_ONLY
    unit: str = ""
    estimated: bool = False
    detail: str | Callable[[], str] = ""
    period: float | None = None
    announced: bool = False
    view: Callable[[], RenderableType] | None = None
    done: float = field(default=0, init=False)
    begun: float = field(default_factory=time.monotonic, init=False)
    before: float = field(default=0, init=False)

    def __enter__(self) -> Self:
        self.begun, self.before = time.monotonic(), self.done
        _reporter.begin(self)
        return self

    def __exit__(self, *_error: object) -> None:
        _reporter.end(self)

    def __str__(self) -> str:
        return f"{self.title}: {text}" if (text := self.text()) else f"{self.title} ..."

    def text(self) -> str:
        """Return how far it is: ``12 of 150 flights, 3.1 s per flight, about 7 min left``."""
        detail = self.detail if isinstance(self.detail, str) else self.detail()
        left = self.remaining() if self.unit else None
        about = "" if left is None else f"about {duration(left)} left"
        return ", ".join(filter(None, (self._count(), detail, about)))

    def remaining(self) -> float | None:
        """Return the time that is left at the speed so far, s; None if it is not known yet."""
        elapsed, done = time.monotonic() - self.begun, self.done - self.before
        if self.total is None or done <= 0 or elapsed < MIN_ELAPSED or self.done > self.total:
            return None
        return elapsed * (self.total - self.done) / done

    def _count(self) -> str:
        if not self.unit:
            return ""
        done = f"{self.done:.1f}" if self.estimated else f"{self.done:g}"
        if self.total is None:
            return f"{done} {self.unit}"
        total = f"~{self.total:.0f}" if self.estimated else f"{self.total:g}"
        return f"{done} of {total} {self.unit}"


def log(line: str) -> None:
    """Write a line to stderr, above the bars."""
    _reporter.write(line)


def on_terminal() -> bool:
    """Return whether progress is shown as bars."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def duration(seconds: float) -> str:
    """Return a duration, rounded.

    >>> duration(7.6), duration(400), duration(8000)
    ('8 s', '7 min', '2 h 13 min')
    """
    if seconds < 2 * MINUTE:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / MINUTE), MINUTE)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


class _Reporter:
    """Writes to stderr how far the running work is, from a thread that ends with the work."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._running: list[Progress] = []
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()
        self._live: Any = None  # rich's
        self._since = 0.0  # s, begin of the first of the works that follow each other
        self._until = 0.0  # s, end of the last
        self._written = 0.0  # s, time of the last line

    def begin(self, work: Progress) -> None:
        with self._lock:
            if not self._running and time.monotonic() - self._until > MAX_PAUSE:
                self._since = time.monotonic()
            self._running.append(work)
            if work.announced and not on_terminal():
                self.write(str(work))
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, daemon=True)
                self._thread.start()

    def end(self, work: Progress) -> None:
        with self._lock:
            self._running.remove(work)
            self._until = time.monotonic()
            if not self._running and self._live is not None:
                live, self._live = self._live, None
                with suppress(OSError, ValueError):  # the terminal is gone
                    live.stop()
            thread = None if self._running else self._thread
        if thread is not None:
            self._ended.set()
            thread.join(REFRESH_PERIOD)  # unless other work has begun

    def write(self, line: str) -> None:
        line = printable(line)
        with self._lock, suppress(OSError, ValueError):  # nothing reads stderr any more
            self._written = time.monotonic()
            if self._live is None:
                sys.stderr.write(f"{line}\n")
                sys.stderr.flush()
            else:
                console = self._live.console
                console.print(line, markup=False, emoji=False, highlight=False, soft_wrap=True)

    def _run(self) -> None:
        while True:
            with self._lock:
                if not self._running:
                    self._thread = None
                    return
                with suppress(OSError, ValueError):
                    self._report(self._running)
            self._ended.wait(REFRESH_PERIOD)
            self._ended.clear()

    def _report(self, running: list[Progress]) -> None:
        now, last = time.monotonic(), running[-1]
        period = LINE_PERIOD if last.period is None else last.period
        if self._live is not None:
            self._live.update(self._picture(), refresh=True)
        elif on_terminal():
            if now - self._since >= SHOW_AFTER:
                self._show()
        elif now - max(self._since, self._written) >= period:
            self.write(str(last))

    def _show(self) -> None:
        from rich.console import Console
        from rich.live import Live

        console = Console(file=unescaped(sys.stderr), force_terminal=True)
        live = Live(
            self._picture(),
            console=console,
            auto_refresh=False,
            transient=True,
            redirect_stdout=sys.stdout.isatty(),
        )
        live.start(refresh=True)
        escape_below_bars()
        self._live = live

    def _picture(self) -> Group:
        """Return the views of all running work, and a bar for each."""
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        bars = Table.grid(padding=(0, 1))
        for work in self._running:
            done = 0 if work.total is None else min(work.done, work.total)
            bar = ProgressBar(work.total, done, width=BAR_WIDTH, pulse=work.total is None)
            bars.add_row(Text(printable(work.title)), bar, Text(printable(work.text())))
        return Group(*[work.view() for work in self._running if work.view is not None], bars)


_reporter: Final = _Reporter()
if hasattr(os, "register_at_fork"):  # threads and locks do not survive in the child
    os.register_at_fork(after_in_child=_reporter.__init__)  # type: ignore[misc]
