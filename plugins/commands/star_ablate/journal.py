"""The journal of a study, by which an unfinished one is resumed, and its progress."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Final

from star_ablate.flight import Result
from star_ablate.study import Run
from star_core.toolkit import Progress, duration, log, on_terminal

MAX_LINE: Final = 100_000_000  # bytes
MAX_WALL_TIME: Final = 1e9  # s
WARM_FLIGHTS = 2  # for each worker, after its first; then the time of the study is estimated


class Journal:
    """A file with one line of JSON per run, including its summary, in order of completion.

    Args:
        path: The file; created if it does not exist.

    Attributes:
        done: Results of the runs that have a summary, by their key. Runs that raised or crashed are
            omitted: they are flown again.
    """

    def __init__(self, path: Path) -> None:
        self.done: dict[str, Result] = {}
        whole = True  # whether the last line ends
        for line in _lines(path) if path.exists() else ():
            whole = line.endswith(b"\n")
            if (run := _parsed(line)) is not None:
                self.done[run[0]] = run[1]
        self._file = path.open("a", encoding="utf-8")
        if not whole:  # a previous writer was killed in the middle of a line
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


def _lines(path: Path) -> Iterator[bytes]:
    """Yield the lines of a journal; of one that is too long, pieces that are no JSON."""
    with path.open("rb") as file:
        while line := file.readline(MAX_LINE):
            yield line


def _parsed(line: bytes | str) -> tuple[str, Result] | None:
    """Return the key and result of a run with a summary; None for any other line."""
    try:
        match json.loads(line):
            case {
                "key": str(key),
                "outcome": str(outcome),
                "reason": str(reason),
                "wall_time": float(wall_time) | int(wall_time),
                "summary": dict(summary),
            } if abs(wall_time) <= MAX_WALL_TIME:
                return key, Result(outcome, reason, wall_time, summary)
    except (ValueError, RecursionError):
        pass
    return None


class StudyProgress(Progress):
    """Reports each flight, and after the first ones how long the study takes.

    Args:
        title: The study's name.
        total: Number of runs.
        done: Number of runs completed before.
        workers: Number of flights at a time.
    """

    def __init__(self, title: str, total: int, done: int, workers: int) -> None:
        super().__init__(title, total, unit="flights", detail=self._outcomes)
        self.done = done
        self._workers = workers
        self._flown = 0
        self._others: Counter[str] = Counter()  # outcomes other than completed

    def add(self, run: Run, result: Result) -> None:
        """Report a completed run; on a terminal only if its mission did not complete."""
        self.done += 1
        self._flown += 1
        because = f": {result.reason}" if result.reason else ""
        line = f"{run}: {result.outcome}{because}"
        if result.outcome != "completed":
            self._others[result.outcome] += 1
        if not on_terminal():
            log(f"[{self.done}/{self.total}] {line}, in {result.wall_time:.1f} s")
        elif result.outcome != "completed":
            log(line)
        if self._flown == self._workers:  # the first flights also import and compile
            self.begun, self.before = time.monotonic(), self.done
        if self._flown == (1 + WARM_FLIGHTS) * self._workers and (left := self.remaining()):
            log(f"star: {self.rate():.1f} s per flight, about {duration(left)} left")

    def rate(self) -> float:
        """Return the wall time per flight, of all workers together, s."""
        return (time.monotonic() - self.begun) / max(1, self.done - self.before)

    def _outcomes(self) -> str:
        others = [f"{count} {outcome}" for outcome, count in self._others.items()]
        rate = [f"{self.rate():.1f} s per flight"] if self.done > self.before else []
        return ", ".join([*others, *rate])
