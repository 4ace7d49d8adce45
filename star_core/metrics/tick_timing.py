"""Reports ticks that come late, with the kind of plugin that took the time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

NAMED: Final = 2
"""Kinds of plugins that are named in a report: those that took the most."""

LEAST: Final = 1e-3
"""The least computing time that is named in a report, s."""

WORDS: Final = {"safety": "safety filter"}

AGAIN: Final = 10.0
"""The least time between two reports, s."""


class TickTiming:
    """How late the ticks come of a flight on a real-time transport; in simulation none does.

    Args:
        period: From one tick to the next, s. A tick that is later than that was left out.
        took: Computing time so far, s, by the kind of plugin; the caller adds to it.
    """

    def __init__(self, period: float, took: Mapping[str, float]) -> None:
        self._period, self._took = period, took
        self._before = dict(took)
        self._last = 0.0  # s, time of the previous tick
        self._reported = -AGAIN  # s, time of the last report
        self._unreported = 0  # late ticks since then
        self._ticks = 0
        self._worst = 0.0

    def note(self, due: float, now: float) -> str:
        """Take in the time at which a tick came and was due, s; return a report or nothing."""
        spent = {kind: self._took[kind] - self._before[kind] for kind in self._took}
        passed, self._last = now - self._last, now
        self._before = dict(self._took)
        late = now - due
        if late <= self._period:
            return ""
        self._ticks += 1
        self._worst = max(self._worst, late)
        if now < self._reported + AGAIN:
            self._unreported += 1
            return ""
        others, self._unreported, self._reported = self._unreported, 0, now
        largest = sorted(spent.items(), key=lambda one: -one[1])[:NAMED]
        named = [f"the {WORDS.get(kind, kind)} took {s:.3f} s" for kind, s in largest if s >= LEAST]
        if (rest := passed - sum(spent.values())) > self._period:
            named.append(f"{rest:.3f} s were spent outside localizer, planner and avoider")
        since = f"; {others} more late ticks since the last report" if others else ""
        return (
            f"the control loop was {late:.3f} s late, {passed:.3f} s after the previous tick: "
            + ", ".join(named)
            + since
        )

    def summary(self) -> dict[str, float]:
        """Return what ``summary.json`` holds of it: how many, and the latest by how much, s."""
        return {"late_ticks": self._ticks, "latest_tick_s": round(self._worst, 6)}
