"""Setpoints of every format: what they ask for, with which sign, and that it is flown."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest

from star_fleet.packet import Port, compress
from star_fleet.setpoints import Demand, Sticks, decode
from star_sim.drone import FREE, POSITION
from tests.plugins.commands.star_fleet.conftest import Bench, Start

ANGLES = {"althold": 0, "poshold": 0, "posSet": 0, "stabModeRoll": 1, "stabModePitch": 1}
HALF_TURN_LEFT = math.radians(90)


def decoded(form: str, *values: Any) -> Demand:
    demand = decode(struct.pack("<" + form, *values))
    assert demand is not None
    return demand


def test_a_velocity_is_flown_along_the_odometry_frame(aloft: Bench) -> None:
    aloft.fly(2.0, "Bffff", 8, 0.3, -0.2, 0.1, 0.0)
    velocity = aloft.log("stateEstimate.vx", "stateEstimate.vy", "stateEstimate.vz")
    assert velocity == pytest.approx((0.3, -0.2, 0.1), abs=0.03)


def test_yaw_rates_are_clockwise_in_old_setpoint_formats_only(aloft: Bench) -> None:
    aloft.fly(1.0, "Bffff", 8, 0.0, 0.0, 0.0, 45.0)
    (left,) = aloft.log("stateEstimate.yaw")
    assert 25 < left < 50
    aloft.fly(2.0, "Bffff", 1, 0.0, 0.0, 0.0, 45.0)
    assert aloft.log("stateEstimate.yaw")[0] < left - 50


def test_a_turn_does_not_outrun_the_vehicle(aloft: Bench) -> None:
    aloft.fly(2.0, "Bffff", 8, 0.0, 0.0, 0.0, 4000.0)
    assert aloft.log("gyro.z")[0] == pytest.approx(math.degrees(2.0), abs=5)
    aloft.fly(3.0, "Bffff", 8, 0.0, 0.0, 0.0, 0.0)
    assert aloft.log("gyro.z")[0] == pytest.approx(0.0, abs=1)


def test_a_hover_goes_ahead_and_holds_its_height(aloft: Bench) -> None:
    aloft.go(0.0, 0.0, 0.8, HALF_TURN_LEFT)
    aloft.fly(3.0)
    aloft.fly(3.0, "Bffff", 10, 0.3, 0.0, 0.0, 1.2)
    vx, vy, z = aloft.log("stateEstimate.vx", "stateEstimate.vy", "stateEstimate.z")
    assert (vx, vy) == pytest.approx((0.0, 0.3), abs=0.03)
    assert z == pytest.approx(1.2, abs=0.03)


def test_a_position_is_flown_to_and_its_yaw_is_in_degrees(aloft: Bench) -> None:
    aloft.fly(4.0, "Bffff", 7, 0.3, 0.2, 1.0, 90.0)
    assert aloft.position == pytest.approx([0.3, 0.2, 1.0], abs=0.03)
    assert aloft.log("stateEstimate.yaw")[0] == pytest.approx(90, abs=1)


def test_full_state_is_in_millimetres_with_a_yaw_quaternion(aloft: Bench) -> None:
    yaw = math.radians(60)
    packed = int(compress(np.array([[0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]]))[0])
    values = (6, 300, -200, 900, 0, 0, 0, 0, 0, 0, packed, 0, 0, 0)
    aloft.fly(4.0, "B9hI3h", *values)
    assert aloft.position == pytest.approx([0.3, -0.2, 0.9], abs=0.03)
    assert aloft.log("stateEstimate.yaw")[0] == pytest.approx(60, abs=1)


def test_the_rates_of_a_full_state_are_not_flown() -> None:
    state = (6, 300, -200, 900, 10, 20, 30, 40, 50, 60, 3 << 30)
    assert decoded("B9hI3h", *state, 1500, -1500, 20_000) == decoded("B9hI3h", *state, 0, 0, 0)


def test_a_pitch_is_nose_up_positive_and_a_roll_is_to_the_right(aloft: Bench) -> None:
    aloft.fly(1.0, "Bffff", 9, 4.0, -5.0, 0.0, 0.8)
    roll, pitch, z = aloft.log("stateEstimate.roll", "stateEstimate.pitch", "stateEstimate.z")
    assert (roll, pitch) == pytest.approx((4.0, -5.0), abs=0.7)
    assert z == pytest.approx(0.8, abs=0.05)
    assert aloft.position[0] > 0.1
    assert aloft.position[1] < -0.1


def test_a_climb_holds_a_tilt_and_a_vertical_speed(aloft: Bench) -> None:
    aloft.fly(1.5, "Bffff", 4, 0.0, 0.0, 0.0, 0.2)
    assert aloft.log("stateEstimate.vz")[0] == pytest.approx(0.2, abs=0.03)


def test_thrust_of_a_manual_setpoint_is_of_all_motors(aloft: Bench) -> None:
    aloft.fly(0.5, "BfffHB", 11, 0.0, 0.0, 0.0, 60000, 0)
    assert aloft.log("stateEstimate.vz")[0] > 0.3
    aloft.fly(0.05, "BfffHB", 11, 0.0, 0.0, 0.0, 0, 0)
    assert not aloft.turned


def test_a_rated_manual_setpoint_tilts_more_and_more(aloft: Bench) -> None:
    aloft.fly(0.5, "BfffHB", 11, 20.0, 0.0, 0.0, 43000, 1)
    roll = aloft.log("stateEstimate.roll")[0]
    assert roll == pytest.approx(10.0, abs=3)
    aloft.fly(0.25, "BfffHB", 11, 20.0, 0.0, 0.0, 43000, 1)
    assert aloft.log("stateEstimate.roll")[0] > roll + 3


def test_a_stop_setpoint_stops_the_motors(aloft: Bench) -> None:
    aloft.setpoint("B", 0)
    assert not aloft.turned


@pytest.mark.parametrize("payload", [b"", *(bytes([kind, *[0] * 16]) for kind in (3, 12, 255))])
def test_a_format_that_is_unknown_asks_for_nothing(payload: bytes) -> None:
    assert decode(payload) is None


@pytest.mark.parametrize("kind", [1, 2, 4, 5, 6, 7, 8, 9, 10, 11])
def test_short_or_nonfinite_setpoints_are_ignored(kind: int) -> None:
    assert decode(bytes([kind]) + bytes(9)) is None
    if kind != 6:
        assert decode(struct.pack("<B4f", kind, math.nan, 0, 0, 0)) is None


def test_levelling_out_keeps_height_and_frees_other_axes() -> None:
    level = decoded("B4f", 10, 1.0, 2.0, 30.0, 0.7).levelled()
    assert level.axes == (FREE, FREE, POSITION)
    assert level.position[2] == pytest.approx(0.7)
    assert (level.tilt, level.turn_rate) == ((0.0, 0.0), 0.0)


def test_thrust_from_a_hand_is_locked_until_there_was_none() -> None:
    sticks = Sticks()

    def push(thrust: int) -> Demand:
        demand = sticks.decode(struct.pack("<fffH", 0, 0, 0, thrust), ANGLES)
        assert demand is not None
        return demand

    assert push(40000).stops
    assert push(0).stops
    assert not push(40000).stops
    assert push(999).stops
    assert push(65535) == push(60000)


def test_flight_modes_give_the_sticks_another_meaning() -> None:
    payload = struct.pack("<fffH", 15.0, 30.0, 90.0, 49150)

    def of(**modes: int) -> Demand:
        demand = Sticks().decode(payload, ANGLES | modes)
        assert demand is not None
        return demand

    assert of(althold=1).velocity[2] == pytest.approx(0.5, abs=0.01)
    assert of(poshold=1, althold=1).velocity == pytest.approx((1.0, 0.5, 0.5), abs=0.01)
    assert of(posSet=1).position == pytest.approx((-30.0, 15.0, 49.15))
    assert of(posSet=1).yaw == pytest.approx(math.pi / 2)
    assert of().tilt == pytest.approx((math.radians(15), -math.radians(30)))
    assert of(stabModeRoll=0).tilt_rate == pytest.approx((math.radians(15), 0.0))


def test_sticks_fly_a_vehicle(aloft: Bench) -> None:
    aloft.ask(Port.ATTITUDE, 0, struct.pack("<fffH", 0, 0, 0, 0))
    for _ in range(10):
        aloft.ask(Port.ATTITUDE, 0, struct.pack("<fffH", 0, 0, 0, 50000))
        aloft.fly(0.05)
    assert aloft.turned
    assert aloft.log("stateEstimate.vz")[0] > 0.1


def test_the_parameter_of_the_controller_selects_what_flies(start: Start) -> None:
    """PID trails a moving full state by half a second, Mellinger's law does not."""
    level = int(compress(np.array([[0.0, 0.0, 0.0, 1.0]]))[0])
    behind = {}
    for number in (1, 2):
        bench = start(controller="pid")
        bench.write("stabilizer.controller", "B", number)
        bench.takeoff(0.8, 2.0)
        bench.fly(6.0)
        for k in range(300):
            state = (round(5 * k), 0, 800, 500, 0, 0, 0, 0, 0, level, 0, 0, 0)
            bench.fly(0.01, "B9hI3h", 6, *state)
        behind[number] = 5e-3 * 299 - bench.log("stateEstimate.x")[0]
        assert 49_000 < bench.log("motor.m1")[0] < 59_000
    assert 0.2 < behind[1] < 0.33
    assert abs(behind[2]) < 0.1
