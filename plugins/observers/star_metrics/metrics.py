"""Metrics of one flight."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from star_core import Scene, Tick, hookimpl
from star_metrics.deadlocks import Deadlocks
from star_metrics.jams import Jams
from star_metrics.path_lengths import PathLengths
from star_metrics.position_errors import PositionErrors


class FlightMetrics:
    """Observer of one flight, which contributes its measures to the summary."""

    def __init__(self, scene: Scene, report: Callable[..., None]) -> None:
        self._report = report
        self._deadlocks = Deadlocks(len(scene.agents))
        self._jams = Jams(scene)
        self._errors = PositionErrors(scene.names)
        self._paths = PathLengths(scene.names)

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self._deadlocks.add(tick)
        if jam := self._jams.add(tick):
            text, details = jam
            self._report("jam", text, details=details)
        self._errors.add(tick)
        self._paths.add(tick)

    @hookimpl
    def star_summary(self) -> dict[str, Any]:
        return {
            "deadlocks": self._deadlocks.count,
            "waits": self._deadlocks.waits,
            "jams": self._jams.count,
            **self._errors.summary(),
            "path_length_m": self._paths.summary(),
        }
