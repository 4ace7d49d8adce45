"""Results of a study: its flights with their summaries, and a table of them."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any, Final

from star_core.errors import InputError

MAX_NUMBER: Final = 1e12  # of a summary
MAX_MEASURE: Final = 1e100  # of a table, whose variance is finite
STUDY_COLUMNS: Final = ("mission", "seed", "outcome", "reason")
"""Columns of every ``results.csv``; factors cannot have these names."""
SUMMARY_MEASURES: Final = (
    *("outcome", "reason", "mission", "seed", "agents", "flight_time_s", "wall_time_s"),
    *("realtime_factor", "compute_us.*", "compute_s.*", "collisions.agent_agent"),
    *("collisions.agent_obstacle", "distances_from", "corrected.fence", "corrected.speed"),
    *("corrected.separation", "corrected.obstacle", "min_separation_m", "min_clearance_m"),
    *("late_ticks", "latest_tick_s", "slow_ticks.*", "targets.found", "targets.total"),
    *("targets.list", "steps", "events"),
)
"""Paths in every summary, keys joined by dots, as `star_measures` offers those of a plugin."""
AFTER_LEVELS: Final = ("seed", "outcome", "reason")
VALUE: Final = (*"-0123456789", "true", "false")  # what a number or a boolean begins with
FORMULA: Final = ("=", "+", "-", "@")  # what a formula of a spreadsheet begins with


@dataclass(frozen=True, slots=True)
class StudyFlight:
    """One flight of a study.

    Attributes:
        mission: Name of the mission's file, without its suffix.
        levels: Level of each factor, by name.
        seed: Root seed of its random numbers.
        outcome: ``completed``, ``failed`` or ``aborted``; ``failed`` also if it raised, and
            ``crashed`` if its process ended.
        reason: Why it did not complete.
        wall_time: s.
        summary: The study's measures in ``summary.json``; None if it raised or crashed.
    """

    mission: str
    levels: Mapping[str, str]
    seed: int
    outcome: str
    reason: str
    wall_time: float
    summary: Mapping[str, Any] | None

    def value(self, measure: str) -> Any:
        """Return a value of the summary by its path, keys joined by dots; None if there is none."""
        return value_at(self.summary, measure)


@dataclass(frozen=True, slots=True)
class StudyResults:
    """Results of a study.

    Attributes:
        flights: Those that were flown, in the order of the study: by mission, levels and seed.
        interrupted: Whether flights are missing, because the operator interrupted it.
    """

    flights: tuple[StudyFlight, ...]
    interrupted: bool = False

    def as_csv(self, factors: Sequence[str], measures: Sequence[str]) -> str:
        """Return a table with a header and a row for each flight: equal for equal studies.

        Numbers have full precision. A measure that a flight does not have is empty; one that is a
        column already is left out. Texts are such that no spreadsheet takes them for formulas.

        Args:
            factors: Names of the factors.
            measures: Paths into a summary.
        """
        text = StringIO()
        table = csv.writer(text, lineterminator="\n")
        measures = [measure for measure in measures if measure not in STUDY_COLUMNS]
        table.writerow(["mission", *factors, "seed", "outcome", "reason", *measures])
        for flight in self.flights:
            texts = (_inert(flight.outcome), _inert(flight.reason))
            values = (_cell(flight.value(measure)) for measure in measures)
            table.writerow([*_names(flight, factors), flight.seed, *texts, *values])
        return text.getvalue()

    def timings(self, factors: Sequence[str]) -> str:
        """Return a table with the wall time of each flight, s, in the order of `as_csv`."""
        text = StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(["mission", *factors, "seed", "wall_time_s"])
        for flight in self.flights:
            table.writerow([*_names(flight, factors), flight.seed, f"{flight.wall_time:.3f}"])
        return text.getvalue()


def _names(flight: StudyFlight, factors: Sequence[str]) -> list[str]:
    return [_inert(name) for name in (flight.mission, *(flight.levels[f] for f in factors))]


def read_study(folder: str | Path) -> dict[str, list[Any]]:
    """Return the runs of a study as a table with a row for each: its columns by name, in order.

    They are mission, the level of each factor, seed, outcome, reason and the measures. A measure
    that a run does not have is None; one that is a list or a map is its text as JSON.
    ``pandas.DataFrame(read_study(folder))`` is a tidy table.

    Raises:
        InputError: The folder has no ``results.csv``, or one that is no table of a study.
    """
    path = Path(folder, "results.csv")
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {error}", "no-record") from error
    columns = rows.pop(0) if rows else []
    measures = columns.index("seed") + 3 if "seed" in columns else 0
    fits = columns[:1] == ["mission"] and columns[measures - 3 : measures] == list(AFTER_LEVELS)
    if not fits or any(len(row) != len(set(columns)) for row in [columns, *rows]):
        raise InputError(f"{path}: expected the table of a study", "no-record")
    table: dict[str, list[Any]] = {name: [row[i] for row in rows] for i, name in enumerate(columns)}
    for name in ["seed", *columns[measures:]]:
        table[name] = [_value(cell) for cell in table[name]]
    return table


def value_at(summary: Mapping[str, Any] | None, path: str) -> Any:
    """Return the value at `path`, keys joined by dots; None if there is none.

    >>> value_at({"targets": {"found": 2}}, "targets.found")
    2
    """
    value: Any = summary
    for key in path.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def number_at(summary: Mapping[str, Any] | None, path: str) -> float | None:
    """Return the number at `path`, as `value_at` does; None if there is none.

    >>> number_at({"collisions": {"agent_agent": 7}}, "collisions.agent_agent")
    7.0
    """
    value = value_at(summary, path)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and abs(value) <= MAX_NUMBER else None


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    if isinstance(value, str):
        return _inert(value)
    return json.dumps(value) if isinstance(value, Mapping | list | bool) else value


def _value(cell: str) -> Any:
    """Return the value of a cell: a number, a boolean or a text, and None if it is empty.

    >>> [_value(cell) for cell in ("", "3", "5e-1", "true", "[1]", "1e999")]
    [None, 3, 0.5, True, '[1]', '1e999']
    """
    if not cell.startswith(VALUE):
        return cell or None
    try:
        value = json.loads(cell)
    except ValueError:
        return cell
    return value if abs(value) <= MAX_MEASURE else cell


def _inert(text: str) -> str:
    """Return a text as a cell of one line that no spreadsheet takes for a formula.

    >>> _inert("=1+1"), _inert("-0.5"), _inert("orca")
    ("'=1+1", '-0.5', 'orca')
    """
    text = " ".join(text.split())
    if not text.startswith(FORMULA):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text
