"""Computing time of plugins, and the slow ones."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic, perf_counter, thread_time
from typing import Any, Final

from star_core.plugin_support.watchdog import Watchdog
from star_core.toolkit.compile_time import compiling

log = logging.getLogger(__name__)

MIN_SLOW_TIME: Final = 1.0  # s, least computing time in one tick that is reported
MIN_SLOW_PERIODS: Final = 20  # periods of a tick, likewise


@dataclass(slots=True)
class Stopwatch:
    """Adds up the time spent in ``with`` blocks; not reentrant.

    Attributes:
        clock: Returns a time, s.
        watchdog: Interrupts blocks that do not end.
        waits: As of `ComputeTime.of`.
        quiet: As of `ComputeTime.of`.
        elapsed: Time spent so far, s.
        total: Likewise, without compilation by numba.
        before: `total` before this tick, s.
        used: Whether there was a block in this tick.
        ticks: Number of earlier ticks with a block.
        slow_ticks: Number of ticks with more than the limit.
        longest: Time spent in the slowest of those, s.
    """

    clock: Callable[[], float]
    watchdog: Watchdog | None = None
    waits: bool = False
    quiet: bool = False
    elapsed: float = 0.0
    total: float = 0.0
    before: float = 0.0
    used: bool = False
    ticks: int = 0
    slow_ticks: int = 0
    longest: float = 0.0
    _begun: float = field(init=False, default=0.0)
    _compiled: float = field(init=False, default=0.0)

    def __enter__(self) -> None:
        self._compiled = compiling.elapsed
        self._begun = self.clock()
        watchdog = self.watchdog
        if watchdog is not None and watchdog.armed:
            watchdog.begun, watchdog.call = monotonic(), self
            if watchdog.realtime:
                watchdog.set_timers()

    def __exit__(self, *_error: object) -> None:
        if self.watchdog is not None:
            self.watchdog.call = None  # the timers go on
        elapsed = self.clock() - self._begun
        self.elapsed += elapsed
        if (compiled := compiling.elapsed - self._compiled) > 0.0:
            elapsed = max(0.0, elapsed - compiled)
        self.total += elapsed
        self.used = True


class ComputeTime:
    """Computing time of every plugin of a flight, in total and tick by tick.

    Args:
        period: From one tick to the next, s.
        realtime: Whether mission time goes on by itself; a plugin that takes too long then makes
            ticks late, which is reported as that.
        brake: Of the `Watchdog`.

    Attributes:
        watchdog: Interrupts plugins that hang.
    """

    def __init__(
        self, period: float, *, realtime: bool, brake: Callable[[], None] = lambda: None
    ) -> None:
        self.watchdog = Watchdog(period, realtime=realtime, brake=brake)
        self._limit = math.inf if realtime else max(MIN_SLOW_TIME, MIN_SLOW_PERIODS * period)
        self._period = period
        self._watches: dict[str, Stopwatch] = {}

    def of(self, plugin: str, *, waits: bool = False, quiet: bool = False) -> Stopwatch:
        """Return the stopwatch of a plugin.

        Args:
            plugin: Its kind, name, distribution and version.
            waits: Whether it may also sleep, as transports do, which is not counted then.
            quiet: Whether its slow ticks are not reported, as of STAR's own display.
        """
        watch = self._watches.get(plugin)
        if watch is None:
            clock = thread_time if waits else perf_counter
            watch = self._watches[plugin] = Stopwatch(clock, self.watchdog, waits, quiet)
        return watch

    def end_tick(self) -> list[str]:
        """End a tick; return a report on every plugin that was slow for the first time.

        The first tick in which a plugin is called does not count: some import or compile in it.
        """
        reports = []
        for plugin, watch in self._watches.items():
            if not watch.used:
                continue
            spent = watch.total - watch.before
            watch.before, watch.used = watch.total, False
            watch.ticks += 1
            if spent <= self._limit or watch.quiet:
                continue
            if watch.ticks == 1:
                log.debug("the first call of %s took %.1f s", plugin, spent)
                continue
            watch.slow_ticks += 1
            watch.longest = max(watch.longest, spent)
            if watch.slow_ticks == 1:
                reports.append(
                    f"{plugin} took {spent:.2f} s for one tick of {self._period:g} s; from now on "
                    "its slow ticks are only counted, for the summary"
                )
        return reports

    def summary(self) -> dict[str, Any]:
        """Return the entries of ``summary.json``."""
        return {
            "compute_s": {name: round(watch.total, 6) for name, watch in self._watches.items()},
            "slow_ticks": {
                name: {"ticks": watch.slow_ticks, "longest_s": round(watch.longest, 3)}
                for name, watch in self._watches.items()
                if watch.slow_ticks
            },
        }
