"""The page of a study: every measure by condition, and differences between conditions."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from star_core import InputError
from star_report.labels import label, made

if TYPE_CHECKING:
    from star_report.figures import Figure

FILE: Final = "results.csv"
CONFIDENCE: Final = 0.95
MAX_MEASURE: Final = 1e100  # whose variance is finite
JITTER: Final = 0.12  # half the width of the points of a condition, in conditions
MEAN_SHIFT: Final = 0.27  # from the points of a condition to its mean, in conditions
FEW: Final = 12  # conditions, below which there is more space for each

Row: TypeAlias = Mapping[str, str]


class Interval(NamedTuple):
    """A mean with its 95 % interval, by Student's t; of values that are never negative, above 0."""

    n: int
    mean: float
    low: float
    high: float


class Study(NamedTuple):
    """The runs of a study.

    Attributes:
        name: Of the study, or of its folder.
        about: The content of ``study.json``; empty without it.
        factors: Names of the columns that tell conditions apart.
        conditions: Runs of each condition by its name, in the order of the study.
        baselines: The first condition of the same mission, by condition.
        measures: Names of the columns with numbers.
    """

    name: str
    about: Mapping[str, Any]
    factors: Sequence[str]
    conditions: Mapping[str, Sequence[Row]]
    baselines: Mapping[str, str]
    measures: Sequence[str]


def read(folder: Path) -> Study:
    """Return the study of a folder.

    Raises:
        InputError: Its table is not that of a study.
    """
    try:
        with (folder / FILE).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (ValueError, csv.Error) as error:
        raise InputError(f"{folder / FILE}: cannot be read: {error}", "no-record") from error
    columns = list(rows[0]) if rows else []
    whole = not any(None in row or None in row.values() for row in rows)
    if not (whole and {"mission", "seed", "outcome", "reason"} <= set(columns)):
        raise InputError(f"{folder / FILE}: expected the table of a study", "no-record")
    factors = columns[: columns.index("seed")]
    if len({row["mission"] for row in rows}) == 1 and len(factors) > 1:
        factors.remove("mission")
    conditions: dict[str, list[Row]] = {}
    for row in rows:
        conditions.setdefault(_condition(row, factors), []).append(row)
    first: dict[str, str] = {}
    for name, runs in conditions.items():
        first.setdefault(runs[0]["mission"], name)
    baselines = {name: first[runs[0]["mission"]] for name, runs in conditions.items()}
    last = columns[columns.index("reason") + 1 :]
    measures = [name for name in last if any(number(row, name) is not None for row in rows)]
    about = _about(folder)
    name = _name(about) or folder.resolve().name
    return Study(name, about, factors, conditions, baselines, measures)


def _condition(row: Row, factors: Sequence[str]) -> str:
    """Return the name of a run's condition: ``hop, avoider: orca, noise: on``, or ``orca``."""
    of_mission = [factor for factor in factors if factor == "mission"]
    others = [factor for factor in factors if factor != "mission"]
    named = len(others) > 1
    levels = [f"{factor}: {row[factor]}" if named else row[factor] for factor in others]
    return ", ".join([*(row[factor] for factor in of_mission), *levels])


def _about(folder: Path) -> Mapping[str, Any]:
    """Return the content of ``study.json``; empty if it is missing or is another file."""
    try:
        about = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return about if isinstance(about, dict) else {}


def _name(about: Mapping[str, Any]) -> str:
    study = about.get("study")
    return str(study.get("name", "")) if isinstance(study, dict) else ""


def number(row: Row, measure: str) -> float | None:
    """Return a measure of a run; None if it has none."""
    try:
        value = float(row[measure])
    except ValueError:
        return None
    return value if abs(value) <= MAX_MEASURE else None


