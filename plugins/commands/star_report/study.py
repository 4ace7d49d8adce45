"""The page of a study: every measure by condition, and its differences to the first condition."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from star_core import InputError

if TYPE_CHECKING:
    from star_report.figures import Figure

FILE: Final = "results.csv"
CONFIDENCE: Final = 0.95
JITTER: Final = 0.12  # width of the points of a condition, in conditions

Row: TypeAlias = Mapping[str, str]


class Interval(NamedTuple):
    """A mean with its 95 % interval, by Student's t."""

    n: int
    mean: float
    low: float
    high: float


class Study(NamedTuple):
    """The runs of a study.

    Attributes:
        conditions: Runs of each condition by its name, in the order of the study.
        measures: Names of the columns with numbers.
    """

    conditions: Mapping[str, Sequence[Row]]
    measures: Sequence[str]


def read(folder: Path) -> Study:
    """Return the study of a folder.

    Raises:
        InputError: Its table is not that of a study.
    """
    with (folder / FILE).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    columns = list(rows[0]) if rows else []
    if not {"mission", "seed", "outcome", "reason", "wall_time_s"} <= set(columns):
        raise InputError(f"{folder / FILE}: expected the table of a study", "no-record")
    factors = columns[: columns.index("seed")]
    if len({row["mission"] for row in rows}) == 1 and len(factors) > 1:
        factors.remove("mission")
    conditions: dict[str, list[Row]] = {}
    for row in rows:
        conditions.setdefault(", ".join(row[factor] for factor in factors), []).append(row)
    last = columns[columns.index("reason") + 1 : -1]  # without the wall time
    measures = [name for name in last if any(number(row, name) is not None for row in rows)]
    return Study(conditions, measures)


def number(row: Row, measure: str) -> float | None:
    """Return a measure of a run; None if it has none."""
    try:
        value = float(row[measure])
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def interval(values: Sequence[float]) -> Interval | None:
    """Return the mean of values with its interval; None without a value.

    >>> interval([1.0, 2.0, 3.0])._replace(low=0, high=0)
    Interval(n=3, mean=2.0, low=0, high=0)
    """
    from scipy import stats

    n = len(values)
    if not n:
        return None
    mean = math.fsum(values) / n
    if n == 1:
        return Interval(n, mean, math.nan, math.nan)
    error = stats.sem(values)
    low, high = stats.t.interval(CONFIDENCE, n - 1, mean, error) if error else (mean, mean)
    return Interval(n, mean, float(low), float(high))


def differences(study: Study, measure: str) -> dict[str, Interval | None]:
    """Return the mean difference of each condition to the first, over the seeds of both."""
    first, *others = study.conditions
    before = _by_seed(study.conditions[first], measure)
    found = {}
    for name in others:
        after = _by_seed(study.conditions[name], measure)
        found[name] = interval([after[seed] - before[seed] for seed in before if seed in after])
    return found


def page(folder: Path) -> str:
    """Return the report of a study as HTML.

    Raises:
        InputError: The folder holds no study's table.
    """
    from star_report.page import render, section

    study = read(folder)
    runs = sum(map(len, study.conditions.values()))
    sections = [
        f"<h1>{escape(folder.resolve().name)}</h1><p class=quiet>{runs} runs, "
        f"{len(study.conditions)} conditions. Points: runs; thin lines: the same seed; bars: mean "
        "with its 95 % interval by Student's t.</p>",
        _completed(study),
        *(section(i, name, "", figure(study, name)) for i, name in enumerate(study.measures)),
        _table(study),
    ]
    return render(folder.resolve().name, sections)


