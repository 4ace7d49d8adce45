"""How a simulated drone flies when its estimator knows the truth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from star_core import Order
from star_sim import airframe
from star_sim.drone import VELOCITY
from tests.plugins.transports.star_sim.conftest import Flight, benchmark, hovering


def in_the_air(flight: Any, height: float = 5.0) -> None:
    drones = flight.simulator.drones
    drones["position"][:, 2] = drones["seen_position"][:, 2] = height
    drones["believed_position"][:, 2] = height


def test_a_drone_hovers_within_a_centimetre() -> None:
    flight = hovering(height=0.8)
    flight.fly(4.0)
    for _ in range(40):
        flight.fly(0.05)
        assert np.abs(flight.position - [[0, 0, 0.8]]).max() < 0.01


@pytest.mark.parametrize("velocity", [(0.5, 0, 0), (0, -0.3, 0), (0.2, 0.2, 0.1), (0, 0, -0.2)])
def test_a_velocity_setpoint_is_followed_within_two_per_cent(
    velocity: tuple[float, float, float],
) -> None:
    flight = hovering(height=2.0)
    flight.fly(8.0, velocity)
    error = flight.telemetry.velocity[0] - velocity
    assert np.linalg.norm(error) < 0.02 * np.linalg.norm(velocity)


def test_motors_off_is_free_fall_with_drag() -> None:
    flight = Flight()
    in_the_air(flight)
    flight.fly(0.5)
    drag = airframe.DRAG_Z / airframe.MASS
    fallen = airframe.GRAVITY / drag * (0.5 - (1 - math.exp(-drag * 0.5)) / drag)
    step = airframe.GRAVITY * airframe.STEP * 0.5 / 2  # of one semi-implicit step per step
    assert 5.0 - flight.position[0, 2] == pytest.approx(fallen + step, rel=2e-3)


@given(rates=st.tuples(*[st.floats(-20, 20)] * 3), velocity=st.tuples(*[st.floats(-2, 2)] * 3))
@settings(max_examples=20)
def test_the_attitude_stays_a_unit_quaternion(
    rates: tuple[float, float, float], velocity: tuple[float, float, float]
) -> None:
    sim = benchmark()["hover"](1, noise=False)
    sim.drones["rates"], sim.drones["velocity"] = rates, velocity
    sim.wait(1.0)
    assert np.linalg.norm(sim.truth().attitude, axis=1) == pytest.approx(1.0, abs=1e-12)


def test_a_body_that_spins_freely_keeps_its_angular_momentum() -> None:
    flight = Flight()
    in_the_air(flight)
    drones = flight.simulator.drones
    drones["rates"] = [3.0, -2.0, 4.0]
    inertia = np.array([airframe.INERTIA_XY, airframe.INERTIA_XY, airframe.INERTIA_Z])
    before = np.linalg.norm(inertia * drones["rates"][0])
    flight.fly(0.5)
    assert np.linalg.norm(inertia * drones["rates"][0]) == pytest.approx(before, rel=1e-2)


def test_a_drone_that_falls_on_the_floor_comes_to_rest_there() -> None:
    flight = Flight()
    in_the_air(flight, 1.0)
    flight.simulator.drones["velocity"] = [0.5, 0.5, 0.0]
    flight.fly(2.0)
    assert flight.position[0, 2] == 0.0
    assert np.abs(flight.telemetry.velocity).max() < 1e-6


def test_the_kernel_agrees_with_plain_numpy() -> None:
    n = 11  # a full layout of eight, and one that is not full
    rng = np.random.default_rng(1)
    heading = rng.uniform(-3, 3, n)
    sim = benchmark()["hover"](n, noise=False)
    drones = sim.drones
    drones["position"] += rng.normal(0, 0.1, (n, 3))
    drones["attitude"][:, 2], drones["attitude"][:, 3] = np.sin(heading / 2), np.cos(heading / 2)
    drones["thrust"] = 0.0
    drones["origin_yaw"] = drones["seen_yaw"] = heading
    drones["slip"] = np.stack([np.cos(heading), -np.sin(heading)], axis=1)
    peer = benchmark()["NumpySwarm"](drones["position"], heading)
    for tick in range(40):
        velocity, yaw = rng.uniform(-1, 1, (n, 3)), rng.uniform(-3, 3, n)
        drones["reference_velocity"], drones["reference_yaw"] = velocity, yaw
        drones["mode"] = VELOCITY
        sim.wait((tick + 1) / 20)
        peer.tick(velocity, yaw, 25)
    assert np.abs(drones["position"] - peer.position).max() < 1e-9
    assert np.abs(drones["velocity"] - peer.velocity).max() < 1e-9
    assert np.abs(drones["attitude"] - peer.attitude).max() < 1e-9


def test_a_take_off_reaches_its_height_and_stays_over_its_start() -> None:
    flight = Flight(at=[(1.0, 2.0, 0.0)], yaw=0.7)
    flight.order(Order.TAKEOFF, (9.0, 9.0, 1.2), duration=3.0)
    flight.fly(6.0)
    assert flight.position[0] == pytest.approx([1.0, 2.0, 1.2], abs=0.01)
