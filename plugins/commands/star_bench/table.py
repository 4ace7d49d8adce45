"""The table of a campaign: a row for each avoider, scenario, number of agents and noise."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from io import StringIO
from statistics import fmean
from typing import Final, NamedTuple, TypeAlias

from star_bench.figures import PARTS, Figures

NOTHING: Final = "-"  # in a cell
ALL: Final = "all"


class Key(NamedTuple):
    """Properties shared by the flights of one row."""

    avoider: str
    scenario: str
    agents: str
    noise: str


Cell: TypeAlias = float | None
Column: TypeAlias = Callable[[Sequence[Figures]], Cell]


def _known(sum_up: Callable[[list[float]], float], get: Callable[[Figures], Cell]) -> Column:
    """Return a column that aggregates the known values of some flights; None if there are none."""

    def column(of: Sequence[Figures]) -> Cell:
        known = [value for one in of if (value := get(one)) is not None]
        return sum_up(known) if known else None

    return column


def _compute(part: str) -> Column:
    return _known(fmean, lambda one: one.compute[part])


COLUMNS: Final[Mapping[str, tuple[Column, str | None]]] = {
    "runs": (len, ".0f"),
    "success": (lambda of: fmean(one.success for one in of), ".1%"),
    "agent-agent collisions": (_known(sum, lambda one: one.agent_agent), ".0f"),
    "agent-obstacle collisions": (_known(sum, lambda one: one.agent_obstacle), ".0f"),
    "deadlocks": (_known(sum, lambda one: one.deadlocks), ".0f"),
    "waits": (_known(sum, lambda one: one.waits), ".0f"),
    "min separation (m)": (_known(min, lambda one: one.separation), ".2f"),
    "min clearance (m)": (_known(min, lambda one: one.clearance), ".2f"),
    "time ratio": (_known(fmean, lambda one: one.time_ratio), ".2f"),
    "path ratio": (_known(fmean, lambda one: one.path_ratio), ".2f"),
    "corrected": (_known(sum, lambda one: one.corrected), ".0f"),
    "avoider (us)": (_compute("avoider"), ".3g"),
    **{f"{part} (us)": (_compute(part), None) for part in PARTS if part != "avoider"},
}
"""Function and number format of each column; columns without a format are in the CSV only."""

LEGEND: Final = """\
Success: all agents arrived and landed without collisions. A wait is an agent with a goal that makes
no progress for 5 s; it is a deadlock if no agent that it waits for makes progress: those ahead of
it within 1.5 m, those ahead of these, and so on. Collisions, deadlocks and waits are sums over
runs, separation and clearance minima over runs, the rest means over the runs that have the figure.
Time ratio: time of the last agent to arrive over its straight flight at the speed limit, of runs in
which all arrived. Path ratio: distance flown by all agents, without climb and descent and including
waiting for the last one, over their straight distances, of runs that completed. Corrected: ticks of
an agent in which the safety filter changed its setpoint; these include ordinary passes in which the
filter braked an agent. Microseconds are per agent and tick. Noise on: the estimate errs by 3 cm
along each axis, correlated over 1 s.
"""


def rows(flown: Iterable[tuple[Key, Figures]]) -> list[tuple[Key, list[Cell]]]:
    """Return a row for each key, in order of appearance, then one for each avoider."""
    groups: dict[Key, list[Figures]] = {}
    pooled: dict[Key, list[Figures]] = {}
    for key, one in flown:
        groups.setdefault(key, []).append(one)
        pooled.setdefault(Key(key.avoider, ALL, ALL, key.noise), []).append(one)
    return [
        (key, [column(of) for column, _ in COLUMNS.values()])
        for key, of in [*groups.items(), *pooled.items()]
    ]


def as_csv(found: Sequence[tuple[Key, Sequence[Cell]]]) -> str:
    """Return the table with full precision; unknown values are empty."""
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*Key._fields, *COLUMNS])
    table.writerows([*key, *cells] for key, cells in found)
    return text.getvalue()


def as_markdown(found: Sequence[tuple[Key, Sequence[Cell]]]) -> str:
    """Return the table as Markdown, with an explanation of its columns."""
    shown = [name for name, (_, how) in COLUMNS.items() if how is not None]
    lines = [
        _line([*Key._fields, *shown]),
        _line(["---"] * len(Key._fields) + ["---:"] * len(shown)),
        *(_line([*key, *_shown(cells)]) for key, cells in found),
    ]
    return "\n".join(lines) + "\n\n" + LEGEND


def _shown(cells: Sequence[Cell]) -> Iterator[str]:
    for (_, how), cell in zip(COLUMNS.values(), cells, strict=True):
        if how is not None:
            yield NOTHING if cell is None else format(cell, how)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