def interval(values: Sequence[float], *, differences: bool = False) -> Interval | None:
    """Return the mean of values with its interval; None without a value.

    Counts, distances and times are never negative, nor are their means: the interval ends at 0.

    Args:
        values: Of runs.
        differences: Whether they may be negative, even if these are not.

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
    if min(values) >= 0 and not differences:
        low = max(0.0, low)
    return Interval(n, mean, float(low), float(high))


def differences(study: Study, measure: str) -> dict[str, Interval | None]:
    """Return the mean difference of each condition to its baseline, over the seeds of both."""
    intervals = {}
    for name, baseline in study.baselines.items():
        if name != baseline:
            before = _by_seed(study.conditions[baseline], measure)
            after = _by_seed(study.conditions[name], measure)
            intervals[name] = interval(
                [after[seed] - before[seed] for seed in before if seed in after], differences=True
            )
    return intervals


def page(folder: Path) -> str:
    """Return the report of a study as HTML.

    Raises:
        InputError: The folder holds no study's table.
    """
    from star_report.page import footer, render

    study = read(folder)
    runs = sum(map(len, study.conditions.values()))
    many = "condition" if len(study.conditions) == 1 else "conditions"
    sections = [
        f"<h1>{escape(study.name)}</h1><p class=quiet>{runs} runs, {len(study.conditions)} {many}. "
        "Points: runs; thin lines: the same mission and seed; diamonds: means with their 95 % "
        "intervals by Student's t, cut at 0 where no value is negative.</p>",
        _completed(study),
        *(_measure(study, i, name) for i, name in enumerate(study.measures)),
        _means(study),
        _differences(study),
        _failures(study),
        footer(made(study.about, _rows(study))),
    ]
    return render(study.name, sections)


def _rows(study: Study) -> dict[str, str]:
    """Return seeds and plugins of a study."""
    seeds = dict.fromkeys(row["seed"] for runs in study.conditions.values() for row in runs)
    plugins = study.about.get("plugins")
    return {
        "seeds": ", ".join(seeds),
        "plugins": ", ".join(map(str, plugins)) if isinstance(plugins, list) else "",
    }


def _measure(study: Study, number: int, measure: str) -> str:
    """Return the section of a measure; a sentence if it is the same in all runs."""
    from star_report.page import section

    values = [
        value for rows in study.conditions.values() for value in _by_seed(rows, measure).values()
    ]
    if len(set(values)) > 1 or len(values) == 1:
        return section(number, label(measure), "", figure(study, measure), measure)
    text = f"{values[0]:.4g} in all runs in which it is known."
    return (
        f"<section><h2>{escape(label(measure))}<code>{escape(measure)}</code></h2><p>{text}</p>"
        "</section>"
    )


def figure(study: Study, measure: str) -> Figure:
    """Return the values of a measure by condition, from top to bottom, paired by seed."""
    names = list(study.conditions)
    rows = ["<br>".join(map(escape, _levels(study, name))) for name in names]
    by_seed = [_by_seed(rows, measure) for rows in study.conditions.values()]
    seeds = list(dict.fromkeys(seed for values in by_seed for seed in values))
    shift = {seed: JITTER * (2 * k / max(1, len(seeds) - 1) - 1) for k, seed in enumerate(seeds)}
    paired: list[tuple[float | None, float | None]] = []  # a line with gaps (None)
    for seed in seeds:
        paired += [(of[seed], c + shift[seed]) for c, of in enumerate(by_seed) if seed in of]
        paired.append((None, None))
    runs = [(value, c + shift[seed], f"{names[c]}, seed {seed.rpartition(' ')[2]}")
            for c, of in enumerate(by_seed) for seed, value in of.items()]  # fmt: skip
    means = [interval(list(values.values())) for values in by_seed]
    mean_rows = [(c + MEAN_SHIFT, mean) for c, mean in enumerate(means) if mean is not None]
    marks = {"type": "scatter", "mode": "markers", "showlegend": False}
    return {
        "data": [
            {
                "type": "scatter",
                "mode": "lines",
                "x": [x for x, _ in paired],
                "y": [y for _, y in paired],
                "line": {"color": "#9aa0a6", "width": 1},
                "opacity": 0.6,
                "hoverinfo": "skip",
                "showlegend": False,
            },
            marks
            | {
                "x": [x for x, _, _ in runs],
                "y": [y for _, y, _ in runs],
                "text": [text for _, _, text in runs],
                "hovertemplate": "%{text}<br>%{x:.4g}<extra></extra>",
                "marker": {"color": "#56B4E9", "size": 5},
            },
            marks
            | {
                "x": [mean.mean for _, mean in mean_rows],
                "y": [y for y, _ in mean_rows],
                "error_x": {
                    "type": "data",
                    "array": [_or_zero(mean.high - mean.mean) for _, mean in mean_rows],
                    "thickness": 2,
                },
                "hovertemplate": "mean %{x:.4g} ± %{error_x.array:.2g}<extra></extra>",
                "marker": {"color": "#0072B2", "size": 9, "symbol": "diamond"},
            },
        ],
        "layout": {
            "xaxis": {"title": {"text": escape(label(measure))}, "zeroline": False},
            "yaxis": {
                "tickvals": list(range(len(names))), "ticktext": rows,
                "title": {"text": escape(" / ".join(study.factors)), "standoff": 14},
                "range": [len(names) - 0.4, -0.5], "automargin": True, "zeroline": False,
            },
            "margin": {"t": 10},
            "height": 90 + 60 * len(names) if len(names) < FEW else 90 + 26 * len(names),
        },
    }  # fmt: skip


def _levels(study: Study, condition: str) -> list[str]:
    """Return the levels of a condition, a cell for each factor."""
    row = study.conditions[condition][0]
    return [row[factor] for factor in study.factors]


def _cells(study: Study, condition: str) -> str:
    return "".join(f"<td>{escape(level)}" for level in _levels(study, condition))


def _head(study: Study) -> str:
    return "".join(f"<th>{escape(factor)}" for factor in study.factors)


def _completed(study: Study) -> str:
    """Return the share of completed runs of each condition, with its interval by Wilson."""
    from scipy import stats

    rows = []
    for name, runs in study.conditions.items():
        done = sum(run["outcome"] == "completed" for run in runs)
        share = stats.binomtest(done, len(runs)).proportion_ci(CONFIDENCE, method="wilson")
        rows.append(
            f"<tr>{_cells(study, name)}<td>{len(runs)}<td>{done / len(runs):.0%} "
            f"[{share.low:.0%}, {share.high:.0%}]"
        )
    return (
        f"<section><h2>Completed</h2><div class=wide><table><tr>{_head(study)}<th>runs"
        f"<th>completed [95 % interval by Wilson]{''.join(rows)}</table></div></section>"
    )


def _means(study: Study) -> str:
    rows = [
        f"<tr>{_cells(study, name)}"
        + "".join(
            f"<td>{_shown(interval(list(_by_seed(runs, measure).values())))}"
            for measure in study.measures
        )
        for name, runs in study.conditions.items()
    ]
    return f"<section><h2>Means</h2>{_table(study, rows)}</section>"


def _differences(study: Study) -> str:
    """Return differences to baselines; bold where zero is outside the interval."""
    of = {measure: differences(study, measure) for measure in study.measures}
    changed = [name for name, baseline in study.baselines.items() if name != baseline]
    if not changed or not study.measures:
        return ""
    baselines = list(dict.fromkeys(study.baselines[name] for name in changed))
    to = escape(baselines[0]) if len(baselines) == 1 else "the first condition of each mission"
    rows = []
    for name in changed:
        cells = []
        for measure in study.measures:
            difference = of[measure][name]
            sure = difference is not None and (difference.low > 0 or difference.high < 0)
            cells.append(
                f"<td><b>{_shown(difference)}</b>" if sure else f"<td>{_shown(difference)}"
            )
        rows.append(f"<tr>{_cells(study, name)}{''.join(cells)}")
    number = sum(difference is not None for row in of.values() for difference in row.values())
    return (
        f"<section><h2>Differences to {to}</h2><p class=quiet>Of runs with the same seed. Bold: "
        f"the 95 % interval does not contain zero, which by chance alone {number / 20:.2g} of the "
        f"{number} would not.</p>{_table(study, rows)}</section>"
    )


def _failures(study: Study) -> str:
    """Return the runs that did not complete."""
    rows = "".join(
        f"<tr>{_cells(study, name)}<td>{escape(run['seed'])}<td>{escape(run['outcome'])}"
        f"<td>{escape(run['reason'])}"
        for name, runs in study.conditions.items()
        for run in runs
        if run["outcome"] != "completed"
    )
    if not rows:
        return ""
    head = f"<tr>{_head(study)}<th>seed<th>outcome<th>reason"
    return (
        f"<section class=long><h2>Not completed</h2><div class=events><table>{head}{rows}</table>"
        "</div></section>"
    )


def _table(study: Study, rows: Sequence[str]) -> str:
    head = "".join(
        f"<th>{escape(label(name))}<code>{escape(name)}</code>" for name in study.measures
    )
    return f"<div class=wide><table><tr>{_head(study)}{head}{''.join(rows)}</table></div>"


def _by_seed(rows: Sequence[Row], measure: str) -> dict[str, float]:
    values = {f"{row['mission']} {row['seed']}": number(row, measure) for row in rows}
    return {seed: value for seed, value in values.items() if value is not None}


def _shown(estimate: Interval | None) -> str:
    if estimate is None:
        return "-"
    if math.isnan(estimate.low):
        return f"{estimate.mean:.3g}"
    return f"{estimate.mean:.3g} [{estimate.low:.3g}, {estimate.high:.3g}]"


def _or_zero(value: float) -> float:
    return 0.0 if math.isnan(value) else value
