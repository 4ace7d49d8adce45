"""How long the battery lasts and what it does to the motors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from star_sim import airframe, battery

Flying = Callable[..., Any]


def test_a_full_battery_hovers_for_about_seven_minutes(start: Flying) -> None:
    flight = start(rate=1.0)
    flight.rise()
    before = flight.simulator.drones["charge"][0]
    flight.fly(42.0)
    used = before - flight.simulator.drones["charge"][0]
    assert used == pytest.approx(42 / 420, rel=0.02)


def test_voltage_falls_with_charge_and_sags_under_load(start: Flying) -> None:
    flight = start()
    flight.fly(0.1)
    rest = flight.telemetry.battery[0]
    flight.rise()
    hover = flight.telemetry.battery[0]
    assert rest - hover == pytest.approx(battery.RESISTANCE * battery.HOVER_CURRENT, rel=0.3)
    flight.fly(30.0)
    assert flight.telemetry.battery[0] < hover - 0.02


def test_an_empty_battery_brings_the_drone_down(start: Flying) -> None:
    flight = start(battery=0.02)
    flight.rise()
    assert flight.position[0, 2] == pytest.approx(0.8, abs=0.03)
    flight.fly(12.0)
    assert flight.position[0, 2] == 0.0


def test_a_drone_with_no_charge_does_not_take_off(start: Flying) -> None:
    flight = start(battery=0.0)
    flight.rise()
    assert flight.position[0, 2] == 0.0
    assert flight.telemetry.battery[0] < 3.0


def test_the_most_a_motor_gives_falls_with_the_voltage() -> None:
    thrust = [battery.thrust_at(voltage) for voltage in (4.2, 3.5, 3.05, 2.9, 2.5)]
    assert thrust[0] == thrust[1] == airframe.THRUST_MAX
    assert airframe.THRUST_MAX > thrust[2] > thrust[3] > thrust[4] > 0


def test_the_voltage_without_load_runs_through_the_table() -> None:
    at = [battery.open_voltage(charge) for charge in np.linspace(0, 1, 11)]
    assert at == pytest.approx(battery.VOLTAGE_OF_CHARGE)
    assert battery.open_voltage(0.95) == pytest.approx(4.15)
