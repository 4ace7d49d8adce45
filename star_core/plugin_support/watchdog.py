"""Interrupts calls of plugins that hang."""

from __future__ import annotations

import bdb
import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from time import monotonic
from types import FrameType
from typing import TYPE_CHECKING, Final, Self

from star_core.plugin_support.guard import PluginTimeout

if TYPE_CHECKING:
    from star_core.plugin_support.compute_time import Stopwatch

MAX_CALL_TIME: Final = 10.0  # s, of one call in simulation
MAX_REALTIME_CALL_TIME: Final = 1.0  # s, of one call where mission time advances by itself
MAX_FIRST_CALL_TIME: Final = 60.0  # s, of the first call of a plugin: it may import and compile
MAX_NATIVE_TIME: Final = 60.0  # s of processor time, for each processor, without a line of Python


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
        realtime: Whether `set_timers` is to be called at the beginning of each call.
        begun: When the present call began, s of `time.monotonic`.
        call: The call that is watched; None between calls.
    """

    def __init__(self, period: float, *, realtime: bool, brake: Callable[[], None]) -> None:
        self._limit = MAX_REALTIME_CALL_TIME if realtime else MAX_CALL_TIME
        # in real time it is set for each call, otherwise it goes on: a call costs nothing
        self._timer = (2 * period, period) if realtime else (self._limit / 10, self._limit / 10)
        self._brake = brake
        self._native_time = MAX_NATIVE_TIME * (os.cpu_count() or 1)
        self.armed = False
        self.realtime = realtime
        self.begun = self._seen = 0.0
        self.call: Stopwatch | None = None
        self._late = 0  # expiries beyond the limit, in the call that began at `_seen`

    def __enter__(self) -> Self:
        main = threading.current_thread() is threading.main_thread()
        if main and signal.getsignal(signal.SIGALRM) is signal.SIG_DFL:
            self.armed = True
            signal.signal(signal.SIGALRM, self._expire)
            with suppress(AttributeError, OSError, ValueError):  # there may be no stderr
                faulthandler.register(signal.SIGVTALRM, sys.__stderr__, chain=True)  # type: ignore[arg-type]
            self.set_timers()
        return self

    def __exit__(self, *_error: object) -> None:
        if self.armed:
            self.armed = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            faulthandler.unregister(signal.SIGVTALRM)

    def set_timers(self) -> None:
        """Begin to wait for the present call to take too long."""
        signal.setitimer(signal.ITIMER_REAL, *self._timer)
        signal.setitimer(signal.ITIMER_VIRTUAL, self._native_time)

    def _expire(self, _number: int, _frame: FrameType | None) -> None:
        signal.setitimer(signal.ITIMER_VIRTUAL, self._native_time)
        call = self.call
        if call is None:
            return
        if self.realtime and not call.waits:  # the transport could not brake
            self._brake()
        if self.begun != self._seen:
            self._seen, self._late = self.begun, 0
        took = monotonic() - self.begun
        limit = self._limit if call.ticks else max(self._limit, MAX_FIRST_CALL_TIME)
        self._late += took > limit
        if self._late > 1 and not _debugged():  # once is also after Ctrl-Z and `fg`
            raise PluginTimeout(f"no result after {took:.2g} s")


def _debugged() -> bool:
    """Return whether a debugger is in use."""
    tracer = getattr(sys.gettrace(), "__self__", None)
    return isinstance(tracer, bdb.Bdb) or "pydevd" in sys.modules
