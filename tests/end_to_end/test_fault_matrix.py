"""The fault matrix: its flights fly, and each of its policies can be broken."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import Event
from tests.campaign import fault_flight, faults, touchdowns
from tests.campaign.fault_cells import CELLS


def cell(name: str) -> Any:
    (fault_cell,) = (candidate for candidate in CELLS if candidate.name == name)
    return fault_cell


@pytest.mark.extended
def test_faultless_flights_pass_and_motor_failure_is_attributed() -> None:
    assert fault_flight.flown(cell("no fault"), 0, "ideal")["broken"] == []
    fallen = fault_flight.flown(cell("a motor stops"), 0, "ideal")
    assert fallen["broken"] == []
    assert fallen["fallen"] == 1


@pytest.mark.extended
@pytest.mark.parametrize("seed", [7003, 8004])  # the second flies as fast as it may
def test_a_stuck_flow_sensor_lets_no_drone_drift_away(seed: int) -> None:
    flown = fault_flight.flown(cell("flow sensor of one drone stuck"), seed, "default")
    assert any("faster than it reports" in event for event in flown["events"])
    assert flown["broken"] == []
    assert flown["outside"] == 0.0


def witness() -> Any:
    """Two drones that hover at 1 m for a second, 1 m apart, and are on the ground at 10 s."""
    flight = fault_flight.Witness(cell("a motor stops"), 3.0)
    flight.names, flight.speed_limit, flight.speed = ("cf1", "cf2"), 0.5, 0.5
    flight.time = [2.0, 3.0, 10.0]
    flight.truth = [np.array([[x, 0, z, 0, 0, 0] for x in (0.0, 1.0)]) for z in (1.0, 1.0, 0.0)]
    flight.events = [Event(3.1, "safety", "cf1 lands: tumbled", "cf1")]
    return flight


def collide(flight: Any) -> None:
    flight.truth[0][1, 0] = 0.1


def leave(flight: Any) -> None:
    flight.truth[1][0, 1] = 2.3


def send_nan(flight: Any) -> None:
    flight.finite = False


def hurry(flight: Any) -> None:
    flight.speed = 0.6


def linger(flight: Any) -> None:
    flight.time.insert(2, 20.0)
    flight.truth.insert(2, flight.truth[1])
    flight.time[3] = 30.0


def drop_the_other(flight: Any) -> None:
    flight.truth[2][1, 5] = -2.0


def say_nothing(flight: Any) -> None:
    flight.events = [Event(3.1, "safety", "cf2 lands: tumbled", "cf2")]


@pytest.mark.parametrize(
    ("breaks", "policy"),
    [
        (collide, "separation"),
        (leave, "fence"),
        (send_nan, "NaN"),
        (hurry, "speed"),
        (linger, "down"),
        (drop_the_other, "fall"),
        (say_nothing, "event"),
    ],
)
def test_every_policy_can_be_broken(breaks: Callable[[Any], None], policy: str) -> None:
    flight = witness()
    judge = (flight._cell, flight, 0, 3.0, ["cf1"])
    assert fault_flight.judged(*judge, readable=True)["broken"] == []
    assert fault_flight.judged(*judge, readable=False)["broken"] == ["record"]
    assert fault_flight.judged(flight._cell, flight, 1, 3.0, ["cf1"], readable=True)["broken"] == [
        "status"
    ]
    breaks(flight)
    assert fault_flight.judged(*judge, readable=True)["broken"] == [policy]


@pytest.mark.parametrize(("agent", "broken"), [("cf1", []), (None, ["down"])])
def test_the_loss_of_one_agent_does_not_fail_the_mission(
    agent: str | None, broken: list[str]
) -> None:
    """The other lands 17 s later, and the mission fails after that for want of a report."""
    flight = witness()
    linger(flight)
    flight.events.insert(0, Event(3.0, "failure", "cf1 is lost", agent))
    flight.events.append(Event(40.0, "failure", "cf1 did not report to be on the ground"))
    flight.truth[2][0, 2] = flight.truth[1][0, 2] = 0.0
    failing = replace(flight._cell, status=(1,))
    assert fault_flight.judged(failing, flight, 1, 3.0, ["cf1"], readable=True)["broken"] == broken


def test_a_file_of_results_is_continued_at_its_commit_only(tmp_path: Path) -> None:
    options = Namespace(results=tmp_path / "results.json", world="default")
    flights = {"no fault/0": {"status": 0, "broken": [], "cpu_s": 120.0}}
    assert faults._load(options, "one") == {}
    faults._save(options, "one", flights)
    assert faults._load(options, "one") == flights
    with pytest.raises(SystemExit, match="is not of commit two"):
        faults._load(options, "two")


def test_cpu_time_of_missing_flights_is_estimated() -> None:
    flights = {"no fault/0": {"cpu_s": 100.0}, "no fault/1": {"cpu_s": 140.0}}
    assert next(faults.costs(flights, [(0, 2), (0, 3)])) == (
        "row 0: 2 flights, 4 min of processor time"
    )


@pytest.mark.extended
@pytest.mark.parametrize("seed", [15, 16])
def test_a_take_off_that_is_broken_off_lands_gently(seed: int, tmp_path: Path) -> None:
    """With the plan of any other landing the motors stop above the floor: 0.38 m/s."""
    impact = list(touchdowns.in_simulation(seed, "broken off", tmp_path))
    assert 0.0 < max(impact) < 0.25
