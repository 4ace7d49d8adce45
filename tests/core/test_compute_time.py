"""Plugins that take too long for a tick of a simulation are reported once, and counted."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import pytest

import star_yaml
from star_core import Tick, hookimpl
from star_core.discovery import Source
from star_core.plugin_support.compute_time import ComputeTime
from star_core.plugin_support.registry import Registry
from star_core.toolkit import compiled
from star_core.toolkit.compile_time import compiling
from tests.core.conftest import Lab

NAMED = {
    "localizer": "localizer 'seer' (their-dist 1.2:lab)",
    "planner": "planner 'dash' (their-dist 1.2:lab)",
    "avoider": "avoider 'idle' (their-dist 1.2:lab)",
    "wait": "task 'wait' (their-dist 1.2:lab)",
}
METHODS = {"localizer": "locate", "planner": "plan", "avoider": "avoid", "wait": "step"}
LIMIT = 2.0  # s: 20 periods of the laboratory's missions


class Clock:
    """Stands still unless it is moved."""

    def __init__(self) -> None:
        self.time = 0.0

    def __call__(self) -> float:
        return self.time

    def wasting(self, seconds: float) -> Callable[..., Any]:
        """Return what makes a method of a plugin take so long."""

        def method(right: Callable[..., Any], *arguments: Any) -> Any:
            self.time += seconds
            return right(*arguments)

        return method


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("star_core.plugin_support.compute_time.perf_counter", clock)
    return clock


@pytest.mark.parametrize("role", NAMED)
def test_slow_plugins_are_reported_once_and_slow_ticks_counted(
    lab: Lab, clock: Clock, caplog: pytest.LogCaptureFixture, role: str
) -> None:
    lab.spoil(role, METHODS[role], clock.wasting(2.5), range(5, 9))
    summary = lab.fly()
    report = (
        f"{NAMED[role]} took 2.50 s for one tick of 0.1 s; from now on its slow ticks are only "
        "counted, for the summary"
    )
    assert lab.said("slow") == [report]
    assert [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING] == [report]
    assert summary["slow_ticks"] == {NAMED[role]: {"ticks": 4, "longest_s": 2.5}}
    assert summary["compute_s"][NAMED[role]] == pytest.approx(10.0)
    assert summary["outcome"] == "completed"


def test_a_slow_observer_is_reported(lab: Lab, clock: Clock) -> None:
    class Slow:
        @hookimpl
        def star_ticked(self, tick: Tick) -> None:
            clock.time += 3.0 * (tick.time > 1.0)

    lab.registry.add(Slow(), Source("their-dist:slow", "1.2"))
    summary = lab.fly()
    (report,) = lab.said("slow")
    assert report.startswith("observer their-dist:slow took 3.00 s for one tick")
    assert summary["slow_ticks"]["observer their-dist:slow"]["ticks"] > 1


def test_own_observers_and_preparations_are_never_slow(lab: Lab, clock: Clock) -> None:
    class Slow:
        @hookimpl
        def star_mission_started(self) -> None:
            clock.time += 9.0

        @hookimpl
        def star_ticked(self, tick: Tick) -> None:
            clock.time += own * (tick.time > 1.0)

    for name, own in (("star-swarm:slow", 3.0), ("their-dist:slow", 0.0)):
        lab.registry = Registry(star_yaml, lab, installed=False)
        lab.registry.add(Slow(), Source(name))
        summary = lab.fly()
        assert (lab.said("slow"), summary["slow_ticks"]) == ([], {})
        assert (summary["compute_s"][f"observer {name}"] == pytest.approx(0.0)) is (own == 0.0)


def test_plugins_within_the_time_limit_are_not_reported(lab: Lab, clock: Clock) -> None:
    lab.spoil("planner", "plan", clock.wasting(LIMIT))
    summary = lab.fly()
    assert (lab.said("slow"), summary["slow_ticks"]) == ([], {})


def test_the_first_call_of_a_plugin_may_take_long(
    lab: Lab, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "star_core.plugin_support.compute_time")
    for role, method in METHODS.items():
        lab.spoil(role, method, clock.wasting(9.0), range(1))
    summary = lab.fly()
    assert (lab.said("slow"), summary["slow_ticks"]) == ([], {})
    assert f"the first call of {NAMED['avoider']} took 9.0 s" in caplog.messages


def test_compilation_does_not_count(
    lab: Lab, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Compiling:
        elapsed = property(lambda _self: 0.99 * clock.time)

    monkeypatch.setattr("star_core.plugin_support.compute_time.compiling", Compiling())
    lab.spoil("planner", "plan", clock.wasting(100.0), range(5, 6))
    summary = lab.fly()
    assert (lab.said("slow"), summary["slow_ticks"]) == ([], {})
    assert summary["compute_s"][NAMED["planner"]] == pytest.approx(1.0)


def test_the_time_that_numba_compiles_is_known() -> None:
    before = compiling.elapsed
    kernel = compiled(_thrice)
    assert compiling.elapsed == before
    kernel(1.0)
    first = compiling.elapsed
    assert first > before
    kernel(2.0)
    assert compiling.elapsed == first


def _thrice(x: float) -> float:
    return 3.0 * x


def test_slow_ticks_are_not_counted_in_real_time(lab: Lab, clock: Clock) -> None:
    lab.realtime = True
    lab.registry = Registry(star_yaml, lab, installed=False)
    lab.spoil("planner", "plan", clock.wasting(9.0))
    summary = lab.fly()
    assert (lab.said("slow"), summary["slow_ticks"]) == ([], {})


@pytest.mark.parametrize(("period", "seconds", "slow"), [(0.01, 1.1, 1), (0.2, 3.9, 0)])
def test_the_limit_is_1_s_and_at_least_20_periods(
    clock: Clock, period: float, seconds: float, slow: int
) -> None:
    measured = ComputeTime(period, realtime=False)
    reports = []
    for spent in (0.1, seconds):
        with measured.of("planner"):
            clock.time += spent
        reports += measured.end_tick()
    assert len(reports) == slow
