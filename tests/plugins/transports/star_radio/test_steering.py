"""Whole states move along with what is to be flown, and stay near the drones."""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Sequence

import numpy as np
import pytest
from cflib.utils.encoding import decompress_quaternion

from star_core import Array, Setpoint
from star_radio import orders, report
from star_radio.steering import (
    GAIN,
    MAX_LEAD,
    MAX_YAW_LEAD,
    MAX_YAW_RATE,
    SETPOINT_TIMEOUT,
    Velocities,
    WholeStates,
)
from tests.plugins.transports.star_radio.conftest import Open
from tests.plugins.transports.star_radio.peer import Peer

TICK = 0.05  # s
KIND, VELOCITY = 6, 8  # first bytes of such packets


class Flown:
    """Whole states of one drone, a tick apart."""

    def __init__(self) -> None:
        self.time = 100.0  # s
        self._states = WholeStates(1, TICK, lambda: self.time)

    def tick(self, setpoint: Setpoint, reported: Array) -> dict[int, bytes]:
        packets = self._states.packets(setpoint, reported, [12])
        self.time += TICK
        return packets


@pytest.fixture
def states() -> Flown:
    return Flown()


def setpoint(velocity: Sequence[float], yaw: float = 0.0, *, active: bool = True) -> Setpoint:
    return Setpoint(np.array([velocity]), np.array([yaw]), np.array([active]))


def at(position: Sequence[float], yaw: float = 0.0) -> Array:
    """What one drone reports."""
    reported = np.zeros((1, len(report.SOURCES)))
    reported[0, [report.X, report.Y, report.Z]] = position
    reported[0, report.YAW] = yaw
    return reported


def told(packet: bytes) -> tuple[list[float], list[float], float, float]:
    """Position, velocity, heading and yaw rate of a whole state, in m and rad."""
    kind, *values = struct.unpack("<BhhhhhhhhhIhhh", packet[1:])
    assert kind == KIND
    metres = [value / 1000 for value in values[:9]]
    assert metres[6:] == [0, 0, 0]
    assert values[10:12] == [0, 0]
    x, y, z, w = decompress_quaternion(values[9])
    assert math.hypot(x, y) == 0
    return metres[:3], metres[3:6], 2 * math.atan2(z, w), values[12] / 1000


def test_it_begins_where_the_drone_is_and_looks(states: Flown) -> None:
    packets = states.tick(setpoint([0.3, 0, 0], 1.0), at([1, 2, 0.8], 1.0))
    position, velocity, yaw, rate = told(packets[0])
    assert position == [1, 2, 0.8]
    assert velocity == [0.3, 0, 0]
    assert yaw == pytest.approx(1.0, abs=0.01)
    assert rate == 0


def test_it_moves_at_what_was_to_be_flown(states: Flown) -> None:
    for velocity in ([0.3, 0, 0], [0, 0.2, 0.1]):
        states.tick(setpoint(velocity), at([1, 2, 0.8]))
    position, velocity, *_ = told(states.tick(setpoint([0, 0, 0]), at([1, 2, 0.8]))[0])
    assert position == pytest.approx([1 + 0.3 * TICK, 2 + 0.2 * TICK, 0.8 + 0.1 * TICK])
    assert velocity == [0, 0, 0]


def test_it_does_not_run_away_from_a_drone_that_cannot_follow(states: Flown) -> None:
    for _tick in range(40):
        packets = states.tick(setpoint([0.6, 0.8, 0]), at([1, 2, 0.8]))
    position, *_ = told(packets[0])
    assert position == pytest.approx([1 + 0.6 * MAX_LEAD, 2 + 0.8 * MAX_LEAD, 0.8], abs=1e-3)


def test_it_holds_a_place_against_drift(states: Flown) -> None:
    for drift in (0.0, 0.05, 0.1):
        packets = states.tick(setpoint([0, 0, 0]), at([1 + drift, 2, 0.8]))
    assert told(packets[0])[0] == [1, 2, 0.8]


def test_it_turns_as_a_velocity_would_have_it(states: Flown) -> None:
    states.tick(setpoint([0, 0, 0], 0.2), at([0, 0, 1]))
    _, _, yaw, rate = told(states.tick(setpoint([0, 0, 0], 0.2), at([0, 0, 1]))[0])
    turned = GAIN * 0.2 * TICK
    assert yaw == pytest.approx(turned, abs=0.003)  # a packed quaternion's parts are of 1/723
    assert rate == pytest.approx(GAIN * (0.2 - turned), abs=1e-3)
    _, _, _, rate = told(states.tick(setpoint([0, 0, 0], 3.0), at([0, 0, 1]))[0])
    assert rate == MAX_YAW_RATE


