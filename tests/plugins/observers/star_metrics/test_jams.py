"""Swarms that stand, and why."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from star_core import AgentPhase, Array, Event, Goals, Limits, Registry, Tick, fly, load
from star_core.testing import scene
from star_metrics.jams import Jams


def flown(
    speeds: list[float],
    seconds: float,
    *,
    pitch: float = 0.5,
    std: float = 0.001,
    goal: float = 9.0,
    noise: float = 0.0,
) -> tuple[Jams, list[Event]]:
    """Return what is counted of agents side by side that fly along x at some speeds, m/s."""
    n = len(speeds)
    jams, events = Jams(scene(n, limits=Limits(separation=0.2))), list[Event]()
    draw = np.random.default_rng(0)
    for time in np.arange(0.0, seconds, 0.05):
        position = np.zeros((n, 3))
        position[:, 0] = np.array(speeds) * time
        position[:, 1] = pitch * np.arange(n)
        velocity = noise * draw.standard_normal((n, 3))
        velocity[:, 0] += speeds
        target = position + np.array([goal, 0.0, 0.0])
        tick = SimpleNamespace(
            time=float(time),
            goals=Goals(target, np.zeros((n, 3)), np.zeros(n), np.ones(n), np.ones(n, np.bool_)),
            health=SimpleNamespace(phase=np.full(n, int(AgentPhase.FLYING))),
            estimate=SimpleNamespace(
                position=position, velocity=velocity, covariance=covariances(n, std)
            ),
        )
        if jam := jams.add(cast("Tick", tick)):
            text, details = jam
            events.append(Event(float(time), "jam", text, details=details))
    return jams, events


def covariances(n: int, std: float) -> Array:
    return np.tile(std**2 * np.eye(3), (n, 1, 1))


def test_a_swarm_that_stands_is_a_jam_once() -> None:
    jams, events = flown([0.0, 0.0, 0.0, 0.5], 60.0)
    assert jams.count == len(events) == 1
    assert 10 <= events[0].time <= 12
    assert events[0].details is not None
    assert events[0].details["agents"] == ["cf1", "cf2", "cf3"]


@pytest.mark.parametrize(
    ("speeds", "seconds", "goal"),
    [
        ([0.0, 0.0, 0.5, 0.5], 60.0, 9.0),  # half of them
        ([0.0, 0.0, 0.0, 0.0], 9.5, 9.0),  # not long enough
        ([0.0, 0.0, 0.0, 0.0], 60.0, 0.2),  # at their goals
        ([0.15, 0.15, 0.15, 0.15], 60.0, 9.0),  # slow
        ([0.0], 60.0, 9.0),  # alone
    ],
)
def test_others_are_no_jams(speeds: list[float], seconds: float, goal: float) -> None:
    assert flown(speeds, seconds, goal=goal)[0].count == 0


def test_noise_of_velocities_does_not_hide_a_jam() -> None:
    assert flown([0.0, 0.0, 0.0], 30.0, noise=0.1)[0].count == 1


@pytest.mark.parametrize(
    ("pitch", "std", "cause", "words"),
    [
        (0.75, 0.25, "uncertainty_margin", "adds up to 1.00 m .* standard deviation of 0.25 m"),
        (0.4, 0.005, "separation", "0.40 m apart: limits.separation"),
        (5.0, 0.0, "unknown", "no two of them are near"),
        (5.0, 0.25, "uncertainty_margin", "no two of them are near"),
    ],
)
def test_an_event_names_the_cause(pitch: float, std: float, cause: str, words: str) -> None:
    _, (event,) = flown([0.0, 0.0], 30.0, pitch=pitch, std=std)
    assert event.details is not None
    assert event.details["cause"] == cause
    assert event.text is not None
    assert re.search(words, event.text)


@pytest.mark.extended
def test_a_flight_that_jams_records_and_counts_it(missions: Path) -> None:
    registry = Registry()
    changes = [
        "avoider={use: orca, radius: 0.46, clearance: 0.2, communication_radius: 6}",
        "localizer={use: flow, error_std: 0.25, error_time_constant: 1000}",
        "rate=10",
    ]
    summary = fly(load(missions / "scenarios/corridor-6-0.yaml", registry, changes), registry)
    (event,) = (event for event in summary["events"] if event["kind"] == "jam")
    assert summary["jams"] == 1
    assert event["details"]["cause"] == "uncertainty_margin"
