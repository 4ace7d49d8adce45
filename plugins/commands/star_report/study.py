"""The runs of a study, in groups to be summed up and compared."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

from star_core import read_study

FILE: Final = "results.csv"
OUTCOME: Final = "outcome"  # among measures: whether the run completed
POOLED: Final = "seed and mission"  # pair: of all missions together

Levels: TypeAlias = tuple[str, ...]  # of the names of a study or of its cells
Block: TypeAlias = tuple[str, int]  # mission, if missions are pooled, and seed
Cells: TypeAlias = Mapping[Levels, Mapping[Block, float]]


class Study(NamedTuple):
    """The runs of a study.

    Attributes:
        name: Of the study, or of its folder.
        about: The content of ``study.json``; empty without it.
        names: Columns that tell conditions apart: mission and factors, as far as they vary.
        constant: The level of each column that does not.
        table: As `read_study` returns it.
        conditions: Rows of each condition, in the order of the study.
        measures: Columns with numbers; the first is `OUTCOME`.
        varied: Those of them that are not the same in all runs.
        shares: Those that are true or false, so that their means are shares.
        baseline: Levels with which conditions are compared; empty: the first of each mission.
        pooled: Whether differences are over all missions together.
    """

    name: str
    about: Mapping[str, Any]
    names: tuple[str, ...]
    constant: Mapping[str, str]
    table: Mapping[str, Sequence[Any]]
    conditions: Mapping[Levels, Sequence[int]]
    measures: tuple[str, ...]
    varied: tuple[str, ...]
    shares: frozenset[str]
    baseline: Mapping[str, str]
    pooled: bool

    def levels(self, name: str) -> list[str]:
        """Return the levels of a factor, or the missions, in the order of the study."""
        return list(dict.fromkeys(self.table[name]))

    def value(self, row: int, measure: str) -> float | None:
        """Return a measure of a run, which may be a boolean; None if it has none."""
        value = self.table[measure][row]
        if measure == OUTCOME:
            return bool(value == "completed")
        return value if isinstance(value, int | float) else None

    def values(self, rows: Sequence[int], measure: str) -> list[float]:
        """Return the values of a measure of those runs that have it."""
        values = (self.value(row, measure) for row in rows)
        return [value for value in values if value is not None]

    def cells(self, measure: str) -> tuple[tuple[str, ...], Cells]:
        """Return what is compared: names, and by their levels the values of each block of runs.

        The runs of a block have the same seed and, if missions are pooled, the same mission.
        """
        names = tuple(name for name in self.names if not (self.pooled and name == "mission"))
        cells: dict[Levels, dict[Block, float]] = {}
        for levels, rows in self.conditions.items():
            by_name = dict(zip(self.names, levels, strict=True))
            cell = cells.setdefault(tuple(by_name[name] for name in names), {})
            for row in rows:
                mission = self.table["mission"][row] if self.pooled else ""
                if (value := self.value(row, measure)) is not None:
                    cell[mission, self.table["seed"][row]] = value
        return names, cells

    def baseline_of(self, levels: Levels, names: Sequence[str], cells: Cells) -> Levels | None:
        """Return the cell with which another one is compared; None if it is one itself."""
        if self.baseline:
            base = tuple(
                self.baseline.get(name, level) for name, level in zip(names, levels, strict=True)
            )
        elif "mission" in names:
            at = names.index("mission")
            base = next(other for other in cells if other[at] == levels[at])
        else:
            base = next(iter(cells))
        return base if base != levels and base in cells else None


def read(folder: Path) -> Study:
    """Return the study of a folder.

    Raises:
        InputError: Its table is not that of a study.
    """
    table = read_study(folder)
    about = _about(folder)
    study = about.get("study")
    study = study if isinstance(study, dict) else {}
    columns = list(table)
    factors = columns[: columns.index("seed")]
    names = [name for name in factors if len(set(table[name])) > 1] or ["mission"]
    conditions: dict[Levels, list[int]] = {}
    for row, levels in enumerate(zip(*(table[name] for name in names), strict=True)):
        conditions.setdefault(levels, []).append(row)
    measures = columns[columns.index("reason") + 1 :]
    baseline = study.get("baseline")
    study_of = Study(
        name=str(study.get("name") or folder.resolve().name),
        about=about,
        names=tuple(names),
        constant={name: table[name][0] for name in factors if name not in names and table[name]},
        table=table,
        conditions=conditions,
        measures=(OUTCOME, *(name for name in measures if _is_number(table[name]))),
        varied=(),
        shares=frozenset(),
        baseline={str(k): str(v) for k, v in baseline.items()}
        if isinstance(baseline, dict)
        else {},
        pooled=study.get("pair", POOLED if study.get("seeds") == "own" else "") == POOLED,
    )
    runs = range(len(table["seed"]))
    values = {measure: study_of.values(runs, measure) for measure in study_of.measures}
    return study_of._replace(
        varied=tuple(measure for measure, of in values.items() if len(set(of)) > 1),
        shares=frozenset(m for m, of in values.items() if all(isinstance(v, bool) for v in of)),
    )


def _is_number(column: Sequence[Any]) -> bool:
    return any(isinstance(value, int | float) for value in column)


def _about(folder: Path) -> dict[str, Any]:
    """Return the content of ``study.json``; empty if it is missing or is another file."""
    try:
        about = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return about if isinstance(about, dict) else {}