def figure(study: Study, measure: str) -> Figure:
    """Return the values of a measure by condition, paired by seed."""
    names = list(study.conditions)
    by_seed = [_by_seed(rows, measure) for rows in study.conditions.values()]
    seeds = list(dict.fromkeys(seed for values in by_seed for seed in values))
    shift = {seed: JITTER * (2 * k / max(1, len(seeds) - 1) - 1) for k, seed in enumerate(seeds)}
    lines = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": [c + shift[seed] for c, values in enumerate(by_seed) if seed in values],
            "y": [values[seed] for values in by_seed if seed in values],
            "line": {"color": "#c3c7cb", "width": 1},
            "hoverinfo": "skip",
            "showlegend": False,
        }
        for seed in seeds
    ]
    points = {
        "type": "scatter",
        "mode": "markers",
        "x": [c + shift[seed] for c, values in enumerate(by_seed) for seed in values],
        "y": [value for values in by_seed for value in values.values()],
        "text": [f"{names[c]}, seed {seed}" for c, values in enumerate(by_seed) for seed in values],
        "hovertemplate": "%{text}<br>%{y:.4g}<extra></extra>",
        "marker": {"color": "#56B4E9", "size": 5},
        "showlegend": False,
    }
    means = [interval(list(values.values())) for values in by_seed]
    known = [(c, mean) for c, mean in enumerate(means) if mean is not None]
    bars = {
        "type": "scatter",
        "mode": "markers",
        "x": [c + 0.25 for c, _ in known],
        "y": [mean.mean for _, mean in known],
        "error_y": {
            "type": "data",
            "array": [_or_zero(mean.high - mean.mean) for _, mean in known],
            "thickness": 2,
        },
        "hovertemplate": "mean %{y:.4g} ± %{error_y.array:.2g}<extra></extra>",
        "marker": {"color": "#0072B2", "size": 9, "symbol": "diamond"},
        "showlegend": False,
    }
    return {
        "data": [*lines, points, bars],
        "layout": {
            "xaxis": {
                "tickvals": list(range(len(names))), "ticktext": [escape(name) for name in names],
                "range": [-0.5, len(names) - 0.5], "automargin": True,
                "zeroline": False,
            },
            "yaxis": {"title": {"text": escape(measure)}, "zeroline": False},
            "height": 360,
        },
    }  # fmt: skip


def _completed(study: Study) -> str:
    """Return the share of completed runs of each condition, with its interval by Wilson."""
    from scipy import stats

    rows = []
    for name, runs in study.conditions.items():
        done = sum(run["outcome"] == "completed" for run in runs)
        share = stats.binomtest(done, len(runs)).proportion_ci(CONFIDENCE, method="wilson")
        rows.append(
            f"<tr><td>{escape(name)}<td>{len(runs)}<td>{done / len(runs):.0%} "
            f"[{share.low:.0%}, {share.high:.0%}]"
        )
    return (
        "<section><h2>Completed</h2><table><tr><th>condition<th>runs<th>completed [95 % interval "
        f"by Wilson]{''.join(rows)}</table></section>"
    )


def _table(study: Study) -> str:
    """Return means, and differences to the first condition."""
    head = "".join(f"<th>{escape(measure)}" for measure in study.measures)
    means, changes = [], []
    difference = {measure: differences(study, measure) for measure in study.measures}
    for name, runs in study.conditions.items():
        cells = [
            _shown(interval(list(_by_seed(runs, measure).values()))) for measure in study.measures
        ]
        means.append(f"<tr><td>{escape(name)}" + "".join(f"<td>{cell}" for cell in cells))
        if name in difference.get(next(iter(difference), ""), {}):
            cells = [_shown(difference[measure][name]) for measure in study.measures]
            changes.append(f"<tr><td>{escape(name)}" + "".join(f"<td>{cell}" for cell in cells))
    first = escape(next(iter(study.conditions)))
    text = (
        f"<section><h2>Means</h2><table><tr><th>condition{head}{''.join(means)}</table></section>"
    )
    if changes:
        text += (
            f"<h2>Differences to {first}, of the same seeds</h2><table>"
            f"<tr><th>condition{head}{''.join(changes)}</table>"
        )
    return f"{text}</section>"


def _by_seed(rows: Sequence[Row], measure: str) -> dict[str, float]:
    values = {f"{row['mission']} {row['seed']}": number(row, measure) for row in rows}
    return {seed: value for seed, value in values.items() if value is not None}


def _shown(found: Interval | None) -> str:
    if found is None:
        return "-"
    if math.isnan(found.low):
        return f"{found.mean:.3g}"
    return f"{found.mean:.3g} [{found.low:.3g}, {found.high:.3g}]"


def _or_zero(value: float) -> float:
    return 0.0 if math.isnan(value) else value
