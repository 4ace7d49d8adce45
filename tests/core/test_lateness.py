"""Ticks that come late are counted, and told of now and then."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from star_core import Event, Offer, Registry, fly, hookimpl, load
from star_core.lateness import AGAIN, Lateness
from star_core.running import told
from star_sim.transport import Simulator

PERIOD = 0.05  # s


def lateness() -> tuple[Lateness, dict[str, float]]:
    took = {"planner": 0.0, "safety": 0.0}
    return Lateness(PERIOD, took), took


def test_a_tick_that_comes_before_the_next_is_due_is_not_late() -> None:
    noted, _ = lateness()
    assert [noted.note(due, due + PERIOD) for due in (0.0, 0.05)] == ["", ""]
    assert noted.summary() == {"late_ticks": 0, "latest_tick_s": 0.0}


def test_the_parts_that_took_the_time_are_named() -> None:
    noted, took = lateness()
    noted.note(1.0, 1.0)
    took["planner"] += 0.045
    took["safety"] += 0.062
    assert noted.note(1.05, 1.11) == (
        "a tick came 0.060 s late, 0.110 s after the last: the safety filter took 0.062 s, "
        "the planner took 0.045 s"
    )


def test_what_a_part_took_in_earlier_ticks_is_not_held_against_it() -> None:
    noted, took = lateness()
    took["safety"] += 5.0
    assert noted.note(1.0, 1.0) == ""
    took["planner"] += 0.01
    assert noted.note(1.05, 1.15) == (
        "a tick came 0.100 s late, 0.150 s after the last: the planner took 0.010 s, "
        "0.140 s went to tasks, observers, waiting or other programs"
    )


def test_late_ticks_are_told_of_now_and_then_and_all_are_counted() -> None:
    noted, took = lateness()
    told = []
    for tick in range(1, 202):
        took["planner"] += 0.1
        due = tick * 0.1
        told.append(noted.note(due, due + 0.06 + 0.01 * (tick == 7)))
    first, last = (said for said in told if said)
    assert "the planner took 0.100 s" in first
    assert last.endswith(f"; late since the last that was told: {int(AGAIN / 0.1) - 1}")
    assert noted.summary() == {"late_ticks": 201, "latest_tick_s": 0.07}


class Slow:
    """Offers a simulator in real time, and an avoider that once takes three ticks; listens."""

    def __init__(self) -> None:
        self.late: list[str] = []

    @hookimpl
    def star_event(self, event: Event) -> None:
        if event.kind == "late":
            self.late.append(event.text)

    @hookimpl
    def star_transports(self) -> Iterator[Offer[Any]]:
        yield Offer(name="wall", summary="Walls.", make=InRealTime, realtime=True)

    @hookimpl
    def star_avoiders(self) -> Iterator[Offer[Any]]:
        yield Offer(name="slow", summary="Dawdles.", make=lambda _scene: Dawdler())


class InRealTime(Simulator):
    """The simulator, with the computer's clock."""

    def wait(self, until: float) -> float:
        self.began = getattr(self, "began", time.monotonic())
        time.sleep(max(0.0, self.began + until - time.monotonic()))
        return super().wait(max(until, time.monotonic() - self.began))


class Dawdler:
    """Flies what is wanted."""

    def __init__(self) -> None:
        self._calls = 0

    def avoid(self, _estimate: object, wanted: Any) -> Any:
        self._calls += 1
        if self._calls == 20:
            time.sleep(3.5 * PERIOD)
        return wanted


def test_a_part_that_is_too_slow_is_told_of_in_the_record(hop: Path) -> None:
    slow = Slow()
    registry = Registry(slow)
    summary = fly(load(hop / "hop.yaml", registry, ["transport=wall", "avoider=slow"]), registry)
    assert summary["late_ticks"] >= 1
    assert summary["latest_tick_s"] > 2 * PERIOD
    assert any("the avoider took 0.1" in text for text in slow.late)
    assert "  late        ticks: " in told(summary, None)


def test_in_a_simulation_that_waits_for_its_parts_nothing_is_late(hop: Path) -> None:
    registry = Registry(Slow())
    summary = fly(load(hop / "hop.yaml", registry, ["avoider=slow"]), registry)
    assert (summary["late_ticks"], summary["latest_tick_s"]) == (0, 0.0)
    assert "late" not in told(summary, None)
