"""Results of a study: results.csv, one row per run, and results.md, one row per condition."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from io import StringIO
from typing import Any, Final, TypeAlias

from star_ablate.flight import Result
from star_ablate.measures import CONFIDENCE, Spread, measured, numbers, spread
from star_ablate.study import COLUMNS, Run, Study

Results: TypeAlias = Sequence[tuple[Run, Result]]

NOTHING: Final = "-"  # in a cell


def as_csv(study: Study, results: Results) -> str:
    """Return a table with a header and a row for each run, in the order of `results`.

    Numbers have full precision. A measure that a run does not have is empty.
    """
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    measures = _further(study)
    table.writerow(
        ["mission", *study.factors, "seed", "outcome", "reason", *measures, "wall_time_s"]
    )
    for run, result in results:
        table.writerow(
            [
                *run.condition.names,
                run.seed,
                result.outcome,
                result.reason,
                *(_cell(measured(result.summary, measure)) for measure in measures),
                f"{result.wall_time:.3f}",
            ]
        )
    return text.getvalue()


def as_markdown(study: Study, results: Results) -> str:
    """Return a page with a table of one row per condition, and the runs that did not complete."""
    measures = _further(study)
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


def _further(study: Study) -> list[str]:
    """Return the measures that are not columns already."""
    return [measure for measure in study.measures if measure not in COLUMNS]


def _rows(study: Study, results: Results, measures: Sequence[str]) -> Iterator[list[str]]:
    """The cells of each condition."""
    of: dict[tuple[str, ...], list[Result]] = {}
    for run, result in results:
        of.setdefault(run.condition.names, []).append(result)
    for condition in study.conditions:
        flown = of.get(condition.names, [])
        n = len(flown)
        completed = sum(result.outcome == "completed" for result in flown)
        cells = [*condition.names, str(n), f"{completed / n:.0%}" if n else NOTHING]
        for measure in measures:
            values = numbers([measured(result.summary, measure) for result in flown])
            cells.append(_shown(spread(values), n) if values else NOTHING)
        yield cells


def _shown(found: Spread, runs: int) -> str:
    fewer = f" (n {found.n})" if found.n < runs else ""
    if math.isnan(found.sd):
        return f"{_short(found.mean)}{fewer}"
    low, high = found.mean - found.half, found.mean + found.half
    interval = f"[{_short(low)}, {_short(high)}]"
    return f"{_short(found.mean)} ± {_short(found.sd)} {interval}{fewer}"


def _short(value: float) -> str:
    """Return a number to three significant digits, or as an integer if it has more."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"  # noqa: PLR2004 -- 3 figures


def _row(cells: Sequence[str]) -> str:
    escaped = (" ".join(cell.split()).replace("\\", "\\\\").replace("|", "\\|") for cell in cells)
    return "| " + " | ".join(escaped) + " |"


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    return json.dumps(value) if isinstance(value, Mapping | list | bool) else value
