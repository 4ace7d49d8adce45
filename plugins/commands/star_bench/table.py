"""The table of a campaign: a row for each avoider, scenario, number of agents and noise."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from io import StringIO
from statistics import fmean
from typing import Final, NamedTuple, TypeAlias

from star_bench.metrics import COMPUTED, Metrics

MISSING: Final = "-"  # in a cell
ALL: Final = "all"


class Key(NamedTuple):
    """Properties shared by the flights of one row."""

    avoider: str
    scenario: str
    agents: str
    noise: str


Cell: TypeAlias = float | None

COLUMNS: Final[Mapping[str, tuple[Callable[[list[float]], float], str | None]]] = {
    "runs": (sum, ".0f"),
    "success": (fmean, ".1%"),
    "agent-agent collisions": (sum, ".0f"),
    "agent-obstacle collisions": (sum, ".0f"),
    "deadlocks": (sum, ".0f"),
    "waits": (sum, ".0f"),
    "min separation (m)": (min, ".2f"),
    "min clearance (m)": (min, ".2f"),
    "time ratio": (fmean, ".2f"),
    "path ratio": (fmean, ".2f"),
    "corrected": (sum, ".0f"),
    **{f"{plugin} (us)": (fmean, ".3g" if plugin == "avoider" else None) for plugin in COMPUTED},
}
"""How each column sums up the flights that have the metric, and its number format; columns without
a format are in the CSV only."""

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


def rows(flown: Iterable[tuple[Key, Metrics]]) -> list[tuple[Key, list[Cell]]]:
    """Return a row for each key, in order of appearance, then one for each avoider."""
    groups: dict[Key, list[Metrics]] = {}
    pooled: dict[Key, list[Metrics]] = {}
    for key, metrics in flown:
        groups.setdefault(key, []).append(metrics)
        pooled.setdefault(Key(key.avoider, ALL, ALL, key.noise), []).append(metrics)
    return [(key, [*_cells(of)]) for key, of in [*groups.items(), *pooled.items()]]


def _cells(flights: Sequence[Metrics]) -> Iterator[Cell]:
    for name, (sum_up, _) in COLUMNS.items():
        known = [v for one in flights if (v := one.get(name)) is not None]
        yield sum_up(known) if known else None


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
            yield MISSING if cell is None else format(cell, how)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
