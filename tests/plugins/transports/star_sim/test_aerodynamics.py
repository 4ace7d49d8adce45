"""Downwash, ground effect, wind and radio loss: the published laws, and what drones do in them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Order
from star_core.plugin_support.registry import Registry
from star_core.testing import scene
from star_sim.aerodynamics import (
    COLUMNS,
    LOAD,
    PROPELLER_RADIUS,
    Wind,
    cushion,
    downwash,
    push,
    wash,
)
from star_sim.airframe import CYCLE, GRAVITY, HEIGHT, MASS
from star_sim.contact import SWEEP
from star_sim.drone import OFF, VELOCITY, standing
from star_sim.error_profile import IDEAL, REALISTIC
from star_sim.powertrain import DRAG
from tests.plugins.transports.star_sim.conftest import Flight, hovering

# The kernel of the default options, which need not be compiled for these tests alone.
AIR: dict[str, Any] = {
    "controller": "pid",
    "noise": True,
    "profile": replace(REALISTIC, report_loss=0.0),
}
WEIGHT = MASS * GRAVITY
MOTOR_DISTANCE = 0.092  # m


def jet(depth: float, radius: float) -> float:
    """Velocity below a hovering quadrotor over its hover-induced velocity, RA-L 2025."""
    far = depth / MOTOR_DISTANCE + 5.817
    across = radius / MOTOR_DISTANCE / (0.07668 * far)
    return 10.11 / far / (1 + (math.sqrt(2) - 1) * across**2) ** 2


def thrust(flight: Any) -> np.ndarray:
    """Mean thrust of each drone over the next second, N."""
    sums = []
    for _ in range(20):
        flight.fly(0.05, np.zeros(3))
        sums.append(flight.simulator.drones["thrust"].sum(axis=1))
    return np.asarray(np.mean(sums, axis=0))


@pytest.mark.parametrize(("depth", "radius"), [(0.2, 0.0), (0.5, 0.05), (1.0, 0.1), (1.8, 0.3)])
def test_downwash_is_the_dynamic_pressure_of_a_turbulent_jet(depth: float, radius: float) -> None:
    at_measurement = downwash(0.3, 0.0, WEIGHT)
    assert at_measurement == pytest.approx(9 / 34 * WEIGHT)
    ratio = (jet(depth, radius) / jet(0.3, 0.0)) ** 2
    assert downwash(depth, radius**2, WEIGHT) == pytest.approx(ratio * at_measurement)


def test_the_jet_carries_the_momentum_of_the_thrust() -> None:
    density, rotors = 1.225, 4 * math.pi * PROPELLER_RADIUS**2
    induced = math.sqrt(WEIGHT / (2 * density * rotors))
    radius = np.linspace(0, 3, 30001)
    speed = induced * np.array([jet(0.6, r) for r in radius])
    momentum = density * np.trapezoid(speed**2 * 2 * math.pi * radius, radius)
    assert momentum == pytest.approx(WEIGHT, rel=0.1)


def test_downwash_reaches_all_drones_below_in_any_order() -> None:
    random = np.random.default_rng(0)
    drones = standing(random.uniform(0, 3, (60, 3)), np.zeros(60), 1.0)
    drones["thrust"] = random.uniform(0, 0.1, (60, 4))
    near, keys = np.zeros((60, COLUMNS)), drones["position"] @ SWEEP
    wash(drones.view(np.recarray), np.argsort(keys), keys, near)
    for row, (at, load) in enumerate(zip(drones["position"], near[:, LOAD], strict=True)):
        expected = 0.0
        for other, thrusts in zip(drones["position"], drones["thrust"], strict=True):
            east, north, up = other - at
            if 0 < up < 2 and math.hypot(east, north) < 0.5:
                expected += downwash(up, east**2 + north**2, thrusts.sum())
        assert load == pytest.approx(expected), row


def test_a_drone_below_another_needs_more_thrust() -> None:
    flight = Flight(2, at=[(0, 0, 0), (2, 0, 0)], **AIR)
    flight.order(Order.TAKEOFF, (0.0, 0.0, 1.6), rows=[0])
    flight.order(Order.TAKEOFF, (0.0, 0.0, 1.0), rows=[1])
    flight.fly(4.0)
    drones = flight.simulator.drones
    for name in ("position", "seen_position", "origin"):
        drones[name][1, 0] -= 2.0
    flight.fly(7.0, np.zeros(3))
    east, north, rise = flight.position[0] - flight.position[1]
    load = downwash(rise, east**2 + north**2, WEIGHT)
    assert thrust(flight) == pytest.approx([WEIGHT, WEIGHT + load], rel=0.01)


def test_what_is_below_carries_a_part_of_the_thrust() -> None:
    assert cushion(0.1) == pytest.approx(11.36859 * (PROPELLER_RADIUS / 0.4) ** 2)
    assert cushion(0.0) == pytest.approx(cushion(0.0378), rel=1e-2)  # as in gym-pybullet-drones
    drones = standing(np.zeros((2, 3)), np.zeros(2), 1.0)
    drones["thrust"], drones["mode"] = WEIGHT / 4, [VELOCITY, OFF]
    drones["position"][:, 2], drones["surface"] = 0.5, 0.4  # over a table
    for drone in drones.view(np.recarray):
        push(drone, np.zeros(3), np.zeros(COLUMNS), None)
    rise = CYCLE * GRAVITY * cushion(0.1 + HEIGHT)
    assert drones["velocity"] == pytest.approx(np.array([[0, 0, rise], [0, 0, 0]]))


def test_a_drone_leans_into_the_wind() -> None:
    wind = {"velocity": [2.0, 0.0, 0.0], "gusts": 0.0, "gust_time": 1.0}
    flight = hovering(wind=wind, **AIR)
    flight.fly(6.0, np.zeros(3))
    tilts, speeds = [], []
    for _ in range(40):
        flight.fly(0.05, np.zeros(3))
        x, y, z, w = flight.simulator.truth().attitude[0]
        tilts.append(-2 * (x * z + w * y) / (1 - 2 * (x * x + y * y)))  # nose down is positive
        speeds.append(flight.simulator.truth().velocity[0, 0])
    expected = DRAG * (2.0 - np.mean(speeds)) / WEIGHT
    assert np.mean(tilts) == pytest.approx(expected, rel=0.05)


def test_wind_does_not_move_a_drone_on_the_ground() -> None:
    flight = Flight(wind={"velocity": [5.0, 0.0, 0.0], "gusts": 1.0, "gust_time": 1.0}, **AIR)
    before = flight.position.copy()
    flight.fly(2.0)
    assert np.array_equal(flight.position, before)


def test_gusts_have_the_configured_deviation_and_correlation() -> None:
    wind = Wind([1.0, 0.0, -0.5], 0.4, 0.5, seed=0, agents=40)
    air = np.concatenate([wind.block(128) for _ in range(30)]) - [1.0, 0.0, -0.5]
    assert air.mean() == pytest.approx(0.0, abs=0.02)
    assert air.std() == pytest.approx(0.4, rel=0.03)
    lag = round(0.5 / CYCLE)
    assert (air[lag:] * air[:-lag]).mean() / air.var() == pytest.approx(math.exp(-1), abs=0.04)
    assert abs(np.corrcoef(air[::lag, 0, 0], air[::lag, 1, 0])[0, 1]) < 0.4


def test_gusts_depend_on_the_seed_and_the_agent_alone() -> None:
    def gusts(seed: int, agents: int, blocks: tuple[int, ...] = (128,)) -> np.ndarray:
        wind = Wind([0.0, 0.0, 0.0], 0.4, 2.0, seed=seed, agents=agents)
        return np.concatenate([wind.block(cycles) for cycles in blocks])

    assert np.array_equal(gusts(7, 2), gusts(7, 5)[:, :2])
    assert not np.array_equal(gusts(7, 2), gusts(8, 2))
    assert np.array_equal(gusts(7, 1, (64, 64)), gusts(7, 1))


def test_setpoints_are_lost_agent_by_agent() -> None:
    lossy = replace(IDEAL, setpoint_loss=0.3)
    flight = hovering(20, noise=True, profile=lossy, at=[(float(i), 0, 0) for i in range(20)])
    received = []
    for _ in range(100):
        flight.fly(0.05, np.zeros(3))
        age = flight.simulator.time - flight.simulator.drones["setpoint_time"]
        received.append(age < 0.051)
    assert 1 - np.mean(received) == pytest.approx(0.3, abs=0.04)
    assert 0 < np.mean(received[-1]) < 1


def test_options_change_single_values_of_the_profile() -> None:
    spec = Registry().find("transport", "sim").offer
    options: dict[str, Any] = {
        "profile": "realistic", "noise": True, "controller": "ideal", "battery": 1.0,
        "endurance": 420.0, "swap_time": None, "speed": None,
    }  # fmt: skip
    still = spec.make(scene(2), **options)
    assert still._near is not None
    other = spec.make(scene(2), **options, aerodynamics=False, radio={"report_loss": 0.5})
    assert other._air is None
    assert other._link._profile.report_loss == 0.5
    assert other._link._profile.setpoint_delay == 0.01