def test_heading_setpoints_stay_near_a_drone_that_cannot_turn(states: Flown) -> None:
    for _tick in range(40):
        packets = states.tick(setpoint([0, 0, 0], 2.5), at([0, 0, 1], 0.2))
    assert told(packets[0])[2] == pytest.approx(0.2 + MAX_YAW_LEAD, abs=0.003)


def test_it_turns_on_across_the_back(states: Flown) -> None:
    for _tick in range(2):
        packets = states.tick(setpoint([0, 0, 0], -3.0), at([0, 0, 1], 3.1))
    turned = 3.1 + GAIN * (math.tau - 6.1) * TICK
    assert math.remainder(told(packets[0])[2] - turned, math.tau) == pytest.approx(0, abs=0.003)


def test_what_was_flown_long_ago_leads_nowhere(states: Flown) -> None:
    states.tick(setpoint([0.3, 0, 0]), at([0, 0, 0.8]))
    states.time += SETPOINT_TIMEOUT - TICK
    position, *_ = told(states.tick(setpoint([0, 0.3, 0]), at([0.4, 0, 0.8]))[0])
    assert position == [0.4, 0, 0.8]


def test_an_agent_that_was_not_flown_for_a_tick_begins_anew(states: Flown) -> None:
    states.tick(setpoint([0.3, 0, 0]), at([1, 2, 0.8]))
    assert states.tick(setpoint([0, 0, 0], active=False), at([1, 2, 0.8])) == {}
    packets = states.tick(setpoint([0.3, 0, 0]), at([1.1, 2, 0.8]))
    assert told(packets[0])[0] == [1.1, 2, 0.8]


@pytest.mark.parametrize("lost", [[math.nan] * 3, [33.0, 0, 0], [1e6, 0, 0]])
def test_unencodable_positions_are_flown_by_velocity(states: Flown, lost: list[float]) -> None:
    command = setpoint([0.3, 0, 0])
    states.tick(command, at([1, 2, 0.8]))
    packets = states.tick(command, at(lost))
    assert packets == Velocities(1, 0.05).packets(command, at(lost), [12])
    assert packets == {0: orders.velocity([0.3, 0, 0], 0.0, 12)}
    assert told(states.tick(command, at([1, 2, 0.8]))[0])[0] == [1, 2, 0.8]


def test_a_mission_has_drones_flown_so(drone: Peer, make: Open) -> None:
    drone.values |= {"stateEstimateZ.x": 500, "stateEstimateZ.z": 800}
    radio = make([drone.uri], setpoints="full-state")
    radio.connect()
    radio.wait(0.0)
    radio.receive()
    radio.send(setpoint([0.1, 0.2, 0.3]))
    assert drone.until(lambda: bool(drone.sent_to(7, 0)))
    position, velocity, _, rate = told(b"\x70" + drone.sent_to(7, 0)[0])
    assert (position, velocity, rate) == ([0.5, 0, 0.8], [0.1, 0.2, 0.3], 0)


def along(velocity: Sequence[float], acceleration: Sequence[float], x: float) -> Setpoint:
    """A setpoint of an agent on a trajectory that turns by 0.4 rad/s."""
    return dataclasses.replace(
        setpoint(velocity),
        position=np.array([[x, 2.0, 0.8]]),
        acceleration=np.array([acceleration]),
        yaw_rate=np.array([0.4]),
    )


def test_states_of_trajectories_are_ahead_with_their_acceleration(states: Flown) -> None:
    states.tick(setpoint([0, 0, 0]), at([1, 2, 0.8]))
    packet = states.tick(along([0.5, 0, 0], [1.5, 0, 0], 1.02), at([1, 2, 0.8]))[0]
    _, *values = struct.unpack("<BhhhhhhhhhIhhh", packet[1:])
    ahead = 0.06 + TICK / 2
    assert values[0] == pytest.approx(1000 + 500 * ahead, abs=1)  # mm, from where it was sent
    assert values[3] == pytest.approx(500 + 1500 * ahead, abs=1)
    assert values[6:9] == [1500, 0, 0]
    assert values[12] == 400
    position, *_ = told(states.tick(setpoint([0, 0, 0]), at([1, 2, 0.8]))[0])
    assert position[0] == pytest.approx(1 + 0.5 * TICK, abs=1e-3)  # goes on from there


def test_velocities_of_trajectories_make_up_for_the_lag() -> None:
    velocities = Velocities(1, TICK)
    command = along([0.5, 0, 0], [1.5, 0, 0], 1.02)
    packet = velocities.packets(command, at([1, 2, 0.8]), [12])[0]
    kind, vx, vy, _, rate = struct.unpack("<Bffff", packet[1:])
    assert (kind, vy) == (VELOCITY, 0.0)
    assert vx == pytest.approx(0.5 + 1.5 * (0.04 + TICK / 2 + 1 / 4.574), abs=1e-3)
    assert rate == pytest.approx(math.degrees(0.4), abs=1e-3)
