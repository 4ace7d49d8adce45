"""Command line of ``star ablate``: reads a study, flies missing runs, and writes the results."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from star_ablate import measures
from star_ablate.dry_run import describe
from star_ablate.flight import Result
from star_ablate.journal import JOURNAL, Journal, StudyProgress, entries
from star_ablate.reading import read
from star_ablate.shards import ABOUT, Shard, merged, require_shard, shard
from star_ablate.study import Run, Study
from star_ablate.workers import Engine, Processes
from star_core import InputError, Registry, StarError
from star_core.commands import (
    output_folder,
    positive_integer,
    replace_file,
    software,
    write_report,
    writing,
)
from star_core.toolkit import Progress, StudyResults, log, print_table

DONE, INTERRUPTED = 0, 1  # exit status; bad input is 2, as with every command


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Fly a study and return the exit status: 0 when all runs are flown, whatever their outcome.

    Raises:
        InputError: The study cannot be flown, or its folder cannot be written.
    """
    if options.merge and options.shard != Shard():
        raise InputError("--shard flies runs and --merge flies none; give one", "option-conflict")
    study = _checked(Path(options.study), registry, options.seeds)
    folder = output_folder(options.out, study.name, JOURNAL)
    if options.dry_run:
        recorded = list(entries(folder / JOURNAL)) if (folder / JOURNAL).exists() else []
        done = {entry.key for entry in recorded if entry.result.summary is not None}
        times = [entry.result.wall_time for entry in recorded if entry.key in done]
        with closing(_engine(options, registry)) as engine:
            for text in describe(study, options.shard, times, done, engine):
                sys.stdout.write(f"{text}\n")
        return DONE
    if options.merge:
        flown = _merge(study, folder, [Path(name) for name in options.merge])
    else:
        require_shard(folder, options.shard)
        with closing(_engine(options, registry)) as engine, writing(folder):
            flown = _fly(study, folder, engine, chosen=options.shard, record=options.record)
    line, report = write_report(folder, registry)
    if not options.quiet:
        if report is not None:
            sys.stdout.write(f"{study.name}: {report.summary}\n\n")
            for table in report.tables[:1]:
                print_table(table)
        sys.stdout.write(f"\nresults: {folder}\n{line}\n")
    return INTERRUPTED if flown.interrupted else DONE


def fly_study(path: Path, folder: Path, workers: int | None, registry: Registry) -> StudyResults:
    """Fly the runs of a study that are missing in a folder, as the hook `star_fly_study`."""
    study = _checked(path, registry)
    folder = output_folder(str(folder), study.name, JOURNAL)
    with writing(folder):
        return _fly(study, folder, Processes(workers or _cores()))


def _checked(path: Path, registry: Registry, seeds: int | None = None) -> Study:
    """Return a study whose missions can be flown."""
    with Progress(f"checking the missions of {path}"):
        return read(path, registry, seeds)


def _engine(options: argparse.Namespace, registry: Registry) -> Engine:
    """Return what flies the runs.

    Raises:
        InputError: Options contradict each other, or a cluster cannot be reached.
    """
    if options.scheduler is None and options.scheduler_file is None:
        return Processes(options.workers or _cores())
    if options.record or options.workers:
        wrong = "--record and --workers are for this machine; leave them out with a scheduler"
        raise InputError(wrong, "option-conflict")
    from star_ablate.cluster import Cluster

    return Cluster(registry, options.scheduler, options.scheduler_file)


def _cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = "Fly missions x levels x seeds, and tabulate the measures."
    line.add_argument("study", help="study file (YAML)")
    line.add_argument(
        "--workers", type=positive_integer, metavar="N", help=f"parallel runs: {_cores()}"
    )
    line.add_argument("--seeds", type=positive_integer, metavar="N", help="number of seeds")
    line.add_argument(
        "--out", metavar="DIR", help="output folder; resumes its study (runs/TIME-STUDY)"
    )
    line.add_argument(
        "--shard",
        type=shard,
        default=Shard(),
        metavar="I/N",
        help="fly the runs I, I + N, ... only, for several machines",
    )
    line.add_argument(
        "--merge", nargs="+", metavar="DIR", help="fly nothing: join the folders of all shards"
    )
    cluster = line.add_mutually_exclusive_group()
    cluster.add_argument(
        "--scheduler", metavar="ADDRESS", help="fly on a running Dask cluster: tcp://HOST:8786"
    )
    cluster.add_argument(
        "--scheduler-file", metavar="FILE", help="likewise, by the file that its scheduler wrote"
    )
    line.add_argument(
        "--dry-run", action="store_true", help="print conditions, runs and the expected time only"
    )
    line.add_argument("--record", action="store_true", help="keep the record of every run")
    line.add_argument("--quiet", action="store_true", help="print no table")


