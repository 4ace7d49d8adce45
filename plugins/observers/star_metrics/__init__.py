"""Observer ``metrics``: measures waits, deadlocks, jams, position errors and path lengths."""

from __future__ import annotations

from typing import TYPE_CHECKING

from star_core import hookimpl

if TYPE_CHECKING:
    from star_core import Flight, Operator
    from star_metrics.metrics import FlightMetrics


@hookimpl
def star_mission_started(flight: Flight, operator: Operator) -> FlightMetrics:
    from star_metrics.metrics import FlightMetrics

    return FlightMetrics(flight.scene, operator.report)
