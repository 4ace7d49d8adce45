"""How long the battery lasts and what it does to the motors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from star_core import Order, Run
from star_sim import airframe, battery, discharge
from star_sim.discharge import HOVER_TIME
from tests.plugins.transports.star_sim.conftest import Flight, hovering


@pytest.mark.parametrize(
    ("options", "endurance"), [({}, HOVER_TIME), ({"endurance": 210.0}, 210.0)]
)
def test_a_full_battery_hovers_for_its_endurance(options: dict[str, Any], endurance: float) -> None:
    flight = hovering(rate=1.0, **options)
    before = flight.simulator.drones["charge"][0]
    flight.fly(21.0)
    assert before - flight.simulator.drones["charge"][0] == pytest.approx(21 / endurance, rel=0.02)


def test_agents_standing_for_the_swap_time_get_a_new_battery() -> None:
    flight = hovering(endurance=30.0, swap_time=5.0)
    flight.order(Order.LAND, duration=3.0)
    flight.fly(4.0)
    used = flight.simulator.drones["charge"][0]
    assert used < 0.9
    flight.fly(3.0)
    assert flight.simulator.drones["charge"][0] <= used
    flight.fly(4.0)
    assert flight.simulator.drones["charge"][0] > 0.99


def test_no_agent_changes_batteries_by_default() -> None:
    flight = hovering(endurance=30.0)
    flight.order(Order.LAND, duration=3.0)
    flight.fly(60.0)
    assert flight.simulator.drones["charge"][0] < 0.9


def test_batteries_are_not_swapped_in_flight() -> None:
    flight = hovering(endurance=60.0, swap_time=0.1)
    flight.fly(5.0)
    assert flight.simulator.drones["charge"][0] < 0.9


def test_voltage_falls_with_charge_and_sags_under_load() -> None:
    flight = Flight()
    flight.fly(0.1)
    rest = flight.telemetry.battery[0]
    flight.rise()
    hover = flight.telemetry.battery[0]
    assert rest - hover == pytest.approx(discharge.RESISTANCE * discharge.HOVER_CURRENT, rel=0.3)
    flight.fly(30.0)
    assert flight.telemetry.battery[0] < hover - 0.02


def test_an_empty_battery_brings_the_drone_down() -> None:
    flight = hovering(battery=0.02)
    assert flight.position[0, 2] == pytest.approx(0.8, abs=0.03)
    flight.fly(12.0)
    assert flight.position[0, 2] == 0.0


def test_a_drone_with_no_charge_does_not_take_off() -> None:
    flight = hovering(battery=0.0)
    assert flight.position[0, 2] == 0.0
    assert flight.telemetry.battery[0] < 3.0


def test_the_most_a_motor_gives_falls_with_the_voltage() -> None:
    thrust = [battery.thrust_at(voltage) for voltage in (4.2, 3.5, 3.05, 2.9, 2.5)]
    assert thrust[0] == thrust[1] == airframe.THRUST_MAX
    assert airframe.THRUST_MAX > thrust[2] > thrust[3] > thrust[4] > 0


def test_the_voltage_without_load_runs_through_the_table() -> None:
    at = [battery.open_voltage(charge) for charge in np.linspace(0, 1, 11)]
    assert at == pytest.approx(discharge.VOLTAGE_OF_CHARGE)
    assert battery.open_voltage(0.95) == pytest.approx(4.15)


def test_a_flight_with_an_empty_battery_is_not_started(fly: Callable[..., Run]) -> None:
    change = "transport={use: sim, battery: 0.02}"
    summary = fly("first_flight", change, "safety={battery_low: {}}").summary
    reason = "not started: battery_low: cf1, cf2, cf3 at 3.16 V, below 3.2 V"
    assert (summary["outcome"], summary["reason"]) == ("failed", reason)