def _fly(
    study: Study, folder: Path, engine: Engine, *, chosen: Shard | None = None, record: bool = False
) -> StudyResults:
    """Fly the runs that are missing in `folder`, write their table, and return the results."""
    chosen = chosen or Shard()
    _begin(study, folder, chosen)
    runs, kept = chosen.of(list(study.runs())), study.measures
    with closing(Journal(folder / JOURNAL, runs, kept)) as journal, _interrupts() as interrupts:
        results_by_key = {run.key: journal.done[run.key] for run in runs if run.key in journal.done}
        missing = [run for run in runs if run.key not in results_by_key]
        for change, count in journal.changes(missing).items():
            again = "1 run is" if count == 1 else f"{count} runs are"
            log(f"star: {again} flown again: {change}")
        jobs = [run.job(_record(folder, run) if record else None) for run in missing]
        output, limit = folder / "log.txt", study.time_limit
        flights = engine.fly_all(jobs, output, limit, stopped=lambda: bool(interrupts))
        progress = StudyProgress(study.name, len(runs), len(results_by_key), engine.size)
        unchecked = journal.sample is None
        if journal.sample is not None:
            _require_measures(study, journal.sample)
        error: StarError | None = None
        with progress, closing(flights):
            try:
                for index, result in flights:
                    results_by_key[missing[index].key] = result.only(kept)
                    journal.add(missing[index], result)
                    progress.add(missing[index], result)
                    if unchecked and result.summary is not None:
                        _require_measures(study, result.summary)
                        unchecked = False
            except StarError as raised:  # what is flown is kept
                error = raised
    done = [(run, results_by_key[run.key]) for run in runs if run.key in results_by_key]
    flown = _write_results(study, folder, done, interrupted=bool(interrupts))
    if interrupts or error:
        end = "interrupted" if interrupts else f"{len(done)} of {len(runs)} runs are flown"
        sys.stderr.write(f"star: {end}; to resume, add `--out {folder}`\n")
    if error:
        raise error
    return flown


def _merge(study: Study, folder: Path, folders: Sequence[Path]) -> StudyResults:
    """Write the table of all shards of a study, and return their results."""
    if folder.resolve() in [each.resolve() for each in folders]:
        raise InputError(f"--out {folder}: is to be merged; name another", "option-conflict")
    runs = list(study.runs())
    with Progress("merging"):
        results_by_key = merged(runs, folders)
    with writing(folder):
        _begin(study, folder, Shard())
        with closing(Journal(folder / JOURNAL, runs, study.measures)) as journal:
            for run in runs:
                if run.key not in journal.done:
                    journal.add(run, results_by_key[run.key])
        done = [(run, results_by_key[run.key]) for run in runs]
        return _write_results(study, folder, done, interrupted=False)


def _begin(study: Study, folder: Path, chosen: Shard) -> None:
    """Make the folder of a study, and write what it is about."""
    folder.mkdir(parents=True, exist_ok=True)
    plugins = {str(choice) for c in study.conditions for choice in c.mission.plugins.values()}
    about = {
        "study": study.data,
        "runs": len(chosen.of(range(study.each * len(study.conditions)))),
        "seeds": study.seeds,
        "shard": f"{chosen.number}/{chosen.total}",
        "plugins": sorted(plugins),
        **software(),
    }
    replace_file(folder / ABOUT, json.dumps(about, indent=2) + "\n")


def _write_results(
    study: Study, folder: Path, done: Sequence[tuple[Run, Result]], *, interrupted: bool
) -> StudyResults:
    """Write the table of the runs of a study, and return its results."""
    flown = StudyResults(tuple(run.flight(result) for run, result in done), interrupted)
    replace_file(folder / "results.csv", flown.as_csv(study.factors, study.measures))
    replace_file(folder / "timings.csv", flown.timings(study.factors))
    return flown


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Collect keyboard interrupts, since code may swallow exceptions; the second one kills."""
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


def _require_measures(study: Study, summary: Mapping[str, Any]) -> None:
    """Require that a summary has the measures that no plugin offers.

    Raises:
        InputError: It lacks some; they are located in the study.
    """
    available = list(measures.paths(summary))
    wrong = [measure for measure in study.undeclared if measure not in available]
    if wrong and study.file is not None:
        problems = measures.problems(study.measures, available, wrong)
        raise InputError(study.file.located(problems))


def _record(folder: Path, run: Run) -> Path:
    """Return the folder of a run's record.

    Raises:
        InputError: A link, or the name of a level, leads out of the study's folder.
    """
    levels = (f"{name}={level}" for name, level in run.condition.levels.items())
    record = Path(folder, "runs", run.condition.file, *levels, f"seed={run.seed}")
    if not record.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{record}: a link leads out of the study's folder", "unwritable-file")
    return record
