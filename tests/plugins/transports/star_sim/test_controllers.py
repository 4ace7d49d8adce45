"""How drones fly under the firmware's controllers, with motors and battery of real flights."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import Array, Order, Registry, Setpoint, Supervisor, fly, load
from star_sim import airframe, powertrain
from star_sim.cascade import EARLIER_HEIGHT_GAIN
from star_sim.drone import DEMAND, FREE, POSITION, SPEED
from star_sim.powertrain import motor_voltage
from tests.plugins.transports.star_sim.conftest import Flight

CONTROLLERS = ["pid", "mellinger"]
CYCLE = airframe.CYCLE
FIRST_FLIGHT = Path(__file__).parents[4] / "missions" / "first_flight.yaml"


def hover(controller: str, height: float = 1.0, *, earlier: bool = False, **options: Any) -> Any:
    flight = Flight(controller=controller, rate=100.0, **options)
    if earlier:
        flight.simulator.cascades["height_integral_gain"] = EARLIER_HEIGHT_GAIN
    flight.order(Order.TAKEOFF, (0.0, 0.0, height), duration=2.0)
    flight.fly(4.0)
    flight.hover()
    flight.fly(8.0)
    return flight


def chase(flight: Any, path: Callable[[float], tuple[float, float]], seconds: float) -> Array:
    """Send position setpoints at 100 Hz, as a Crazyflie gets them; return (T, 2) true positions."""
    drone = flight.simulator.drones[0]
    drone["mode"], drone["axes"], drone["feed_forward"] = DEMAND, POSITION, 0.0
    flown = []
    for k in range(round(seconds / CYCLE)):
        drone["reference_position"] = (*path(k * CYCLE), 1.0)
        flight.fly(CYCLE)
        flown.append(flight.position[0, :2])
    return np.array(flown)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_drones_trail_position_setpoints_by_half_a_second(controller: str) -> None:
    """Twenty real flights trail by 0.46 to 0.66 s; at 0.5 m/s by 0.46 to 0.56 s."""
    flight = hover(controller)
    rate = 0.5  # rad/s: 0.5 m/s at a radius of 1 m
    flown = chase(flight, lambda t: (math.cos(rate * t), math.sin(rate * t)), 30.0)
    turns = np.exp(-1j * rate * np.arange(len(flown)) * CYCLE)
    last = round(2 * math.pi / rate / CYCLE)  # one whole circle
    response = ((flown[:, 0] + 1j * flown[:, 1]) * turns)[-last:].mean()
    assert 0.46 < -np.angle(response) / rate < 0.66
    assert abs(response) == pytest.approx(1.0, abs=0.08)


def test_position_steps_are_speed_limited_and_overshoot_slightly() -> None:
    flight = hover("pid")
    flown = chase(flight, lambda _t: (3.0, 0.0), 10.0)[:, 0]
    speed = np.diff(flown) / CYCLE
    assert 0.85 < np.median(speed[100:200]) < 1.1  # PID_POS_VEL_X_MAX 1 m/s, and its overhead
    assert 3.0 < flown.max() < 3.3
    assert flown[-1] == pytest.approx(3.0, abs=0.03)


def test_velocity_setpoints_have_a_third_of_a_second_response() -> None:
    flight = hover("pid")
    speeds = [heard.velocity[0, 0] for heard in flight.fly(2.0, (0.5, 0.0, 0.0))]
    reached = (1 + np.argmax(np.array(speeds) > 0.632 * 0.5)) * CYCLE
    assert 0.28 < reached < 0.38
    assert 0.43 < speeds[-1] < 0.5  # drag: the firmware's integral takes half a minute


@pytest.mark.parametrize(
    ("controller", "velocity", "most"), [("pid", (5.0, 0, 0), 30.0), ("ideal", (5.0, 5.0, 0), 25.0)]
)
def test_violent_setpoints_keep_tilt_within_the_firmware_limit(
    controller: str, velocity: tuple[float, ...], most: float
) -> None:
    flight = hover(controller, 2.0)
    tilts = []
    for sign in (1, -1, 1, -1):
        for heard in flight.fly(0.5, sign * np.array(velocity)):
            upright = 1 - 2 * (heard.attitude[0, :2] ** 2).sum()
            tilts.append(math.degrees(math.acos(upright)))
    assert 15.0 < max(tilts) < most  # 20° and the overshoot of the attitude loop


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_hover_takes_the_pwm_of_real_flights(controller: str) -> None:
    """Real ones hover with 49 to 59 thousand; PWM times voltage is given by weight and motors."""
    flight = hover(controller)
    pwm, drone = flight.simulator.cascades["pwm"][0], flight.simulator.drones[0]
    volts = math.sqrt(airframe.HOVER_THRUST / powertrain.THRUST_PER_SQUARED_VOLTAGE)
    assert pwm == pytest.approx(65535 * volts / drone["voltage"], rel=0.01)
    assert 49_000 < pwm.mean() < 59_000


def test_the_voltage_falls_under_load_and_recovers_after_it() -> None:
    """Over the recorded flights it falls by 0.55 to 0.75 V."""
    flight = Flight(controller="pid")
    resting = flight.simulator.drones["voltage"][0]
    flight.rise()
    loaded = flight.simulator.drones["voltage"][0]
    assert 0.5 < resting - loaded < 0.75
    flight.order(Order.STOP)
    flight.fly(2.0)
    assert resting - flight.simulator.drones["voltage"][0] < 0.15


def test_the_pid_holds_its_height_while_the_battery_empties() -> None:
    flight = hover("pid", endurance=90.0)
    before = flight.simulator.cascades["pwm"][0].mean()
    flight.fly(50.0)
    assert flight.simulator.cascades["pwm"][0].mean() > 1.03 * before
    assert flight.position[0, 2] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("earlier", "error"), [(True, -0.115), (False, 0.0)])
def test_mellinger_hovers_a_decimetre_low_with_earlier_firmware(
    *, earlier: bool, error: float
) -> None:
    flight = hover("mellinger", earlier=earlier)
    assert flight.position[0, 2] - 1.0 == pytest.approx(error, abs=0.035)


def test_on_board_trajectories_lag_under_pid_but_not_mellinger() -> None:
    error = {}
    for controller in ("ideal", *CONTROLLERS):
        flight = hover(controller)
        flight.order(Order.GOTO, (2.0, 0.0, 1.0), duration=4.0)
        flight.fly(2.0)
        reference = flight.simulator.drones["reference_position"][0, 0]
        error[controller] = reference - flight.position[0, 0]
    assert 0.3 < error["pid"] < 0.6  # half a second at up to 1.1 m/s
    assert abs(error["mellinger"]) < 0.15
    assert abs(error["ideal"]) < 0.15


def test_a_manual_setpoint_is_flown_at_its_tilt_and_thrust() -> None:
    flight = hover("pid", 2.0)
    drone = flight.simulator.drones[0]
    drone["mode"], drone["axes"], drone["tilt"] = DEMAND, (FREE, FREE, SPEED), (0.0, 0.1)
    drone["reference_velocity"] = 0.0
    flight.fly(1.0)
    assert flight.simulator.cascades["angles"][0] == pytest.approx([0.0, 0.1], abs=0.03)
    assert flight.telemetry.velocity[0, 0] > 0.5


@pytest.mark.parametrize(
    ("controller", "yaw", "most"),
    [("pid", 1.0, 0.05), ("mellinger", 1.0, 0.05), ("ideal", 3.0, 0.01)],
)
def test_a_yaw_setpoint_is_followed(controller: str, yaw: float, most: float) -> None:
    flight = hover(controller)
    flight.fly(4.0, (0, 0, 0), yaw=yaw)
    assert flight.simulator.drones["believed_yaw"][0] == pytest.approx(yaw, abs=most)


def test_the_first_flight_completes_with_mellingers_law_too() -> None:
    registry = Registry()
    summary = fly(load(FIRST_FLIGHT, registry, ["transport.controller=mellinger"]), registry)
    assert summary["outcome"] == "completed"
    assert sum(summary["collisions"].values()) == 0


def test_the_motors_voltage_inverts_the_firmwares_thrust() -> None:
    for volts in np.linspace(0.8, 4.0, 30):
        thrust = np.polynomial.polynomial.polyval(volts, powertrain.FIRMWARE_THRUST)
        command = 65535 * thrust / powertrain.FIRMWARE_THRUST_MAX
        assert motor_voltage(float(command)) == pytest.approx(volts, abs=1e-4)
    assert motor_voltage(6999.0) == 0.0  # less than FIRMWARE_THRUST_MIN


def test_motors_are_lowered_together_to_avoid_saturation() -> None:
    flight = hover("pid", 3.0, battery=0.3)
    pwm = []
    for _ in range(50):
        flight.fly(CYCLE, (0.0, 0.0, 5.0), yaw=2.0)  # climbs and turns as hard as it can
        pwm.append(flight.simulator.cascades["pwm"][0].copy())
    greatest = np.max(pwm, axis=1)
    assert greatest.max() == pytest.approx(65535.0, abs=1e-6)
    assert (np.array(pwm)[greatest > 65534.0].min(axis=1) < 60000.0).any()


def test_a_full_state_levels_and_locks_in_silence_as_a_velocity() -> None:
    flight = hover("mellinger")
    still, on = np.zeros((1, 3)), np.ones(1, np.bool_)
    moves, position = np.array([[0.6, 0.0, 0.0]]), flight.position.copy()
    for _ in range(150):
        position += flight.period * moves
        flight.simulator.send(Setpoint(moves, np.zeros(1), on, position, still))
        flight.fly(flight.period)
    assert flight.position[0] == pytest.approx(position[0], abs=0.12)
    assert flight.telemetry.velocity[0, 0] == pytest.approx(0.6, abs=0.1)
    flight.fly(1.5)
    assert abs(flight.telemetry.velocity[0, 0]) < 0.1
    flight.fly(1.0)
    assert Supervisor.LOCKED in flight.state()
