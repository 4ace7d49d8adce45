"""When the watchdog interrupts a call, by a clock that the tests set."""

from __future__ import annotations

import signal
import time

import pytest

from star_core.plugin_support import watchdog
from star_core.plugin_support.compute_time import Stopwatch
from star_core.plugin_support.guard import PluginTimeout
from star_core.plugin_support.watchdog import Watchdog

PERIOD = 0.05  # s


class Watched:
    """A call of a plugin that takes long.

    Args:
        monkeypatch: Replaces the clock and the timers.
        realtime: Whether mission time advances by itself.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, realtime: bool) -> None:
        self.now = 100.0  # s
        self.brakes = 0
        monkeypatch.setattr(watchdog, "monotonic", lambda: self.now)
        monkeypatch.setattr(signal, "setitimer", lambda *_timer: None)
        self.dog = Watchdog(PERIOD, realtime=realtime, brake=self._brake)
        self.dog.armed = True

    def _brake(self) -> None:
        self.brakes += 1

    def begin(self, *, first: bool = False, transport: bool = False) -> None:
        """Begin a call, as a plugin's stopwatch does."""
        self.dog.begun = self.now
        self.dog.call = Stopwatch(time.monotonic, waits=transport, ticks=int(not first))

    def interrupted_after(self, step: float, *, first: bool, transport: bool = False) -> float:
        """Return the time after which a call is interrupted, if the timer expires every `step`."""
        self.begin(first=first, transport=transport)
        begun = self.now
        while True:
            self.now += step
            try:
                self.dog._expire(signal.SIGALRM, None)
            except PluginTimeout:
                return self.now - begun


@pytest.mark.parametrize(("realtime", "step", "usual"), [(True, PERIOD, 1.0), (False, 1.0, 10.0)])
def test_calls_are_interrupted_after_a_limit_longer_at_first(
    monkeypatch: pytest.MonkeyPatch,
    realtime: bool,  # noqa: FBT001 -- a parameter
    step: float,
    usual: float,
) -> None:
    watched = Watched(monkeypatch, realtime=realtime)
    assert usual < watched.interrupted_after(step, first=False) <= usual + 2.1 * step
    assert 60 < watched.interrupted_after(step, first=True) <= 60 + 2.1 * step
    assert usual < watched.interrupted_after(step, first=False) <= usual + 2.1 * step


def test_a_pause_of_the_whole_program_interrupts_no_call(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(monkeypatch, realtime=False)
    watched.begin()
    watched.now += 3600
    watched.dog._expire(signal.SIGALRM, None)
    watched.dog.call = None
    watched.now += 3600
    watched.dog._expire(signal.SIGALRM, None)  # no call is watched


def test_agents_brake_in_real_time_unless_the_transport_hangs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    watched = Watched(monkeypatch, realtime=True)
    watched.interrupted_after(PERIOD, first=False, transport=True)
    assert watched.brakes == 0
    watched.interrupted_after(PERIOD, first=False)
    assert watched.brakes > 10
    simulated = Watched(monkeypatch, realtime=False)
    simulated.interrupted_after(1.0, first=False)
    assert simulated.brakes == 0
