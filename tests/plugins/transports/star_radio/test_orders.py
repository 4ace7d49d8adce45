"""Every packet, byte by byte, so that another version of cflib cannot change one unnoticed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cflib.crazyflie.mem.trajectory_memory import Poly4D
from hypothesis import given
from hypothesis import strategies as st

from star_core import Trajectory
from star_radio import orders
from star_radio.connection import packets
from star_radio.connection.cflib_link import silence_cflib
from star_radio.trajectories import packed

P = (1.0, -2.0, 0.5)
A = (0.25, 0.0, -0.5)
Q = (0.0, 0.0, math.sin(0.25), math.cos(0.25))


def test_packets_are_those_of_the_firmware() -> None:
    silence_cflib()
    for packet, expected in (
        (orders.velocity(P, 0.5, 12), "7c080000803f000000c00000003fe12ee541"),
        (orders.velocity(P, 0.5, 8), "7c010000803f000000c00000003fe12ee5c1"),
        (
            orders.full_state(P, P, A, Q, (0, 0, 0.25)),
            "7c06e80330f8f401e80330f8f401fa0000000cfeb30000c000000000fa00",
        ),
        (orders.no_more_setpoints(), "7d0000000000"),
        (orders.takeoff(0.5, 2.0), "8c07000000003f000000000100000040"),
        (orders.land(0.0, 2.0), "8c080000000000000000000100000040"),
        (orders.go_to(P, 0.5, 2.0, 7), "8c0400000000803f000000c00000003f0000003f00000040"),
        (orders.go_to(P, 0.5, 2.0, 12), "8c0c0000000000803f000000c00000003f0000003f00000040"),
        (orders.stop(), "8c0300"),
        (orders.set_groups(0b101), "8c0005"),
        (orders.only_for(0x80, orders.takeoff(0.5, 2.0)), "8c07800000003f000000000100000040"),
        (orders.define_trajectory(3, 2, 132), "8c060301008400000002"),
        (orders.start_trajectory(3, 9, stretch=1.5, relative=True), "8c05000100030000c03f"),
        (orders.start_trajectory(3, 12, stretch=1.5, relative=True), "8c0d00010000030000c03f"),
        (orders.arm(11), "dc0101"),
        (orders.arm(12), "9d0101"),
        (orders.emergency_stop(11), "6d03"),
        (orders.emergency_stop(12), "9d03"),
        (orders.keep_alive(11), "6d04"),
        (orders.keep_alive(12), "9d04"),
        (orders.measured_position(P), "6c0000803f000000c00000003f"),
        (
            orders.measured_pose(P, Q),
            "6d080000803f000000c00000003f000000000000000077577d3ea50a783f",
        ),
        (orders.POSITIONS.packet([orders.pose_entry(7, P)]), "6e07e80330f8f401"),
        (orders.POSES.packet([orders.pose_entry(7, P, Q)]), "6d0907e80330f8f401b30000c0"),
    ):
        assert packet.hex() == expected


def test_pieces_of_a_trajectory() -> None:
    numbers = np.linspace(-4, 4, 32).reshape(4, 8)
    axes = [Poly4D.Poly(list(axis)) for axis in numbers]
    ours = packed(Trajectory(np.full(2, 2.5), np.stack([numbers] * 2)))
    assert ours == bytes(Poly4D(2.5, *axes).pack()) * 2


def test_a_packet_that_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="expected at most 30 bytes of payload, got 31"):
        packets.packet(5, 1, bytes(31))


@given(st.floats(0.01, 3.0))
def test_periods_are_whole_steps_of_ten_milliseconds(period: float) -> None:
    steps = packets.start_block(1, period)[-1]
    assert steps == min(255, round(period * 100))
