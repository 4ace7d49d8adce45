"""Observer ``metrics``: measures waits, deadlocks, jams, position errors and path lengths."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from star_core import hookimpl

if TYPE_CHECKING:
    from star_core import Flight, Operator
    from star_metrics.metrics import FlightMetrics


@hookimpl
def star_measures() -> Iterator[str]:
    yield from ("deadlocks", "waits", "jams")
    yield from ("position_mse_m2.mean", "position_mse_m2.std", "position_mse_m2.per_agent.*")
    yield from ("position_rmse_m", "position_worst_m", "position_nees")
    yield from ("path_length_m.total", "path_length_m.per_agent.*")


@hookimpl
def star_mission_started(flight: Flight, operator: Operator) -> FlightMetrics:
    from star_metrics.metrics import FlightMetrics

    return FlightMetrics(flight.scene, operator.report)
