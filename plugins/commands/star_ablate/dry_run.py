"""What a study would fly, and how long that takes by a few flights that are not kept."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from statistics import fmean
from typing import Final

from star_ablate.shards import Shard
from star_ablate.study import Run, Study
from star_ablate.workers import Engine
from star_core.toolkit import Progress, duration, shortlist

SAMPLE: Final = 3  # flights, of conditions that are evenly distributed
TIME_LIMIT: Final = 20.0  # s, of each of them


def describe(
    study: Study, chosen: Shard, times: Sequence[float], done: Collection[str], engine: Engine
) -> Iterator[str]:
    """Yield lines with the conditions, seeds and runs of a study, and the expected time.

    Args:
        study: The study.
        chosen: Which of its runs would be flown.
        times: Wall times of flights of the study, s; without any, some are flown.
        done: Keys of the runs that need no flight.
        engine: What would fly them.
    """
    runs = chosen.of(list(study.runs()))
    missing = [run for run in runs if run.key not in done]
    seeds = "their own" if study.seeds is None else shortlist(map(str, study.seeds))
    yield f"{len(study.conditions)} condition{'s' * (len(study.conditions) > 1)}:"
    yield from (f"  {condition}" for condition in study.conditions)
    yield f"seeds: {seeds}"
    flown = f", {len(runs) - len(missing)} of them flown" if len(missing) < len(runs) else ""
    yield f"runs of {chosen}: {len(runs)}{flown}"
    if missing:
        yield f"expected time: {_expected(missing, list(times), engine)}"


def _expected(missing: Sequence[Run], times: list[float], engine: Engine) -> str:
    source = f"{len(times)} before"
    at_least = ""
    if not times:
        jobs = [run.job() for run in missing[:: -(-len(missing) // SAMPLE)]]
        with Progress("flying a few runs, to estimate the time", len(jobs), unit="flights") as work:
            flights = engine.fly_all([jobs[0], *jobs], Path(os.devnull), TIME_LIMIT)
            for index, result in flights:
                if index:  # the first one also imports and compiles
                    times.append(result.wall_time)
                    work.done += 1
        at_least = "at least " * any(time >= TIME_LIMIT for time in times)
        source = f"{len(jobs)}, not kept"
    each = fmean(times)
    total = each * len(missing) / min(engine.size, len(missing))
    return (
        f"{at_least or 'about '}{duration(total)} with {engine.size} workers,"
        f" at {each:.2g} s a flight (mean of {source})"
    )
