"""Trajectories that simulated drones fly on their own, piece by piece."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import polynomial

from star_core import Array, Command, ContractError, Order, Supervisor, Trajectory
from star_sim.airframe import NEVER
from star_sim.pieces import HOVER_TIME
from tests.plugins.transports.star_sim.conftest import Flight, hovering


def rest_to_rest(start: Sequence[float], end: Sequence[float], duration: float) -> Array:
    """(4, 8) coefficients over the time that stand still at both ends, of fifth degree."""
    way = np.subtract(end, start)
    coefficients = np.zeros((4, 8))
    coefficients[:, 0] = start
    for power, factor in ((3, 10), (4, -15), (5, 6)):
        coefficients[:, power] = factor * way / duration**power
    return coefficients


def trajectory(*pieces: tuple[float, Array]) -> Trajectory:
    return Trajectory(
        np.array([duration for duration, _ in pieces]), np.array([piece for _, piece in pieces])
    )


# An L with corners at odd times, so that no piece begins with a cycle of 10 ms.
CORNER = trajectory(
    (2.0013, rest_to_rest([0, 0, 0, 0], [0.8, 0, 0.2, 0.5], 2.0013)),
    (1.6021, rest_to_rest([0.8, 0, 0.2, 0.5], [0.8, 0.6, 0.2, 0], 1.6021)),
)
# One motion cut in two where it is fastest.
WHOLE = rest_to_rest([0, 0, 0, 0], [1.0, 0.5, 0, 0], 4.0)
SECOND = np.array([polynomial.Polynomial(axis)(polynomial.Polynomial([2.0, 1.0])).coef for axis in
                   np.where(WHOLE == 0, 1e-300, WHOLE)])  # fmt: skip
CUT = trajectory((2.0, WHOLE), (2.0, SECOND))


def where(flown: Trajectory, time: float) -> Array:
    """(4,) where a trajectory is in its own frame."""
    i = min(int(np.searchsorted(np.cumsum(flown.duration), time)), len(flown.duration) - 1)
    since = min(time - flown.duration[:i].sum(), flown.duration[i])
    point: Array = polynomial.polyval(since, flown.coefficients[i].T)
    return point


def upload(flight: Any, *flown: Trajectory) -> None:
    flight.simulator.upload(flown)


def follow(
    flight: Any, flown: Trajectory, at: Sequence[float], yaw: float = 0.0, stretch: float = 1.0
) -> None:
    k = flight.n
    seconds = stretch * flown.duration.sum()
    flight.simulator.command(
        Command(
            Order.FOLLOW, np.arange(k), np.tile(at, (k, 1)), np.full(k, yaw), np.full(k, seconds),
            flown,
        )
    )  # fmt: skip


def following(
    seconds: float = 0.0,
    flown: Trajectory = CORNER,
    *,
    towards: float = 0.0,
    stretch: float = 1.0,
    **options: Any,
) -> Flight:
    """A swarm that has followed a trajectory for some time, from 0.8 m above its start.

    Args:
        seconds: That time.
        flown: The trajectory.
        towards: Yaw of its x axis in the odometry frame, rad.
        stretch: Of its duration.
        options: Of the swarm.
    """
    flight = hovering(**options)
    upload(flight, CORNER, CUT)
    follow(flight, flown, (0, 0, 0.8), towards, stretch)
    flight.fly(seconds)
    return flight


def references(flight: Any, seconds: float) -> tuple[Array, Array]:
    """Tick; return when and where the commander wanted the first drone to be: x, y, z, yaw."""
    times, places = [], []
    for _ in range(round(seconds / flight.period)):
        flight.fly(flight.period)
        drone = flight.simulator.drones[0]
        times.append(flight.simulator.time - 0.01)  # the last cycle began
        places.append([*drone["reference_position"], drone["reference_yaw"]])
    return np.array(times), np.array(places)


@pytest.mark.parametrize("stretch", [1.0, 1.7])
@pytest.mark.parametrize("flown", [CORNER, CUT], ids=["corner", "cut"])
def test_what_is_wanted_is_the_polynomial_at_every_time(flown: Trajectory, stretch: float) -> None:
    flight = following(flown=flown, stretch=stretch)
    begun = flight.simulator.time
    whole = stretch * flown.duration.sum()
    times, places = references(flight, whole + 0.5)
    expected = [where(flown, (time - begun) / stretch) for time in times]
    assert places - [0, 0, 0.8, 0] == pytest.approx(np.array(expected), abs=1e-9)


def test_the_drone_flies_it_through_its_boundaries() -> None:
    flight = following(flown=CUT)
    begun = flight.simulator.time
    off = []
    for _ in range(80):
        flight.fly(0.05)
        off.append(flight.position[0] - where(CUT, flight.simulator.time - begun)[:3])
    assert np.linalg.norm(np.array(off) - [0, 0, 0.8], axis=1).max() < 0.02


def test_it_lies_in_the_map_whatever_the_heading_at_the_start() -> None:
    flight = following(at=[(1.0, 2.0, 0.0)], yaw=2.0, towards=-2.0)
    flight.fly(6.0)
    assert flight.position[0] == pytest.approx([1.8, 2.6, 1.0], abs=0.02)
    half = flight.simulator.drones["attitude"][0, 2:]
    assert 2 * np.arctan2(*half) == pytest.approx(0.0, abs=0.02)


def test_follow_ends_with_the_commander_not_between_pieces() -> None:
    flight = following()
    heard = flight.fly(4.0)
    done = [bool(now.state[0] & int(Supervisor.COMMANDER_FINISHED)) for now in heard]
    first = done.index(True)
    assert heard[first].time - heard[0].time + 0.05 == pytest.approx(3.6034, abs=0.06)
    assert all(done[first:])
    assert Supervisor.COMMANDER_ACTIVE in flight.state()


def test_several_drones_fly_it_on_the_same_tick() -> None:
    flight = following(n=3)
    before = flight.position
    flight.fly(6.0)
    assert flight.position - before == pytest.approx(np.tile([0.8, 0.6, 0.2], (3, 1)), abs=0.02)


def test_a_landing_in_the_middle_takes_over_and_stays_down() -> None:
    flight = following(1.0)
    flight.order(Order.LAND, (0, 0, 0.03), duration=2.0)
    flight.fly(5.0)
    assert flight.position[0, 2] == 0.0
    assert flight.position[0, 0] < 0.6
    assert Supervisor.COMMANDER_FINISHED in flight.state()
    assert Supervisor.FLYING not in flight.state()


def test_a_stop_in_the_middle_stops_the_motors_for_good() -> None:
    flight = following(1.0)
    flight.order(Order.STOP)
    flight.fly(4.0)
    assert flight.position[0, 2] == 0.0
    assert flight.simulator.drones["thrust"].max() < 1e-6


def test_a_lock_in_the_middle_is_for_good() -> None:
    flight = following(1.0)
    flight.simulator.drones["mode"] = 0
    flight.simulator.drones["locked"] = 1
    flight.fly(4.0)
    assert flight.position[0, 2] == 0.0
    assert Supervisor.LOCKED in flight.state()


def test_a_setpoint_takes_over_and_no_later_piece_does() -> None:
    flight = following(1.0)
    flight.fly(3.0, (0, -0.3, 0))
    assert flight.telemetry.velocity[0] == pytest.approx([0, -0.3, 0], abs=0.05)
    assert Supervisor.COMMANDER_ACTIVE not in flight.state()


@pytest.mark.parametrize("then", [Order.GOTO, Order.TAKEOFF])
def test_another_order_in_the_same_tick_drops_what_is_left(then: Order) -> None:
    flight = following()
    flight.order(then, (0, 0, 1.2), duration=5.0)
    flight.fly(8.0)
    assert flight.position[0] == pytest.approx([0, 0, 1.2], abs=0.02)


def test_another_trajectory_takes_over() -> None:
    flight = following(1.0)
    follow(flight, CUT, (0, 0, 1.0))
    flight.fly(6.0)
    assert flight.position[0] == pytest.approx([1.0, 0.5, 1.0], abs=0.02)


def test_arming_drops_nothing() -> None:
    flight = following()
    flight.order(Order.ARM)
    flight.fly(6.0)
    assert flight.position[0] == pytest.approx([0.8, 0.6, 1.0], abs=0.02)


def test_an_agent_that_follows_nothing_costs_nothing() -> None:
    assert hovering().simulator._queue.next_step == NEVER
    flight = following(4.0)
    flight.hover()
    assert flight.simulator._queue.next_step == NEVER


def test_a_drone_lands_by_itself_after_a_trajectory() -> None:
    flight = following()
    flight.fly(CORNER.duration.sum() + HOVER_TIME)
    assert flight.position[0] == pytest.approx([0.8, 0.6, 1.0], abs=0.02)
    flight.fly(5.0)
    assert flight.position[0] == pytest.approx([0.8, 0.6, 0.0], abs=0.02)


def test_when_a_drone_comes_down_by_itself_is_announced() -> None:
    flight = Flight()
    flight.order(Order.TAKEOFF, (0, 0, 0.8))
    heights, announced = zip(
        *((report.position[0, 2], report.lands_by[0]) for report in flight.fly(12.0)), strict=True
    )
    down = flight.period * np.flatnonzero(np.array(heights) > 0.02)[-1]
    assert down <= announced[-1] <= down + 1.5
    flight.rise()
    assert np.isinf(flight.telemetry.lands_by[0])  # a go-to ends in the air
    upload(flight, CORNER)
    follow(flight, CORNER, (0, 0, 0.8))
    flight.fly(0.1)
    over = flight.telemetry.time + CORNER.duration.sum()
    assert over + HOVER_TIME < flight.telemetry.lands_by[0] < np.inf


def test_one_that_was_not_uploaded_is_refused() -> None:
    flight = hovering()
    upload(flight, CUT)
    with pytest.raises(ContractError, match=r"Command\.trajectory was not uploaded"):
        follow(flight, CORNER, (0, 0, 0.8))


def test_a_drone_that_crashed_follows_nothing() -> None:
    flight = Flight()
    flight.simulator.drones["crashed"] = 1
    upload(flight, CUT)
    follow(flight, CUT, (0, 0, 0.8))
    flight.fly(1.0)
    assert flight.position[0, 2] == 0.0
