"""Ticks that come late are counted, and reported now and then."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from star_basics.summary_text import format_summary
from star_core import AvoiderSpec, Event, Registry, Telemetry, TransportSpec, fly, hookimpl, load
from star_core.plugin_support.tick_timing import REPORT_INTERVAL, TickTiming
from star_sim import ideal_world
from star_sim.airframe import STEP
from star_sim.transport import Simulator

PERIOD = 0.05  # s


def lateness() -> tuple[TickTiming, dict[str, float]]:
    took = {"planner": 0.0, "safety": 0.0}
    return TickTiming(PERIOD), took


def test_a_tick_that_comes_before_the_next_is_due_is_not_late() -> None:
    noted, took = lateness()
    assert [noted.note(due, due + PERIOD, took) for due in (0.0, 0.05)] == ["", ""]
    assert noted.summary() == {"late_ticks": 0, "latest_tick_s": 0.0}


def test_the_parts_that_took_the_time_are_named() -> None:
    noted, took = lateness()
    noted.note(1.0, 1.0, dict(took))
    took["planner"] += 0.045
    took["safety"] += 0.062
    assert noted.note(1.05, 1.11, dict(took)) == (
        "the control loop was 0.060 s late, 0.110 s after the previous tick: the safety filter "
        "took 0.062 s, the planner took 0.045 s"
    )


def test_compute_time_of_earlier_ticks_is_not_blamed() -> None:
    noted, took = lateness()
    took["safety"] += 5.0
    assert noted.note(1.0, 1.0, dict(took)) == ""
    took["planner"] += 0.01
    assert noted.note(1.05, 1.15, dict(took)) == (
        "the control loop was 0.100 s late, 0.150 s after the previous tick: the planner took "
        "0.010 s, 0.140 s were spent outside localizer, planner and avoider"
    )


def test_late_ticks_are_reported_at_intervals_and_all_counted() -> None:
    noted, took = lateness()
    format_summary = []
    for tick in range(1, 202):
        took["planner"] += 0.1
        due = tick * 0.1
        format_summary.append(noted.note(due, due + 0.06 + 0.01 * (tick == 7), dict(took)))
    first, last = (said for said in format_summary if said)
    assert "the planner took 0.100 s" in first
    assert last.endswith(
        f"; {int(REPORT_INTERVAL / 0.1) - 1} more late ticks since the last report"
    )
    assert noted.summary() == {"late_ticks": 201, "latest_tick_s": 0.07}


def test_a_stall_of_the_computer_is_named() -> None:
    noted, took = lateness()
    noted.note(1.0, 1.0, took)
    assert noted.note(1.05, 1.57, took) == (
        "the computer stalled for 0.52 s: the control loop did not run"
    )
    assert noted.stall == pytest.approx(0.52, abs=0.01)
    assert noted.note(1.6, 1.6, took) == ""
    assert noted.stall == 0.0


def test_every_stall_is_reported() -> None:
    noted, took = lateness()
    texts = [noted.note(due, due + 0.4, took) for due in (1.0, 2.0, 3.0)]
    assert all("stalled for 0.40 s" in text for text in texts)


def test_a_plugin_that_computes_for_long_is_no_stall(monkeypatch: pytest.MonkeyPatch) -> None:
    noted, took = lateness()
    noted.note(1.0, 1.0, dict(took))
    took["planner"] += 0.5
    assert "the planner took 0.500 s" in noted.note(1.05, 1.55, dict(took))
    assert noted.stall == 0.0
    monkeypatch.setattr("star_core.plugin_support.tick_timing.thread_time", lambda: 1e6)
    assert "spent outside" in noted.note(12.0, 12.6, dict(took))  # the core itself computes
    assert noted.stall == 0.0


class Stalling(Simulator):
    """The computer stands still for a while in flight, and receives nothing meanwhile."""

    stall = 0.55  # s
    stalls = False

    def wait(self, until: float) -> float:
        self.stalls = 0.5 <= until < 0.5 + PERIOD
        return super().wait(until + self.stall * self.stalls)

    def receive(self) -> Telemetry:
        telemetry = super().receive()
        age = telemetry.age + self.stall * self.stalls
        return replace(telemetry, age=age)


class Stalls:
    """Offers `Stalling`, and listens."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    @hookimpl
    def star_event(self, event: Event) -> None:
        self.events.append(event)

    @hookimpl
    def star_transports(self) -> Iterator[TransportSpec]:
        yield TransportSpec(
            name="stalling",
            summary="Stalls once.",
            make=lambda scene: Stalling(scene, **ideal_world()),
        )


def test_a_stall_of_the_computer_ends_no_mission(hop: Path) -> None:
    stalls = Stalls()
    registry = Registry(stalls)
    summary = fly(load(hop / "hop.yaml", registry, ["transport=stalling"]), registry)
    assert summary["outcome"] == "completed"
    late = [event.text for event in stalls.events if event.kind == "late"]
    assert len(late) == 1
    assert "the computer stalled for 0.5" in late[0]
    assert not any(event.kind == "failure" for event in stalls.events)


class Slow:
    """Offers a simulator with a clock, and an avoider that once takes three ticks; listens.

    Attributes:
        clock: Time on a virtual clock, s.
        late: Texts of the events.
    """

    def __init__(self) -> None:
        self.clock = 0.0
        self.late: list[str] = []
        self._calls = 0

    @hookimpl
    def star_event(self, event: Event) -> None:
        if event.kind == "late":
            self.late.append(event.text)

    @hookimpl
    def star_transports(self) -> Iterator[TransportSpec]:
        slow = self

        class RealTime(Simulator):
            def wait(self, until: float) -> float:
                slow.clock = max(slow.clock, until)
                return super().wait(slow.clock)

        yield TransportSpec(
            name="wall",
            summary="Goes by the clock.",
            make=lambda scene: RealTime(scene, **ideal_world()),
        )

    @hookimpl
    def star_avoiders(self) -> Iterator[AvoiderSpec]:
        yield AvoiderSpec(name="slow", summary="Is slow.", make=lambda _scene: self)

    def avoid(self, _estimate: object, planned: Any) -> Any:
        self._calls += 1
        self.clock += 3.5 * PERIOD * (self._calls == 20)
        return planned


def test_a_plugin_that_is_too_slow_is_reported_in_the_record(
    hop: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = Slow()
    monkeypatch.setattr("star_core.plugin_support.compute_time.perf_counter", lambda: slow.clock)
    registry = Registry(slow)
    summary = fly(
        load(hop / "hop.yaml", registry, ["rate=20", "transport=wall", "avoider=slow"]), registry
    )
    assert summary["late_ticks"] == 1
    assert summary["latest_tick_s"] == pytest.approx(2.5 * PERIOD, abs=STEP)
    assert len(slow.late) == 1
    assert "the avoider took 0.175 s" in slow.late[0]
    assert "  late ticks " in format_summary(summary, None)


def test_simulations_that_wait_for_plugins_are_never_late(hop: Path) -> None:
    registry = Registry(Slow())
    summary = fly(load(hop / "hop.yaml", registry, ["avoider=slow"]), registry)
    assert (summary["late_ticks"], summary["latest_tick_s"]) == (0, 0.0)
    assert "late ticks" not in format_summary(summary, None)
