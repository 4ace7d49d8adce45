"""Tables of a study for people, as Markdown, LaTeX and HTML, and all statistics as CSV."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from io import StringIO
from typing import Any, Final

from star_core.toolkit import ReportTable
from star_report import comparison
from star_report.comparison import Result
from star_report.estimates import CONFIDENCE, MIN_SAMPLE, Estimate
from star_report.labels import label
from star_report.study import OUTCOME, Study

MAX_OTHERS: Final = 100  # runs that did not complete, of which the table has more
MAX_UNBROKEN: Final = 12  # rows of a table that is not divided between two sheets of paper
SIGNIFICANT: Final = 1 - CONFIDENCE  # p-value
WHOLE: Final = (1e3, 1e9)  # numbers between these are written without decimals
MISSING: Final = "-"
ALL: Final = "(all)"  # levels, over which a row is an average
METHODS: Final = (
    f"In brackets: {CONFIDENCE:.0%} intervals over the n runs that have the measure, completed or"
    " not; where those are fewer than the runs of the row, their number is given. None below"
    f" n = {MIN_SAMPLE}. Shares: Wilson. Counts: exact Poisson, unless they vary more. Otherwise"
    " Student's t, from n = 20 on the BCa bootstrap. Medians: order statistics."
)
LATEX: Final = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", "±": r"$\pm$",
    **{mark: f"\\{mark}" for mark in "&%$#_{}"},
}  # fmt: skip


class Strong(str):
    """The text of a cell that stands out."""

    __slots__ = ()


def tables(study: Study) -> tuple[list[ReportTable], dict[str, list[Result]]]:
    """Return the tables of a study, and the statistics in them by the name of their table."""
    results = {
        "condition": comparison.by_condition(study),
        "difference": comparison.differences(study),
        "marginal mean": comparison.marginal_means(study),
        "interaction": comparison.interactions(study),
    }
    conditions, medians = results["condition"], set(study.varied) - study.shares
    built = [
        _table(study, "Means", f"Mean ± standard deviation. {METHODS}", conditions, _mean),
        _table(study, *_differences(study, results["difference"]), _difference),
        _table(study, *_marginal_means(study), results["marginal mean"], _mean),
        _table(study, *_interactions(results["interaction"]), _difference),
        _table(study, "Medians", "", [r for r in conditions if r.measure in medians], _median),
        _others(study),
    ]
    return [table for table in built if table.rows], results


def as_csv(study: Study, results: Mapping[str, Sequence[Result]]) -> str:
    """Return all statistics with full precision: a row for each table, combination and measure."""
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    names = list(dict.fromkeys(["mission", *study.names]))
    columns = ["n", "mean", "std", "low", "high", "interval"]
    after = ["median", "median_low", "median_high", "baseline", "p", "p_holm"]
    rows.writerow(["table", *names, "measure", *columns, *after])
    for table, group in results.items():
        for result in group:
            levels = [result.levels.get(name, "") for name in names]
            middle = result.median[1:2] + result.median[3:5] if result.median else ("", "", "")
            last = [_levels(result.baseline), *map(_known, (result.p, result.p_holm))]
            cells = [*result.mean, *middle]
            rows.writerow([table, *levels, result.measure, *map(_known, cells), *last])
    return text.getvalue()


def _known(value: Any) -> Any:
    return "" if value is None or value != value else value  # noqa: PLR0124 -- NaN


def _levels(levels: Mapping[str, str]) -> str:
    return ", ".join(f"{name}: {level}" for name, level in levels.items())


def _table(
    study: Study, title: str, note: str, results: Iterable[Result], cell: Any
) -> ReportTable:
    """Return a table with a row for each combination of levels and a column for each measure."""
    by_levels: dict[tuple[tuple[str, str], ...], dict[str, Result]] = {}
    for result in results:
        by_levels.setdefault(tuple(result.levels.items()), {})[result.measure] = result
    measures = [m for m in study.measures if any(m in row for row in by_levels.values())]
    named = {name for levels in by_levels for name, _ in levels}
    names = [name for name in study.names if name in named]
    rows = []
    for levels, row in by_levels.items():
        n = max(result.mean.n for result in row.values())
        cells = [
            cell(row[measure], n, percent=measure in study.shares) if measure in row else MISSING
            for measure in measures
        ]
        rows.append([*(dict(levels).get(name, ALL) for name in names), str(n), *cells])
    plain = {OUTCOME, *map(label, measures)}  # keys that add nothing
    heads = [(label(measure), "" if measure in plain else measure) for measure in measures]
    return ReportTable(title, note, names, [("n", ""), *heads], rows)


def _mean(result: Result, n: int, *, percent: bool) -> str:
    mean = result.mean
    spread = "" if percent or math.isnan(mean.std) else f" ± {_short(mean.std)}"
    return f"{_short(mean.value, percent=percent)}{spread}{_interval(mean, n, percent=percent)}"


def _median(result: Result, n: int, *, percent: bool) -> str:
    middle = result.median or result.mean
    return f"{_short(middle.value, percent=percent)}{_interval(middle, n, percent=percent)}"


def _difference(result: Result, n: int, *, percent: bool) -> str:
    mean = result.mean
    text = f"{_short(mean.value, percent=percent)}{_interval(mean, n, percent=percent)}"
    if result.p_holm is None:
        return text
    p = f"p {result.p_holm:.2g}" if result.p_holm >= 0.001 else "p < 0.001"  # noqa: PLR2004
    return Strong(f"{text}, {p}") if result.p_holm < SIGNIFICANT else f"{text}, {p}"


def _interval(estimate: Estimate, n: int, *, percent: bool = False) -> str:
    fewer = f" (n {estimate.n})" if estimate.n < n else ""
    if not estimate.method:
        return fewer
    low, high = (_short(end, percent=percent) for end in (estimate.low, estimate.high))
    return f" [{low}, {high}]{fewer}"


def _short(value: float, *, percent: bool = False) -> str:
    """Return a number to three significant digits, or as an integer if it has up to nine.

    >>> _short(0.12345), _short(12345.6), _short(1e12), _short(0.5, percent=True)
    ('0.123', '12346', '1e+12', '50%')
    """
    if percent:
        return f"{value:.0%}"
    whole = WHOLE[0] <= abs(value) < WHOLE[1]
    return f"{value:.0f}" if whole else f"{value:.3g}"


def _differences(study: Study, results: Sequence[Result]) -> tuple[str, str, Sequence[Result]]:
    bases = list(dict.fromkeys(_levels(result.baseline) for result in results))
    to = bases[0] if len(bases) == 1 else _levels(study.baseline) or "the first of each mission"
    pairs = "the same mission and seed" if study.pooled else "the same seed"
    note = f"Mean difference of pairs of runs with {pairs}. {_corrected(results)}"
    return f"Differences to {to}", note, results


def _marginal_means(study: Study) -> tuple[str, str]:
    block = "mission and seed" if study.pooled else "seed"
    note = (
        "Of each level over the same combinations of the other factors. The unit is the average of"
        f" the runs with the same {block}; where all averages are equal, the run."
    )
    return "Marginal means", note


def _interactions(results: Sequence[Result]) -> tuple[str, str, Sequence[Result]]:
    references = list(dict.fromkeys(_levels(result.baseline) for result in results))
    note = (
        "How much the difference between a level of one factor and its reference is larger at a"
        f" level of the other than at that one's reference ({'; '.join(references)})."
        f" {_corrected(results)}"
    )
    return "Interactions", note, results


def _corrected(results: Sequence[Result]) -> str:
    number = sum(result.p is not None for result in results)
    if not number:
        return f"None has {MIN_SAMPLE} pairs, as a p-value needs."
    return (
        f"p-values are corrected by Holm for the {number} comparisons of this table; those below"
        f" {SIGNIFICANT:.2g} are in bold. Intervals are those of single comparisons."
    )


def _others(study: Study) -> ReportTable:
    """Return the runs that did not complete."""
    table = study.table
    at = [row for rows in study.conditions.values() for row in rows
          if table["outcome"][row] != "completed"]  # fmt: skip
    names = list(dict.fromkeys([*study.names, "seed", "outcome", "reason"]))
    rows = [[str(table[name][row]) for name in names] for row in at[:MAX_OTHERS]]
    more = (
        f"The first {MAX_OTHERS} of {len(at)}; results.csv has all." if len(at) > len(rows) else ""
    )
    return ReportTable("Not completed", more, names, [], rows)


# Forms


def markdown(table: ReportTable) -> str:
    """Return a table as Markdown, without its title."""
    heads = [f"{name} (`{key}`)" if key else name for name, key in table.measures]
    lines = [
        [*table.names, *heads],
        ["---"] * len(table.names) + ["---:"] * len(heads),
        *(
            [f"**{cell}**" if isinstance(cell, Strong) else cell for cell in row]
            for row in table.rows
        ),
    ]
    marked = ["| " + " | ".join(map(_piped, line)) + " |\n" for line in lines]
    return f"{table.note}\n\n" * bool(table.note) + "".join(marked)


def _piped(cell: str) -> str:
    return " ".join(cell.split()).replace("\\", "\\\\").replace("|", "\\|").replace("<", "\\<")


def latex(table: ReportTable) -> str:
    """Return a table as an environment of LaTeX; it needs the package ``booktabs``."""
    keys = [f"\\texttt{{{_tex(key)}}}" if key else "" for _, key in table.measures]
    heads = [*map(_tex, table.names), *(_tex(name) for name, _ in table.measures)]
    lines = [heads, [*[""] * len(table.names), *keys]] if any(keys) else [heads]
    rows = [
        [f"\\textbf{{{_tex(cell)}}}" if isinstance(cell, Strong) else _tex(cell) for cell in row]
        for row in table.rows
    ]
    columns = "l" * len(table.names) + "r" * len(table.measures)
    top, rest = ("".join(f"{' & '.join(line)} \\\\\n" for line in part) for part in (lines, rows))
    return (
        f"\\begin{{table}}\n\\centering\n\\caption{{{_tex(table.title)}. {_tex(table.note)}}}\n"
        f"\\begin{{tabular}}{{{columns}}}\n\\toprule\n{top}\\midrule\n{rest}\\bottomrule\n"
        "\\end{tabular}\n\\end{table}\n"
    )


def _tex(text: str) -> str:
    marked = "".join(LATEX.get(letter, letter) for letter in " ".join(text.split()))
    return re.sub(r"(?<![\w.])-(?=\d)", "$-$", marked)


def html(table: ReportTable) -> str:
    """Return a table as a section of a page."""
    head = "".join(f"<th>{escape(name)}" for name in table.names) + "".join(
        f"<th>{escape(name)}{f'<code>{escape(key)}</code>' * bool(key)}"
        for name, key in table.measures
    )
    rows = "".join(
        "<tr>" + "".join(
            f"<td><b>{escape(cell)}</b>" if isinstance(cell, Strong) else f"<td>{escape(cell)}"
            for cell in row
        )
        for row in table.rows
    )  # fmt: skip
    note = f"<p class=quiet>{escape(table.note)}</p>" if table.note else ""
    numbers = " class=numbers" if table.measures else ""
    kind = " class=long" if len(table.rows) > MAX_UNBROKEN else ""
    return (
        f"<section{kind}><h2>{escape(table.title)}</h2>{note}"
        f"<div class=wide><table{numbers}><thead><tr>{head}<tbody>{rows}</table></div></section>"
    )
