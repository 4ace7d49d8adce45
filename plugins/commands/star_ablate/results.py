"""Results of a study: those of its runs, and results.md, with one row per condition."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from statistics import fmean, stdev
from typing import Any, Final, NamedTuple, TypeAlias

from star_ablate.flight import Result
from star_ablate.study import Run, Study
from star_core.toolkit import STUDY_COLUMNS, StudyFlight, StudyResults, value_at

Results: TypeAlias = Sequence[tuple[Run, Result]]

CONFIDENCE: Final = 0.95
MAX_MEASURE: Final = 1e100  # whose variance is finite
MISSING: Final = "-"  # in a cell


class Statistics(NamedTuple):
    """Statistics of a sample.

    Attributes:
        n: Sample size.
        mean: Mean.
        std: Standard deviation of the sample (n - 1); NaN if n is 1.
        half_width: Half the width of the 95 % interval of the mean; NaN if n is 1.
    """

    n: int
    mean: float
    std: float
    half_width: float


def statistics(values: Sequence[float]) -> Statistics:
    """Return the statistics of a sample that is not empty.

    The interval is Student's (Biometrika 6(1), 1908): the mean ± t s/√n, with t the 97.5 % point
    of the t distribution with n - 1 degrees of freedom.

    >>> round(statistics([1.0, 2.0, 3.0]).half_width, 4)
    2.4841
    """
    n = len(values)
    if n == 1:
        return Statistics(1, float(values[0]), math.nan, math.nan)
    from scipy.special import stdtrit  # scipy.stats takes a second to import

    std = stdev(values)
    t = float(stdtrit(n - 1, (1 + CONFIDENCE) / 2))
    return Statistics(n, fmean(values), std, t * std / math.sqrt(n))


def finite(values: Sequence[Any]) -> list[float]:
    """Return the numbers up to `MAX_MEASURE` among some values; booleans count as 0 or 1."""
    numbers = (value for value in values if isinstance(value, int | float))
    return [float(value) for value in numbers if abs(value) <= MAX_MEASURE]


def study_results(results: Results, *, interrupted: bool) -> StudyResults:
    """Return the results of a study, in the order of `results`."""
    flights = (
        StudyFlight(
            run.condition.file,
            run.condition.levels,
            run.seed,
            result.outcome,
            result.reason,
            result.wall_time,
            result.summary,
        )
        for run, result in results
    )
    return StudyResults(tuple(flights), interrupted)


def as_markdown(study: Study, results: Results) -> str:
    """Return a page with a table of one row per condition, and the runs that did not complete."""
    measures = _measures(study)
    total = len(study.conditions) * study.each
    many = "seed" if study.each == 1 else "seeds"
    with_seeds = "own seeds" if study.seeds is None else f"{study.each} {many} each"
    lines = [
        f"# {study.name}",
        "",
        f"{len(results)} of {total} runs: {len(study.conditions)} conditions, {with_seeds}.",
        "",
        _row(["mission", *study.factors, "n", "completed", *measures]),
        _row(["---"] * (1 + len(study.factors)) + ["---:"] * (2 + len(measures))),
        *(_row(cells) for cells in _rows(study, results, measures)),
        "",
        f"Measures are mean ± standard deviation over seeds [{CONFIDENCE:.0%} interval of the mean,"
        " Student's t], over all n runs that have the measure, completed or not; where those are"
        " fewer than the runs flown, their number is given after them.",
    ]
    others = [(run, result) for run, result in results if result.outcome != "completed"]
    if others:
        lines += ["", "## Not completed", "", _row(["run", "outcome", "reason"]), _row(["---"] * 3)]
        lines += [_row([str(run), result.outcome, result.reason]) for run, result in others]
    return "\n".join(lines) + "\n"


def _measures(study: Study) -> list[str]:
    """Return the measures that are not columns already."""
    return [measure for measure in study.measures if measure not in STUDY_COLUMNS]


def _rows(study: Study, results: Results, measures: Sequence[str]) -> Iterator[list[str]]:
    """Yield the cells of each condition."""
    by_condition: dict[tuple[str, ...], list[Result]] = {}
    for run, result in results:
        by_condition.setdefault(run.condition.names, []).append(result)
    for condition in study.conditions:
        flown = by_condition.get(condition.names, [])
        n = len(flown)
        completed = sum(result.outcome == "completed" for result in flown)
        cells = [*condition.names, str(n), f"{completed / n:.0%}" if n else MISSING]
        for measure in measures:
            values = finite([value_at(result.summary, measure) for result in flown])
            cells.append(_formatted(statistics(values), n) if values else MISSING)
        yield cells


def _formatted(value: Statistics, runs: int) -> str:
    fewer = f" (n {value.n})" if value.n < runs else ""
    if math.isnan(value.std):
        return f"{_short(value.mean)}{fewer}"
    low, high = value.mean - value.half_width, value.mean + value.half_width
    return f"{_short(value.mean)} ± {_short(value.std)} [{_short(low)}, {_short(high)}]{fewer}"


def _short(value: float) -> str:
    """Return a number to three significant digits, or as an integer if it has more."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"  # noqa: PLR2004 -- 3 figures


def _row(cells: Sequence[str]) -> str:
    escaped = (" ".join(cell.split()).replace("\\", "\\\\").replace("|", "\\|") for cell in cells)
    return "| " + " | ".join(escaped) + " |"
