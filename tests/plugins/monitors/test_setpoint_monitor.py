"""The kernel that follows setpoints does what the readable classes do, and no more."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Estimate, Goals, Setpoint
from star_core.safety.monitors import TickState, Use
from star_core.testing import estimate, scene
from star_core.testing.inputs import flight_telemetry
from star_monitors import setpoint_monitor
from star_monitors.setpoint_monitor import SetpointMonitor

N = 3
VALUES = np.array([0.0, 0.4, 0.5, -0.5, 9.0, np.nan, np.inf])  # m/s and m; 9 leads out of any fence


def kept(rng: np.random.Generator, before: np.ndarray, share: float) -> np.ndarray:
    """Return an array of which some rows are as before, to the last bit."""
    again = rng.random(len(before)) < share
    drawn = rng.choice(VALUES[:5], before.shape, p=[0.3, 0.25, 0.25, 0.15, 0.05])
    return np.where(again[:, None], before, drawn)


def states(monitor: SetpointMonitor) -> list[np.ndarray]:
    press, repeated = monitor.press, monitor.repeated
    return [
        press.pressed, repeated.lasted, repeated.before, repeated.begun, repeated.start,
        repeated.near,
    ]  # fmt: skip


def findings(
    monitor: SetpointMonitor, now: Estimate, goals: Goals, setpoints: list[Setpoint]
) -> list[Any]:
    """Return the velocities to go on with, and the strikes."""
    none = np.zeros(N, np.bool_)
    state = TickState(flight_telemetry(scene(N), 0.0, none, none), np.zeros(N, np.int64), none)
    state.estimate, state.goals, state.redirected = now, goals, none
    state.setpoint, state.planned = setpoints
    velocity, strikes = state.setpoint.velocity, []
    for finding in monitor.check(state):
        if isinstance(finding, Use):
            assert isinstance(finding.value, Setpoint)
            velocity = finding.value.velocity
        else:
            strikes.append(finding)
    return [velocity, *strikes]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [0.3, 0.9, 1.0])
def test_the_kernel_agrees_with_the_readable_classes(
    seed: int, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(seed)
    quick, readable = SetpointMonitor(scene(N)), SetpointMonitor(scene(N))
    kernel, quiet = setpoint_monitor.nothing_wrong, 0
    columns = [rng.normal(size=(N, 3)) for _ in range(4)]
    spoiled = rng.random() < 0.3
    for tick in range(120):
        avoided, wanted, position, goal = columns = [kept(rng, one, share) for one in columns]
        flown = rng.choice(VALUES if spoiled else VALUES[:4], (N, 3))
        now = replace(
            estimate(np.where(np.isfinite(position), position, 0.0) + 0.01 * tick), velocity=flown
        )
        goals = Goals(goal, np.zeros((N, 3)), np.zeros(N), np.ones(N), rng.random(N) < 0.9)
        setpoints = [
            Setpoint(one, np.zeros(N), np.arange(N) < 2 + (seed % 2)) for one in (avoided, wanted)
        ]
        monkeypatch.setattr(setpoint_monitor, "nothing_wrong", kernel)
        first = findings(quick, now, goals, setpoints)
        quiet += first[0] is setpoints[0].velocity and len(first) == 1
        monkeypatch.setattr(setpoint_monitor, "nothing_wrong", lambda *_: False)
        second = findings(readable, now, goals, setpoints)
        assert first[1:] == second[1:]
        np.testing.assert_array_equal(first[0], second[0])
        for one, other in zip(states(quick), states(readable), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12)
    assert quiet > 0
