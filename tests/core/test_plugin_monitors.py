"""Monitors that plugins add: findings are checked, and one that fails is named and dropped."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from star_core import Goals, Registry, Setpoint, hookimpl
from star_core.discovery import Source
from star_core.plugin_support.compute_time import ComputeTime
from star_core.safety.monitors import (
    Brake,
    Exclude,
    Finding,
    Misreport,
    PluginMonitor,
    Report,
    SafetyAction,
    Stage,
    Strike,
    TickState,
    Use,
    plugin_monitors,
)
from star_core.testing import estimate, scene
from star_core.testing.inputs import flight_telemetry
from star_core.toolkit import MonitorSpec
from tests.core.conftest import Lab

N = 2
NAN = replace(estimate(np.zeros((N, 3))), velocity=np.full((N, 3), np.nan))


def offering(make: Callable[..., object]) -> object:
    """Return a plugin with a monitor."""

    class Plugin:
        @hookimpl
        def star_monitors(self) -> Iterable[MonitorSpec]:
            yield MonitorSpec(name="mine", summary="Checks.", make=make)  # type: ignore[arg-type]

    return Plugin()


def monitor(make: Callable[..., object]) -> tuple[PluginMonitor, list[str]]:
    """Return a monitor of a plugin, and the events that it reports."""
    events: list[str] = []
    registry = Registry(offering(make), installed=False)
    times = ComputeTime(0.05, realtime=False)
    (only,) = plugin_monitors(scene(N), registry, times, events.append)
    return only, events


def yielding(*findings: object) -> Callable[..., object]:
    return lambda _scene: SimpleNamespace(after=Stage.AVOIDED, check=lambda state: findings)  # noqa: ARG005 -- as it is called


def state() -> TickState:
    none = np.zeros(N, np.bool_)
    return TickState(flight_telemetry(scene(N), 0.0, none, none), np.zeros(N, np.int64), none)


FINDINGS: tuple[Finding, ...] = (
    Brake(),
    Report("height", "cf1 is high", "cf1"),
    Exclude(1, SafetyAction.LAND, "it is high"),
    Strike("planner", "it is stuck"),
    Use("estimate", estimate(np.zeros((N, 3)))),
    Use("visible", estimate(np.zeros((N, 3)))),
    Use("goals", Goals.none(N)),
    Use("setpoint", Setpoint.none(N)),
    Misreport(np.zeros((N, 3)), np.zeros(N, np.bool_)),
)


@pytest.mark.parametrize("finding", FINDINGS, ids=lambda finding: type(finding).__name__)
def test_findings_of_a_plugin_are_passed_on(finding: Finding) -> None:
    checked, events = monitor(yielding(finding))
    assert checked.after == (Stage.AVOIDED,)
    assert [*checked.check(state())] == [finding]
    assert not events


@pytest.mark.parametrize(
    ("finding", "text"),
    [
        ("high", "check() yields 'high', expected a finding"),
        (Exclude(N, SafetyAction.LAND, "high"), "expected a row from 0 to 1 and a SafetyAction"),
        (Exclude("cf1", SafetyAction.LAND, "high"), "expected a row from 0 to 1"),  # type: ignore[arg-type]
        (Exclude(0, "land", "high"), "check() yields Exclude(row=0, action='land'"),  # type: ignore[arg-type]
        (Strike("world", "flat"), "expected a kind of plugin: transport, localizer"),
        (Report("height", "cf1 is high", 0), "the name of an agent, as text"),  # type: ignore[arg-type]
        (Use("telemetry", Goals.none(N)), "yields Use('telemetry', ...), expected 'estimate', "),  # type: ignore[arg-type]
        (Use("estimate", NAN), "Estimate.velocity of row 0"),
        (Use("goals", Goals.none(3)), "every field of Goals has 3 rows, expected 2"),
        (Use("setpoint", Goals.none(N)), "returned Goals, expected Setpoint"),
        (Misreport(np.zeros((1, 3)), np.zeros(1, np.bool_)), "has not finite rows of 2 agents"),
        (Misreport(np.full((N, 3), np.nan), np.zeros(N, np.bool_)), "has not finite rows"),
    ],
    ids=str,
)
def test_a_wrong_finding_names_and_drops_the_plugin(finding: Any, text: str) -> None:
    checked, events = monitor(yielding(finding))
    assert [*checked.check(state())] == [*checked.check(state())] == []
    (event,) = events
    assert event.startswith("the flight goes on without a monitor: monitor 'mine' (")
    assert text in event


class WithoutStage:
    def __init__(self, _scene: object) -> None: ...

    def check(self, state: TickState) -> Iterable[Finding]:
        return ()


class WithoutState(WithoutStage):
    after = Stage.TRACKED

    def check(self) -> Iterable[Finding]:  # type: ignore[override]
        return ()


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (WithoutStage, "has no attribute 'after'"),
        (WithoutState, "cannot be called as check(state)"),
        (lambda _scene: int("high"), "ValueError: invalid literal"),
    ],
)
def test_a_monitor_that_cannot_be_made_is_reported_in_flight(
    make: Callable[..., object], text: str
) -> None:
    checked, events = monitor(make)
    assert not events
    assert not [*checked.check(state())]
    assert text in events[0]


def test_the_flight_goes_on_without_a_monitor_that_raises(lab: Lab) -> None:
    def check(state: TickState) -> Iterable[Finding]:
        if state.telemetry.time > 1.0:
            raise RuntimeError("out of ideas")
        return ()

    def make(_scene: object) -> object:
        return SimpleNamespace(after=Stage.LOCATED, check=check)

    lab.registry.add(offering(make), Source("theirs:mine"))
    assert lab.fly()["outcome"] == "completed"
    (event,) = (text for text in lab.said("plugin") if "monitor" in text)
    assert "RuntimeError: out of ideas (" in event
    assert __file__ in event


@pytest.mark.parametrize("stage", Stage)
def test_agents_brake_whatever_stage_a_monitor_brakes_after(lab: Lab, stage: Stage) -> None:
    def check(state: TickState) -> Iterable[Finding]:
        return (Brake(),) if 2.0 < state.telemetry.time < 3.0 else ()

    def make(_scene: object) -> object:
        return SimpleNamespace(after=stage, check=check)

    lab.registry.add(offering(make), Source("theirs:mine"))
    assert lab.fly()["outcome"] == "completed"
    braked = [not tick.sent.active.any() or not tick.sent.velocity.any() for tick in lab.ticks]
    times = [tick.time for tick in lab.ticks]
    assert all(brakes for brakes, time in zip(braked, times, strict=True) if 2.0 < time < 3.0)


def test_blocking_the_monitors_of_star_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Registry().missing_monitors() == ""
    monkeypatch.setenv("STAR_BLOCK_PLUGINS", "mcap,monitors")
    text = Registry().missing_monitors()
    assert text.endswith("come with STAR: STAR_BLOCK_PLUGINS is 'mcap,monitors'")
    assert Registry(installed=False).missing_monitors() == ""
