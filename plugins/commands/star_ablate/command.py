"""``star ablate`` as its user sees it: reads a study, flies what is missing, writes the results."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from difflib import get_close_matches
from pathlib import Path
from types import FrameType
from typing import Final

from star_ablate import results
from star_ablate.flight import Result, Task
from star_ablate.journal import Journal
from star_ablate.measures import paths
from star_ablate.progress import Progress
from star_ablate.reading import read
from star_ablate.study import COLUMNS, Run, Study
from star_ablate.workers import fly_all
from star_core import InputError, Registry, new_folder

JOURNAL: Final = "runs.jsonl"
DONE, INTERRUPTED = 0, 1  # exit status; bad input is 2, as with every command


def main(arguments: Sequence[str]) -> int:
    """Fly a study and return the exit status: 0 when every run has been flown, however it ended.

    Raises:
        InputError: The study cannot be flown, or its folder cannot be written.
    """
    options = parser().parse_args(arguments)
    study = read(Path(options.study), Registry(), options.seeds)
    folder = _folder(options.out, study.name)
    try:
        return _ablate(study, folder, options)
    except BrokenPipeError:  # whoever read the table has gone
        raise
    except OSError as error:
        raise InputError([f"{folder}: cannot be written: {error.strerror or error}"]) from error


def parser() -> argparse.ArgumentParser:
    """The command line, apart so that the docs and the tests can read it."""
    star = argparse.ArgumentParser(
        prog="star ablate",
        description="Fly missions x levels x seeds, and tabulate what was measured.",
        allow_abbrev=False,
    )
    star.add_argument("study", help="study file (YAML)")
    star.add_argument(
        "--workers", type=_positive, default=_cores(), metavar="N", help="runs at once: %(default)s"
    )
    star.add_argument("--seeds", type=_positive, metavar="N", help="fly N seeds")
    star.add_argument(
        "--out", metavar="DIR", help="results into DIR, going on if it has some (runs/TIME-STUDY)"
    )
    star.add_argument("--record", action="store_true", help="keep the record of every run")
    star.add_argument("--quiet", action="store_true", help="write the table, but do not print it")
    return star


def _ablate(study: Study, folder: Path, options: argparse.Namespace) -> int:
    """Fly what is not in `folder` yet, and write its results.

    Raises:
        OSError: It cannot be written.
    """
    runs = list(study.runs())
    folder.mkdir(parents=True, exist_ok=True)
    _write(folder / "study.json", json.dumps(_about(study), indent=2) + "\n")
    with Journal(folder / JOURNAL) as journal:
        found = {run.key: journal.done[run.key] for run in runs if run.key in journal.done}
        missing = [run for run in runs if run.key not in found]
        tasks = [
            Task(run.mission(), _place(folder, run) if options.record else None) for run in missing
        ]
        with _interrupts() as interrupts, Progress(study.name, len(runs), len(found)) as progress:
            flying = fly_all(
                tasks,
                options.workers,
                folder / "log.txt",
                study.time_limit,
                stopped=lambda: bool(interrupts),
            )
            with closing(flying):
                for index, result in flying:
                    found[missing[index].key] = result
                    journal.add(missing[index], result)
                    progress.add(missing[index], result)
        interrupted = bool(interrupts)
    done = [(run, found[run.key]) for run in runs if run.key in found]
    table = results.as_markdown(study, done)
    _write(folder / "results.csv", results.as_csv(study, done))
    _write(folder / "results.md", table)
    sys.stderr.writelines(f"star: {line}\n" for line in _unknown(study, done))
    if interrupted:
        sys.stderr.write(f"star: interrupted; to go on, add `--out {folder}`\n")
    if not options.quiet:
        sys.stdout.write(f"{table}\nresults: {folder}\n")
    return INTERRUPTED if interrupted else DONE


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Collect interrupts from the keyboard; the second one ends the process at once.

    An exception instead could come anywhere, in code too that swallows it.
    """
    caught: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        caught.append(number)
        if len(caught) > 1:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, note)
    try:
        yield caught
    finally:
        signal.signal(signal.SIGINT, before)


def _about(study: Study) -> dict[str, object]:
    """Return what was flown, for records."""
    parts = {part for c in study.conditions for part in map(str, c.mission.parts.values())}
    return {"study": study.data, "seeds": study.seeds, "plugins": sorted(parts)}


def _unknown(study: Study, done: Sequence[tuple[Run, Result]]) -> list[str]:
    """Return a line for each measure that no summary has: a slip of the pen, most likely."""
    known = {path for _, result in done for path in paths(result.summary or {})}
    lines = []
    for measure in study.measures if known else ():
        if measure not in known and measure not in COLUMNS:
            close = get_close_matches(measure, known, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            lines.append(f"no run has the measure {measure!r}{hint}")
    return lines


def _place(folder: Path, run: Run) -> Path:
    """Return where the record of a run is kept."""
    levels = (f"{name}={level}" for name, level in run.condition.levels.items())
    return Path(folder, "runs", run.condition.file, *levels, f"seed={run.seed}")


def _folder(out: str | None, name: str) -> Path:
    """Return where results go.

    Raises:
        InputError: It is no folder, or holds something else than a study.
    """
    if out is None:
        return new_folder(name)
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise InputError([f"--out {out}: is no folder"])
    if folder.exists() and any(folder.iterdir()) and not (folder / JOURNAL).is_file():
        raise InputError([f"--out {out}: holds something else than a study; name another folder"])
    return folder


def _write(path: Path, text: str) -> None:
    """Write a file in one piece: whoever reads it finds the old one or the new one."""
    new = path.with_name(f"{path.name}.new")
    new.write_text(text, encoding="utf-8")
    new.replace(path)


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError(text)
    return number


_positive.__name__ = "positive whole number"  # as argparse calls it


def _cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
