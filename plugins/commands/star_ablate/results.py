"""Results of a study: those of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from star_ablate.flight import Result
from star_ablate.study import Run
from star_core.toolkit import StudyFlight, StudyResults

Results: TypeAlias = Sequence[tuple[Run, Result]]


def study_results(results: Results, *, interrupted: bool) -> StudyResults:
    """Return the results of a study, in the order of `results`."""
    flights = (
        StudyFlight(
            run.condition.file,
            run.condition.levels,
            run.seed,
            result.outcome,
            result.reason,
            result.wall_time,
            result.summary,
        )
        for run, result in results
    )
    return StudyResults(tuple(flights), interrupted)
