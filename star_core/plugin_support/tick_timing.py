"""Ticks that come late: by how much, and why."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter, thread_time
from typing import Final

MIN_STALL: Final = 0.25  # s, least lateness of a tick that is reported as a stall
MAX_STALL: Final = 1.0  # s, most that is taken for one
REPORTED_KINDS: Final = 2  # kinds of plugins named in the report of a late tick
MIN_REPORTED_TIME: Final = 1e-3  # s, least computing time named in it
REPORT_INTERVAL: Final = 10.0  # s, least time between two reports of late ticks
LABELS: Final = {"safety": "safety filter"}


class TickTiming:
    """Lateness and computing time of ticks; in simulation no tick is late.

    Args:
        period: From one tick to the next, s. A tick that is later than that was missed.

    Attributes:
        stall: By how much this tick was late because its process did not run, s; 0 if it was not.
            What agents have sent meanwhile may not be received yet.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self.stall = 0.0
        self._ran = thread_time()  # s of processor time, at the previous tick
        self._took: Mapping[str, float] = {}  # s, before the previous tick
        self._last = 0.0  # s, time of the previous tick
        self._late = 0.0  # s, of this tick
        self._began = perf_counter()  # s, of this tick
        self._reported = -REPORT_INTERVAL  # s, time of the last report
        self._unreported = 0  # late ticks since then
        self._ticks = 0
        self._latest = 0.0

    def note(self, due: float, now: float, took: Mapping[str, float]) -> str:
        """Count a tick if it is late; return a report, or an empty string.

        Args:
            due: Time at which the tick was due, s.
            now: Time at which it came, s.
            took: Computing time so far, s, by the kind of plugin.
        """
        spent = {kind: took[kind] - self._took.get(kind, 0.0) for kind in took}
        passed, self._last, self._took = now - self._last, now, took
        self._began = perf_counter()
        late = self._late = now - due
        ran, self._ran = thread_time() - self._ran, thread_time()
        idle = min(late, passed - sum(spent.values())) - ran
        self.stall = min(idle, MAX_STALL) if idle >= MIN_STALL else 0.0
        if late <= self._period:
            return ""
        self._ticks += 1
        self._latest = max(self._latest, late)
        if self.stall:
            return f"the computer stalled for {idle:.2f} s: the control loop did not run"
        if now < self._reported + REPORT_INTERVAL:
            self._unreported += 1
            return ""
        others, self._unreported, self._reported = self._unreported, 0, now
        largest = sorted(spent.items(), key=lambda item: -item[1])[:REPORTED_KINDS]
        causes = [
            f"the {LABELS.get(kind, kind)} took {seconds:.3f} s"
            for kind, seconds in largest
            if seconds >= MIN_REPORTED_TIME
        ]
        if (rest := passed - sum(spent.values())) > self._period:
            causes.append(f"{rest:.3f} s were spent outside localizer, planner and avoider")
        since = f"; {others} more late ticks since the last report" if others else ""
        return (
            f"the control loop was {late:.3f} s late, {passed:.3f} s after the previous tick: "
            + ", ".join(causes)
            + since
        )

    def of_tick(self, took: Mapping[str, float]) -> dict[str, float]:
        """Return the timing of this tick so far, s, as in `Tick.timing`.

        Args:
            took: Computing time so far, s, by the kind of plugin.
        """
        spent = {kind: took[kind] - self._took.get(kind, 0.0) for kind in took}
        return {"late": max(0.0, self._late), "tick": perf_counter() - self._began, **spent}

    def summary(self) -> dict[str, float]:
        """Return the entries of ``summary.json``: number of late ticks, greatest lateness, s."""
        return {"late_ticks": self._ticks, "latest_tick_s": round(self._latest, 6)}
