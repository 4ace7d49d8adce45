"""The simulator as a transport: its clock, its offer, and the same numbers every time."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import star_sim
from star_core import Setpoint
from star_core.toolkit import Paced
from star_sim.error_profile import IDEAL, REALISTIC, ErrorProfile
from tests.plugins.transports.star_sim.conftest import Flight, hovering


def flown(n: int = 1, **options: Any) -> Flight:
    flight = hovering(n, **options)
    flight.fly(2.0, (0.2, 0.3, 0.0), yaw=0.4)
    return flight


@pytest.mark.parametrize("profile", [IDEAL, REALISTIC])
def test_a_seed_is_one_flight_to_the_last_bit(profile: ErrorProfile) -> None:
    first, same, other = (flown(3, noise=True, profile=profile, seed=seed) for seed in (4, 4, 5))
    assert first.simulator.drones.tobytes() == same.simulator.drones.tobytes()
    assert np.abs(first.position - other.position).max() > 1e-3


@pytest.mark.parametrize(
    ("controller", "noise"), [("ideal", True), ("pid", False), ("mellinger", False)]
)
def test_flights_are_bit_identical_alone_and_in_a_swarm(controller: str, *, noise: bool) -> None:
    apart = [(4.0 * i, 0.0, 0.0) for i in range(12)]
    alone, many = (
        flown(at=at, controller=controller, noise=noise).simulator.drones
        for at in (apart[:1], apart)
    )
    assert alone.tobytes() == many[:1].tobytes()


def test_noise_goes_on_beyond_one_block_of_numbers() -> None:
    fine, coarse = hovering(noise=True), hovering(noise=True, rate=2.0)
    fine.fly(5.0)
    coarse.fly(5.0)
    assert fine.position == pytest.approx(coarse.position, abs=1e-12)


def test_wait_stops_at_whole_steps_and_adds_up_without_drift() -> None:
    simulator = Flight(rate=30.0).simulator
    for tick in range(1, 601):
        now = simulator.wait(tick / 30)
        assert 0 <= now - tick / 30 < 0.002
        assert now == pytest.approx(round(now / 0.002) * 0.002, abs=1e-12)


def test_clock_telemetry_odometry_and_truth_have_the_same_time() -> None:
    flight = Flight()
    for tick in range(1, 400):
        now = flight.simulator.wait(tick * 0.05)
        heard = flight.simulator.receive()
        assert heard.time == heard.odometry.time[-1] == flight.simulator.truth().time == now


def test_waiting_for_what_is_past_changes_nothing() -> None:
    flight = Flight()
    flight.fly(0.5)
    before = flight.simulator.drones.tobytes()
    assert flight.simulator.wait(0.2) == pytest.approx(0.5)
    assert flight.simulator.drones.tobytes() == before


def test_odometry_is_handed_out_once() -> None:
    flight = Flight()
    flight.fly(0.05)
    assert len(flight.telemetry.odometry.agent) == 5
    assert len(flight.simulator.receive().odometry.agent) == 0


def test_telemetry_is_a_copy_that_later_ticks_leave_alone() -> None:
    flight = Flight()
    heard = flight.fly(0.05)[0]
    flight.rise()
    assert heard.position[0, 2] == 0.0


def test_what_is_sent_is_what_was_wished() -> None:
    setpoint = Setpoint(np.full((2, 3), 0.3), np.zeros(2), np.array([True, False]))
    assert Flight(2).simulator.send(setpoint) is setpoint


class Wall:
    """Wall time, s, that passes only while the simulator sleeps."""

    def __init__(self) -> None:
        self.now = 0.0
        self.naps = 0

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.naps += 1


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    clock = Wall()
    monkeypatch.setattr(time, "monotonic", lambda: clock.now)
    monkeypatch.setattr(time, "sleep", clock.sleep)
    return clock


def test_time_is_kept_when_a_speed_is_asked_for(wall: Wall) -> None:
    Flight(speed=2.0).fly(1.0)
    assert wall.now == pytest.approx(0.5)
    assert wall.naps == 20


def test_the_speed_changes_in_flight_and_nothing_else_does(wall: Wall) -> None:
    alike, changed = flown(2), hovering(2, speed=1.0)
    assert wall.now == pytest.approx(changed.simulator.time)
    for speed, seconds in (0.5, 1.0), (4.0, 0.5), (None, 0.25), (1.0, 0.25):
        begun, changed.simulator.speed = wall.now, speed
        changed.fly(seconds, (0.2, 0.3, 0.0), yaw=0.4)
        assert wall.now - begun == pytest.approx(seconds / speed if speed else 0.0)
    assert changed.simulator.drones.tobytes() == alike.simulator.drones.tobytes()


def test_its_speed_can_be_changed_by_the_core() -> None:
    assert isinstance(Flight().simulator, Paced)


def test_without_a_speed_it_never_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "sleep", lambda _: pytest.fail("slept"))
    Flight().fly(1.0)


def test_the_options_are_a_schema() -> None:
    Draft202012Validator.check_schema(star_sim.OPTIONS)
