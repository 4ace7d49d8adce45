"""Metrics of flights, and the table of a campaign with one row for each kind of flight."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from io import StringIO
from statistics import fmean
from typing import Any, Final, NamedTuple, TypeAlias

from star_bench.scenario import Scenario
from star_core.toolkit import ReportTable, StudyFlight

MISSING: Final = "-"  # in a cell
ALL: Final = "all"


class Key(NamedTuple):
    """Properties shared by the flights of one row."""

    avoider: str
    scenario: str
    agents: str
    world: str
    positions: str


Cell: TypeAlias = float | None

COMPUTED: Final = ("avoider", "localizer", "planner", "safety")  # of which the time is given
COUNTS: Final = {
    "agent-agent collisions": "collisions.agent_agent",
    "agent-obstacle collisions": "collisions.agent_obstacle",
    "deadlocks": "deadlocks",
    "waits": "waits",
    "min separation (m)": "min_separation_m",
    "min clearance (m)": "min_clearance_m",
}
"""Measures of a study, by the column of the table."""

Metrics: TypeAlias = Mapping[str, float | None]
"""Metrics of one flight, by the column of the table; None if unknown."""

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
filter braked an agent. Microseconds are per agent and tick. Bounded positions: those of a
positioning system that errs by 3 cm along each axis, correlated over 1 s.
"""


def metrics(flight: StudyFlight, scenario: Scenario, speed: float) -> Metrics:
    """Return the metrics of a flight.

    Args:
        flight: Of the scenario's mission.
        scenario: The scenario flown.
        speed: The mission's speed limit, m/s.
    """
    completed = flight.outcome == "completed"
    counts = {name: flight.value(measure) for name, measure in COUNTS.items()}
    hits = counts["agent-agent collisions"], counts["agent-obstacle collisions"]
    corrected, compute = flight.value("corrected"), flight.value("compute_us") or {}
    lengths = flight.value("path_length_m.per_agent") or {}
    return counts | {
        "runs": 1,
        "success": float(completed and hits == (0, 0)),
        "time ratio": time_ratio(flight.value("steps") or [], scenario, speed),
        "path ratio": path_ratio(lengths, scenario) if completed else None,
        "corrected": sum(corrected.values()) if corrected else None,
        **{f"{plugin} (us)": compute.get(plugin) for plugin in COMPUTED},
    }


def time_ratio(
    steps: Sequence[Mapping[str, Any]], scenario: Scenario, speed: float
) -> float | None:
    """Return the time of the last agent to arrive over its straight flight, summed over all legs.

    Args:
        steps: Steps of a summary, with agents and times.
        scenario: Straight distances, in the order of each agent's steps.
        speed: m/s.

    Returns:
        The ratio; None if an agent did not arrive.
    """
    flights: dict[str, list[float]] = {f"d{i + 1}": [] for i in range(len(scenario.starts))}
    for step in steps:
        if step["verb"] == "goto" and step["outcome"] == "success":
            for name in step["agents"]:
                flights[name].append(step["ended_s"] - step["begun_s"])
    if any(len(times) != len(scenario.legs) for times in flights.values()):
        return None
    took = least = 0.0
    for leg, distances in enumerate(scenario.straight()):
        times = [flight[leg] for flight in flights.values()]
        last = times.index(max(times))
        took += times[last]
        least += distances[last] / speed
    return took / least if least > 0 else None


def path_ratio(flown: Mapping[str, float], scenario: Scenario) -> float | None:
    """Return the distance flown by all agents over their straight distances.

    Args:
        flown: Distance of each agent from take-off to landing, m. The vertical climb and descent
            are subtracted.
        scenario: The scenario flown.
    """
    straight = sum(map(sum, scenario.straight()))
    vertical = sum(scenario.heights) + sum(z for _, _, z in scenario.legs[-1])
    if len(flown) != len(scenario.starts) or straight == 0:
        return None
    return (sum(flown.values()) - vertical) / straight


def rows(flown: Iterable[tuple[Key, Metrics]]) -> list[tuple[Key, list[Cell]]]:
    """Return a row for each key, in order of appearance, then one for each avoider."""
    groups: dict[Key, list[Metrics]] = {}
    pooled: dict[Key, list[Metrics]] = {}
    for key, metrics in flown:
        groups.setdefault(key, []).append(metrics)
        pooled.setdefault(Key(key.avoider, ALL, ALL, key.world, key.positions), []).append(metrics)
    return [(key, [*_cells(of)]) for key, of in [*groups.items(), *pooled.items()]]


def _cells(flights: Sequence[Metrics]) -> Iterator[Cell]:
    for name, (sum_up, _) in COLUMNS.items():
        values = [v for flight in flights if (v := flight.get(name)) is not None]
        yield sum_up(values) if values else None


def as_csv(groups: Sequence[tuple[Key, Sequence[Cell]]]) -> str:
    """Return the table with full precision; unknown values are empty."""
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*Key._fields, *COLUMNS])
    table.writerows([*key, *cells] for key, cells in groups)
    return text.getvalue()


def as_markdown(groups: Sequence[tuple[Key, Sequence[Cell]]]) -> str:
    """Return the table as Markdown, with an explanation of its columns."""
    shown = [name for name, (_, how) in COLUMNS.items() if how is not None]
    lines = [
        _line([*Key._fields, *shown]),
        _line(["---"] * len(Key._fields) + ["---:"] * len(shown)),
        *(_line([*key, *_shown(cells)]) for key, cells in groups),
    ]
    return "\n".join(lines) + "\n\n" + LEGEND


def as_table(groups: Sequence[tuple[Key, Sequence[Cell]]]) -> ReportTable:
    """Return the table for a terminal."""
    shown = [(name, "") for name, (_, how) in COLUMNS.items() if how is not None]
    return ReportTable(
        "", "", Key._fields, shown, [[*key, *_shown(cells)] for key, cells in groups]
    )


def _shown(cells: Sequence[Cell]) -> Iterator[str]:
    for (_, how), cell in zip(COLUMNS.values(), cells, strict=True):
        if how is not None:
            yield MISSING if cell is None else format(cell, how)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
