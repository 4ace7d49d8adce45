"""What the on-board commander and the supervisor do, as a runner relies on it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import polynomial

from star_core import ContractError, Order, Supervisor
from star_sim.commander import ending_at_rest
from star_sim.pieces import HOVER_TIME
from tests.plugins.transports.star_sim.conftest import Flight, hovering

some = st.floats(-2, 2)


@given(start=some, velocity=some, acceleration=some, end=some, duration=st.floats(0.5, 5))
def test_a_trajectory_starts_as_it_is_and_ends_at_rest(
    start: float, velocity: float, acceleration: float, end: float, duration: float
) -> None:
    each = [np.array([value]) for value in (start, velocity, acceleration, end, duration)]
    coefficients = ending_at_rest(*each)[0]

    def derivative(order: int, at: float) -> float:
        value = polynomial.polyval(at, polynomial.polyder(coefficients, order))
        return float(value) / duration**order

    begins = [derivative(order, 0.0) for order in range(4)]
    ends = [derivative(order, 1.0) for order in range(4)]
    assert begins == pytest.approx([start, velocity, acceleration, 0.0], abs=1e-9)
    scale = 1 + duration**-3 * 1e3
    assert ends == pytest.approx([end, 0.0, 0.0, 0.0], abs=1e-9 * scale)


def test_a_go_to_reaches_its_point_and_heading() -> None:
    flight = hovering()
    flight.order(Order.GOTO, (1.0, -0.5, 1.2), yaw=1.0, duration=3.0)
    flight.fly(8.0)
    assert flight.position[0] == pytest.approx([1.0, -0.5, 1.2], abs=0.02)
    assert 2 * np.arctan2(*flight.telemetry.attitude[0, 2:]) == pytest.approx(1.0, abs=0.01)


def test_a_go_to_turns_the_short_way() -> None:
    flight = hovering()
    flight.order(Order.GOTO, (0, 0, 0.8), yaw=3.0)
    flight.fly(3.0)
    flight.order(Order.GOTO, (0, 0, 0.8), yaw=-3.0)
    for heard in flight.fly(3.0):
        assert abs(2 * np.arctan2(heard.attitude[0, 2], heard.attitude[0, 3])) > 2.9


def test_a_take_off_is_over_when_the_commander_has_finished() -> None:
    flight = Flight()
    assert Supervisor.COMMANDER_FINISHED not in flight.state()
    flight.order(Order.TAKEOFF, (0, 0, 0.8), duration=2.0)
    flight.fly(1.9)
    assert Supervisor.COMMANDER_ACTIVE in flight.state()
    assert Supervisor.COMMANDER_FINISHED not in flight.state()
    flight.fly(0.2)
    assert Supervisor.COMMANDER_FINISHED | Supervisor.FLYING in flight.state()


def test_an_order_clears_finished_at_once() -> None:
    flight = hovering()
    flight.order(Order.GOTO, (1, 0, 0.8))
    state = Supervisor(int(flight.simulator.receive().state[0]))
    assert Supervisor.COMMANDER_FINISHED not in state


def test_landing_stops_motors_then_clears_flying_after_2_s() -> None:
    flight = hovering()
    flight.order(Order.LAND, (0, 0, 0.03))
    flight.fly(2.1)
    assert Supervisor.COMMANDER_FINISHED | Supervisor.FLYING in flight.state()
    flight.fly(1.8)
    assert Supervisor.FLYING in flight.state()
    flight.fly(0.2)
    assert Supervisor.FLYING not in flight.state()
    assert flight.position[0, 2] == 0.0
    assert flight.simulator.drones["thrust"].max() < 1e-6


def test_a_drone_takes_off_again_after_landing() -> None:
    flight = Flight()
    for _ in range(2):
        flight.rise()
        assert flight.position[0, 2] == pytest.approx(0.8, abs=0.02)
        flight.order(Order.LAND, (0, 0, 0.03))
        flight.fly(5.0)
        assert flight.position[0, 2] == 0.0


def test_moving_drones_land_where_the_command_reached_them() -> None:
    flight = hovering()
    flight.fly(2.0, (0.4, 0, 0))
    was = flight.position[0, 0]
    flight.order(Order.LAND, (0, 0, 0.03), duration=3.0)
    flight.fly(6.0)
    assert flight.position[0] == pytest.approx([was, 0.0, 0.0], abs=0.05)


def test_setpoints_and_orders_take_over_from_each_other() -> None:
    flight = hovering()
    flight.order(Order.GOTO, (0, 5, 0.8), duration=10.0)
    flight.fly(1.0, (0.3, 0, 0))
    assert Supervisor.COMMANDER_ACTIVE not in flight.state()
    assert Supervisor.COMMANDER_FINISHED in flight.state()
    assert flight.telemetry.velocity[0, 0] > 0.2
    flight.order(Order.GOTO, (0, 0, 0.8), duration=3.0)
    flight.fly(6.0)
    assert Supervisor.COMMANDER_ACTIVE in flight.state()
    assert flight.position[0] == pytest.approx([0, 0, 0.8], abs=0.02)


def test_a_silent_link_levels_the_drone_after_half_a_second() -> None:
    flight = hovering()
    flight.fly(3.0, (0.4, 0, 0))
    flight.fly(0.4)
    assert flight.telemetry.velocity[0, 0] == pytest.approx(0.4, abs=0.05)
    flight.fly(1.4)
    assert abs(flight.telemetry.velocity[0, 0]) < 0.1
    assert Supervisor.LOCKED not in flight.state()


def test_two_seconds_without_a_link_drop_and_lock_the_drone() -> None:
    flight = hovering()
    flight.fly(1.0, (0, 0, 0))
    flight.fly(1.9)
    assert Supervisor.LOCKED not in flight.state()
    flight.fly(0.2)
    assert Supervisor.LOCKED in flight.state()
    assert Supervisor.CAN_FLY not in flight.state()
    flight.fly(2.0)
    assert flight.position[0, 2] == 0.0
    flight.rise()
    flight.fly(1.0, (0, 0, 0.5))
    assert flight.position[0, 2] == 0.0


def test_the_commander_hovers_on_after_a_go_to() -> None:
    flight = hovering()
    flight.fly(10.0)
    assert flight.position[0, 2] == pytest.approx(0.8, abs=0.01)


@pytest.mark.parametrize("controller", ["ideal", "pid", "mellinger"])
def test_a_take_off_that_nothing_takes_over_comes_down(controller: str) -> None:
    flight = Flight(controller=controller)
    flight.order(Order.TAKEOFF, (0, 0, 0.8), duration=2.0)
    flight.fly(2.0 + HOVER_TIME)
    assert flight.position[0, 2] == pytest.approx(0.8, abs=0.15)
    speeds = [heard.velocity[0, 2] for heard in flight.fly(6.0) if heard.position[0, 2] > 0.01]
    assert speeds[-1] > -0.4
    assert flight.position[0, 2] == 0.0
    state = Supervisor.COMMANDER_ACTIVE | Supervisor.COMMANDER_FINISHED | Supervisor.FLYING
    assert state in flight.state()  # its motors stay on


def test_a_landing_stops_the_motors_after_a_descent() -> None:
    flight = Flight()
    flight.order(Order.TAKEOFF, (0, 0, 0.8), duration=2.0)
    flight.fly(10.0)
    flight.order(Order.LAND, (0, 0, 0.0), duration=2.5)
    flight.fly(5.0)
    assert flight.position[0, 2] == 0.0
    assert Supervisor.FLYING not in flight.state()


@pytest.mark.parametrize("after", [2.5, 5.5])
def test_setpoints_take_over_from_hover_and_descent(after: float) -> None:
    flight = Flight()
    flight.order(Order.TAKEOFF, (0, 0, 0.8), duration=2.0)
    flight.fly(after)
    top = flight.position[0, 2]
    flight.fly(10.0, velocity=(0, 0, 0))
    assert flight.position[0, 2] == pytest.approx(top, abs=0.12)


def test_a_take_off_is_over_during_its_descent() -> None:
    flight = Flight()
    flight.order(Order.TAKEOFF, (0, 0, 0.8), duration=2.0)
    flight.fly(2.0)
    assert all(Supervisor.COMMANDER_FINISHED in Supervisor(int(t.state[0])) for t in flight.fly(8))


def test_stop_drops_a_drone_and_locks_nothing() -> None:
    flight = hovering()
    flight.order(Order.STOP)
    flight.fly(1.0)
    assert flight.position[0, 2] == 0.0
    assert Supervisor.LOCKED not in flight.state()
    flight.rise()
    assert flight.position[0, 2] == pytest.approx(0.8, abs=0.02)


def test_an_order_is_for_the_rows_it_names() -> None:
    flight = Flight(3)
    flight.order(Order.TAKEOFF, (0, 0, 0.8), rows=[2, 0])
    flight.fly(4.0)
    assert flight.position[:, 2] == pytest.approx([0.8, 0.0, 0.8], abs=0.02)


def test_inactive_rows_of_a_setpoint_are_not_flown() -> None:
    flight = hovering(2)
    flight.fly(2.0, (0.3, 0, 0), rows=[1])
    assert flight.position[0, 0] == pytest.approx(-0.5, abs=0.01)
    assert flight.position[1, 0] > 0.8


def test_a_brushed_crazyflie_is_armed_and_can_fly() -> None:
    flight = Flight()
    flight.order(Order.ARM)
    armed = Supervisor.CAN_ARM | Supervisor.ARMED | Supervisor.AUTO_ARM | Supervisor.CAN_FLY
    assert flight.state() == armed


def test_a_drone_that_tumbles_in_flight_has_crashed() -> None:
    flight = hovering(height=1.5)
    flight.simulator.drones["attitude"] = [1.0, 0.0, 0.0, 0.0]  # upside down
    flight.simulator.drones["rates"] = [0.0, 0.0, 0.0]
    flight.fly(1.0)
    assert Supervisor.CRASHED in flight.state()
    assert Supervisor.CAN_FLY not in flight.state()
    flight.rise()
    assert flight.position[0, 2] == 0.0


def test_a_setpoint_that_is_not_finite_is_refused_by_name() -> None:
    with pytest.raises(ContractError, match="the setpoint of cf1, cf2 is not finite"):
        Flight(2).fly(0.1, (np.nan, 0, 0))


def test_what_is_not_sent_may_be_anything() -> None:
    flight = Flight(2)
    flight.fly(0.1, [(np.nan, 0, 0), (0, 0, 0)], rows=[1])
    assert np.isfinite(flight.position).all()
