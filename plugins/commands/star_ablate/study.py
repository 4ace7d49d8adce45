"""A study: missions at every combination of levels, and its flights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from star_ablate.basis import digest
from star_ablate.flight import Job, Result
from star_core import Mission
from star_core.formats import SourceFile
from star_core.toolkit import StudyFlight


@dataclass(frozen=True, slots=True)
class Condition:
    """One mission at one level of every factor."""

    file: str  # name of the mission's file, without its suffix
    levels: Mapping[str, str]  # of each factor, by name
    mission: Mission  # without its seed
    basis: Mapping[str, str] = field(default_factory=dict)  # as `Basis.of` returns it
    assignments: tuple[str, ...] = ()  # of its levels, ``path=value`` each

    @property
    def names(self) -> tuple[str, ...]:
        """The file and the level of each factor: unique in a study."""
        return (self.file, *self.levels.values())

    def __str__(self) -> str:
        return ", ".join([self.file, *(f"{name}: {level}" for name, level in self.levels.items())])


@dataclass(frozen=True, slots=True)
class Run:
    """One flight of a study.

    Attributes:
        condition: The condition flown.
        seed: Root seed of its random numbers.
        key: Equal for equal flights: a digest of what they depend on and of the names of the
            levels, and the seed.
    """

    condition: Condition
    seed: int
    key: str

    def __str__(self) -> str:
        return f"{self.condition}, seed {self.seed}"

    def mission(self) -> Mission:
        """The mission to fly."""
        return self.condition.mission.with_seed(self.seed)

    def job(self, folder: Path | None = None) -> Job:
        """Return the run for a worker; `folder` is for its record."""
        return Job(self.mission(), folder, self.condition.assignments, self.condition.basis)

    def flight(self, result: Result) -> StudyFlight:
        """Return the run for the tables."""
        file, levels = self.condition.file, self.condition.levels
        return StudyFlight(
            file, levels, self.seed, result.outcome, result.reason, result.wall_time, result.summary
        )


@dataclass(frozen=True, slots=True)
class Study:
    """Flights and measures of a study.

    Attributes:
        name: Name in records.
        factors: Names of the varied factors.
        conditions: Every combination of missions and levels, the last factor varying fastest.
        seeds: Seeds of each condition; None: each mission's own seed, once.
        measures: Paths into a summary.
        time_limit: Wall time limit of a run, s, or None.
        data: The study as read.
        file: Its file; None in tests.
        undeclared: Measures that no plugin offers, to be checked by the first summary.
    """

    name: str
    factors: tuple[str, ...]
    conditions: tuple[Condition, ...]
    seeds: tuple[int, ...] | None
    measures: tuple[str, ...]
    time_limit: float | None
    data: Mapping[str, Any]
    file: SourceFile | None = None
    undeclared: tuple[str, ...] = ()

    @property
    def each(self) -> int:
        """Number of seeds per condition."""
        return 1 if self.seeds is None else len(self.seeds)

    def runs(self) -> Iterator[Run]:
        """Every flight, in the order of the results: by condition, then by seed."""
        for condition in self.conditions:
            key = digest([condition.file, condition.levels, condition.basis])
            of_mission = (condition.mission.scene.seed,)
            for seed in of_mission if self.seeds is None else self.seeds:
                yield Run(condition, seed, f"{key}-{seed}")
