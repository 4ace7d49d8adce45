"""Times of plugins: how long they compute, calls that hang, and ticks that come late."""

from __future__ import annotations

import bdb
import faulthandler
import logging
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic, perf_counter, thread_time
from types import FrameType
from typing import Any, Final, Self

from star_core.plugin_support.guard import PluginTimeout
from star_core.toolkit.compile_time import compiling

log = logging.getLogger(__name__)

MAX_CALL_TIME: Final = 10.0  # s, of one call in simulation
MAX_REALTIME_CALL_TIME: Final = 1.0  # s, of one call where mission time advances by itself
MAX_FIRST_CALL_TIME: Final = 60.0  # s, of the first call of a plugin: it may import and compile
MAX_NATIVE_TIME: Final = 60.0  # s of processor time, for each processor, without a line of Python

MIN_SLOW_TIME: Final = 1.0  # s, least computing time in one tick that is reported
MIN_SLOW_PERIODS: Final = 20  # periods of a tick, likewise

MIN_STALL: Final = 0.25  # s, least lateness of a tick that is reported as a stall
MAX_STALL: Final = 1.0  # s, most that is taken for one
REPORTED_KINDS: Final = 2  # kinds of plugins named in the report of a late tick
MIN_REPORTED_TIME: Final = 1e-3  # s, least computing time named in it
REPORT_INTERVAL: Final = 10.0  # s, least time between two reports of late ticks
LABELS: Final = {"safety": "safety filter"}


class Watchdog:
    """Interrupts a call of a plugin that does not return, if the flight has the main thread.

    SIGALRM raises `PluginTimeout` in Python code and in calls that wait, such as for a lock or a
    socket. Native code is interrupted when it returns. If it never returns, SIGVTALRM writes
    the stack of the process, with the plugin's file and line, to stderr and ends the process. A
    debugger may stop as long as it likes.

    Args:
        period: From one tick to the next, s.
        realtime: Whether mission time advances by itself.
        brake: In real time it is called from the third period of a call on, once per period.

    Attributes:
        armed: Whether it has the main thread, so that calls can be interrupted.
        calling: Whether a call is being watched.
    """

    def __init__(self, period: float, *, realtime: bool, brake: Callable[[], None]) -> None:
        self._limit = MAX_REALTIME_CALL_TIME if realtime else MAX_CALL_TIME
        # in real time it is set for each call, otherwise it goes on: a call costs nothing
        self._timer = (2 * period, period) if realtime else (self._limit / 10, self._limit / 10)
        self._brake = brake if realtime else None
        self._native_time = MAX_NATIVE_TIME * (os.cpu_count() or 1)
        self.armed = self.calling = False
        self._transport = self._first = False
        self._begun = 0.0
        self._late = 0  # times that the timer expired beyond the limit, in this call

    def __enter__(self) -> Self:
        main = threading.current_thread() is threading.main_thread()
        if main and signal.getsignal(signal.SIGALRM) is signal.SIG_DFL:
            self.armed = True
            signal.signal(signal.SIGALRM, self._expire)
            with suppress(AttributeError, OSError, ValueError):  # there may be no stderr
                faulthandler.register(signal.SIGVTALRM, sys.__stderr__, chain=True)  # type: ignore[arg-type]
            self._set_timers()
        return self

    def __exit__(self, *_error: object) -> None:
        if self.armed:
            self.armed = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            faulthandler.unregister(signal.SIGVTALRM)

    def begin(self, *, first: bool, transport: bool) -> None:
        """Begin to watch a call.

        Args:
            first: Whether it is the plugin's first, which may take longer.
            transport: Whether the transport is called; it can then not brake.
        """
        self._first, self._transport, self._late = first, transport, 0
        self._begun, self.calling = monotonic(), True
        if self._brake is not None:
            self._set_timers()

    def _set_timers(self) -> None:
        signal.setitimer(signal.ITIMER_REAL, *self._timer)
        signal.setitimer(signal.ITIMER_VIRTUAL, self._native_time)

    def _expire(self, _number: int, _frame: FrameType | None) -> None:
        signal.setitimer(signal.ITIMER_VIRTUAL, self._native_time)
        if not self.calling:
            return
        if self._brake is not None and not self._transport:
            self._brake()
        took = monotonic() - self._begun
        limit = max(self._limit, MAX_FIRST_CALL_TIME) if self._first else self._limit
        self._late += took > limit
        if self._late > 1 and not _debugged():  # once is also after Ctrl-Z and `fg`
            raise PluginTimeout(f"no result after {took:.2g} s")


def _debugged() -> bool:
    """Return whether a debugger is in use."""
    tracer = getattr(sys.gettrace(), "__self__", None)
    return isinstance(tracer, bdb.Bdb) or "pydevd" in sys.modules


@dataclass(slots=True)
class Stopwatch:
    """Adds up the time spent in ``with`` blocks; not reentrant.

    Attributes:
        clock: Returns a time, s.
        watchdog: Interrupts blocks that do not end.
        waits: As of `ComputeTime.of`.
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
        if self.watchdog is not None and self.watchdog.armed:
            self.watchdog.begin(first=not self.ticks, transport=self.waits)

    def __exit__(self, *_error: object) -> None:
        if self.watchdog is not None:
            self.watchdog.calling = False  # the timers go on
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

    def of(self, plugin: str, *, waits: bool = False) -> Stopwatch:
        """Return the stopwatch of a plugin.

        Args:
            plugin: Its kind, name, distribution and version.
            waits: Whether it may also sleep, as transports do, which is not counted then.
        """
        watch = self._watches.get(plugin)
        if watch is None:
            clock = thread_time if waits else perf_counter
            watch = self._watches[plugin] = Stopwatch(clock, self.watchdog, waits)
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
            if spent <= self._limit:
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
        largest = sorted(spent.items(), key=lambda one: -one[1])[:REPORTED_KINDS]
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
