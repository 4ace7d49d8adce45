"""The journal of a study, by which an unfinished one is resumed, and its progress."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from star_ablate.basis import differences
from star_ablate.flight import Result
from star_ablate.study import Run
from star_core.toolkit import Progress, duration, log, on_terminal, shortlist

JOURNAL: Final = "runs.jsonl"
MAX_LINE: Final = 100_000_000  # bytes
MAX_WALL_TIME: Final = 1e9  # s
MANY: Final = 2  # changes, above which they are a list
WARM_FLIGHTS = 2  # for each worker, after its first; then the time of the study is estimated


class Entry(NamedTuple):
    """A run in a journal.

    Attributes:
        key: Of the run.
        flight: Names of its condition, and its seed.
        basis: Digests of what it depended on; empty in journals without them.
        result: Of the run.
    """

    key: str
    flight: tuple[Any, ...]
    basis: Mapping[str, str]
    result: Result


class Journal:
    """A file with one line of JSON per run, including its summary, in order of completion.

    Args:
        path: The file; created if it does not exist.
        runs: Of the study.
        kept: Measures to keep of the summaries in the file.

    Attributes:
        done: Results of the runs that have a summary, by their key. Runs that raised or crashed are
            omitted: they are flown again.
        sample: A whole summary of one of `runs`; None if there is none.
    """

    def __init__(self, path: Path, runs: Iterable[Run], kept: Sequence[str]) -> None:
        keys = {run.key for run in runs}
        self.sample: Mapping[str, Any] | None = None
        self._entries: list[Entry] = []
        for entry in entries(path) if path.exists() else ():
            if entry.result.summary is not None:
                if self.sample is None and entry.key in keys:
                    self.sample = entry.result.summary
                self._entries.append(entry._replace(result=entry.result.only(kept)))
        self.done = {entry.key: entry.result for entry in self._entries}
        self._file = path.open("a+b")
        if self._file.tell() and not _ends_line(self._file):  # its writer was killed in a line
            self._file.write(b"\n")

    def changes(self, runs: Iterable[Run]) -> Counter[str]:
        """Count the runs that were flown before, by what has changed since, in words."""
        return changes(runs, self._entries)

    def add(self, run: Run, result: Result) -> None:
        """Store the result of a run."""
        about = {"key": run.key, "mission": run.condition.file, "seed": run.seed}
        about |= {"levels": dict(run.condition.levels), "basis": dict(run.condition.basis)}
        about |= {"outcome": result.outcome, "reason": result.reason}
        about |= {"wall_time": result.wall_time, "summary": result.summary}
        self._file.write(json.dumps(about).encode() + b"\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def changes(runs: Iterable[Run], entries: Iterable[Entry]) -> Counter[str]:
    """Count the runs that a journal has, by what has changed since their flight, in words."""
    bases = {entry.flight: entry.basis for entry in entries}
    flown = [run for run in runs if _flight(run) in bases]
    return Counter(_difference(bases[_flight(run)], run.condition.basis) for run in flown)


def _flight(run: Run) -> tuple[Any, ...]:
    return (*run.condition.names, str(run.seed))


def _difference(before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """Return in words what differs between two bases.

    >>> _difference({"mission": "1", "plugin 'b'": "3"}, {"mission": "2"})
    "mission and plugin 'b' have changed"
    """
    if not before:
        return "their journal does not state the code that flew them"
    changed = differences(before, after)
    names = shortlist(changed) if len(changed) > MANY else " and ".join(changed)
    return f"{names} {'has' if len(changed) == 1 else 'have'} changed"


def entries(path: Path) -> Iterator[Entry]:
    """Yield the runs of a journal, in order of completion; lines that it cannot have are ignored.

    Of a line that is too long, `_parsed` gets pieces that are no JSON.
    """
    with path.open("rb") as file:
        while line := file.readline(MAX_LINE):
            if (entry := _parsed(line)) is not None:
                yield entry


def _ends_line(file: BinaryIO) -> bool:
    file.seek(-1, os.SEEK_END)
    return file.read(1) == b"\n"


def _parsed(line: bytes | str) -> Entry | None:
    """Return the run of a line; None if there is none."""
    try:
        match record := json.loads(line):
            case {
                "key": str(key),
                "outcome": str(outcome),
                "reason": str(reason),
                "wall_time": float(wall_time) | int(wall_time),
                "summary": dict() | None as summary,
            } if abs(wall_time) <= MAX_WALL_TIME:
                names = [record.get("mission"), *_map(record.get("levels")).values()]
                flight = (*map(str, names), str(record.get("seed")))
                result = Result(outcome, reason, wall_time, summary)
                return Entry(key, flight, _map(record.get("basis")), result)
    except (ValueError, RecursionError):
        pass
    return None


def _map(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


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
