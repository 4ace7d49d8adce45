"""Log blocks: what can be had, when it comes, and in which types."""

from __future__ import annotations

import errno
import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_fleet.packet import NULL, Port, expand
from star_fleet.variables import FLOAT, FORMAT, HALF, I8, I16, U16, VARIABLES, cast, cast_one
from star_sim.airframe import DRAG_XY, GRAVITY, MASS
from tests.plugins.commands.star_fleet.conftest import Bench, Start

NUMBER = {entry.name: i for i, entry in enumerate(VARIABLES)}


def variables(*entries: tuple[int, str]) -> bytes:
    return b"".join(struct.pack("<BH", code, NUMBER[name]) for code, name in entries)


def control(bench: Any, *parts: int, more: bytes = b"") -> int:
    (answer,) = bench.ask(Port.LOG, 1, bytes(parts) + more)
    assert answer[:2] == bytes(parts[:2]).ljust(2, b"\0")
    assert len(answer) == 3
    return int(answer[2])


def begin(bench: Bench, *variable: tuple[int, str], period: int = 1) -> None:
    """Let a drone report variables, by default ``pm.vbat``, in block 1; the period is in 10 ms."""
    chosen = variables(*(variable or ((FLOAT, "pm.vbat"),)))
    assert control(bench, 6, 1, more=chosen) == 0
    assert control(bench, 3, 1, period) == 0


def data(bench: Any) -> list[bytes]:
    return [packet for packet in bench.streamed[0] if packet[0] == Port.LOG << 4 | 2]


def test_log_blocks_are_sent_periodically_with_timestamps(bench: Bench) -> None:
    begin(bench, period=5)
    bench.fly(1.0)
    stamps = [int.from_bytes(packet[2:5], "little") for packet in data(bench)]
    assert stamps == list(range(50, 1001, 50))
    assert all(packet[1] == 1 and len(packet) == 9 for packet in data(bench))


def test_a_period_may_be_given_in_milliseconds(bench: Bench) -> None:
    control(bench, 6, 1, more=variables((FLOAT, "pm.vbat")))
    assert control(bench, 8, 1, more=struct.pack("<H", 250)) == 0
    bench.fly(1.0)
    assert len(data(bench)) == 4


def test_a_period_of_nothing_sends_once(bench: Bench) -> None:
    begin(bench, period=0)
    bench.fly(0.5)
    assert len(data(bench)) == 1


@pytest.mark.parametrize("end", [4, 2, 5])
def test_a_block_that_is_stopped_deleted_or_reset_is_not_sent(bench: Bench, end: int) -> None:
    begin(bench)
    bench.fly(0.1)
    assert control(bench, end, 1) == 0
    bench.streamed[0].clear()
    bench.fly(0.1)
    assert data(bench) == []


@pytest.mark.parametrize(
    ("timeout", "silence", "deleted"),
    [(1.0, 0.9, False), (1.0, 1.1, True), (0.3, 0.5, True), (math.inf, 5.0, False)],
)
def test_blocks_are_deleted_when_no_packet_arrives(
    start: Start, timeout: float, silence: float, *, deleted: bool
) -> None:
    bench = start(link_timeout=timeout)
    begin(bench)
    bench.fly(silence, polled=False)
    assert control(bench, 3, 1, 1) == (errno.ENOENT if deleted else 0)
    count = len(data(bench))
    bench.fly(0.1)
    assert (len(data(bench)) == count) is deleted


def test_a_vehicle_flies_on_when_its_blocks_are_deleted(bench: Bench) -> None:
    begin(bench)
    bench.fly(0.5)
    bench.takeoff()
    bench.fly(5.0, polled=False)
    assert bench.position[2] == pytest.approx(0.8, abs=0.05)
    assert control(bench, 3, 1, 1) == errno.ENOENT


def test_a_link_over_tcp_has_no_timeout(bench: Bench) -> None:
    begin(bench)
    bench.fleet.handle(0, NULL, tcp=True)
    bench.fly(2.0, polled=False)
    assert control(bench, 3, 1, 1) == 0


def test_a_block_can_be_appended_to(bench: Bench) -> None:
    control(bench, 6, 1, more=variables((FLOAT, "pm.vbat")))
    assert control(bench, 7, 1, more=variables((U16, "supervisor.info"))) == 0
    control(bench, 3, 1, 1)
    bench.fly(0.02)
    voltage, info = struct.unpack("<fH", data(bench)[0][5:])
    assert voltage == pytest.approx(4.19, abs=0.02)
    assert info == 0b1110


def test_a_repeated_append_appends_what_fits_again(bench: Bench) -> None:
    control(bench, 6, 1, more=variables((FLOAT, "pm.vbat")))
    more = variables(*[(FLOAT, "pm.vbat")] * 2, (U16, "supervisor.info"))
    errors = [control(bench, 7, 1, more=more) for _time in range(3)]
    assert errors == [0, 0, errno.E2BIG]
    control(bench, 3, 1, 1)
    bench.fly(0.02)
    assert len(data(bench)[0][5:]) == 4 + 10 + 10  # of the third nothing fits


def test_errors_are_the_firmwares(bench: Bench) -> None:
    variable = variables((FLOAT, "pm.vbat"))
    assert control(bench, 3, 1, 10) == errno.ENOENT
    assert control(bench, 6, 1, more=variable) == 0
    assert control(bench, 6, 1, more=variable) == errno.EEXIST
    assert control(bench, 7, 1, more=struct.pack("<BH", FLOAT, 60000)) == errno.ENOENT
    assert control(bench, 7, 1, more=6 * variable) == errno.E2BIG
    assert control(bench, 99, 1) == errno.ENOEXEC
    for number in range(2, 17):
        assert control(bench, 6, number, more=variable) == 0
    assert control(bench, 6, 17, more=variable) == errno.ENOMEM


def test_no_more_than_128_variables_are_logged_at_once(bench: Bench) -> None:
    eight = variables(*[(I8, "pm.state")] * 8)
    for number in range(16):
        assert control(bench, 6, number, more=eight) == 0
    assert control(bench, 7, 0, more=variables((I8, "pm.state"))) == errno.ENOMEM


def test_a_variable_is_converted_to_the_type_that_is_asked_for(bench: Bench) -> None:
    begin(bench, (U16, "pm.vbat"), (HALF, "pm.vbat"), (FLOAT, "pm.vbatMV"))
    bench.fly(0.02)
    whole, half, millivolts = struct.unpack("<Hef", data(bench)[0][5:])
    assert whole == 4
    assert half == pytest.approx(4.19, abs=0.02)
    assert 4100 < millivolts < 4200


def test_what_a_type_cannot_hold_is_cut_to_its_range() -> None:
    assert cast(np.array([1e9, -1e9, float("nan"), -1.7]), I16) == [32767, -32768, 0, -1]


def test_every_variable_can_be_logged_in_flight(start: Start) -> None:
    bench = start(noise=True)
    bench.takeoff()
    bench.fly(2.0)
    for entry in VARIABLES:
        (value,) = bench.log(entry.name)
        assert math.isfinite(value), entry.name


def test_angles_and_rates_have_the_firmwares_signs(aloft: Bench) -> None:
    aloft.fly(0.25, "Bffff", 8, 1.0, 0.0, 0.0, 0.0)  # ahead: nose down
    (down, packed) = aloft.log("stateEstimate.pitch", "stateEstimateZ.quat")
    assert down < -1
    x, y, z, w = expand(packed)
    nose_down = math.degrees(math.asin(2 * (w * y - z * x)))
    assert nose_down == pytest.approx(-down, abs=0.3)
    aloft.fly(1.0, "Bffff", 8, 0.0, 0.0, 0.0, 90.0)  # to the left
    yaw, rate, packed_rate = aloft.log("stateEstimate.yaw", "gyro.z", "stateEstimateZ.rateYaw")
    assert 45 < yaw < 90
    assert rate == pytest.approx(90, abs=15)
    assert packed_rate == pytest.approx(1000 * math.radians(rate), abs=2)
    x, y, ahead, aside, height = aloft.log(
        "stateEstimate.vx", "stateEstimate.vy", "kalman.statePX", "kalman.statePY", "range.zrange"
    )
    assert math.hypot(x, y) == pytest.approx(math.hypot(ahead, aside), abs=0.02)
    assert height == pytest.approx(800, abs=60)


def test_ranger_measures_the_distance_to_the_surface(aloft: Bench) -> None:
    aloft.fleet.simulator.drones["surface"] = 0.3
    (distance,) = aloft.log("range.zrange")
    assert distance == pytest.approx(500, abs=60)


def test_what_the_controller_wants_is_what_the_vehicle_does(aloft: Bench) -> None:
    aloft.fly(1.0, "Bffff", 9, 5.0, -4.0, 0.0, 0.8)
    roll, pitch = aloft.log("controller.roll", "controller.pitch")
    assert (roll, pitch) == pytest.approx((5.0, -4.0), abs=0.3)
    rates = aloft.log("controller.rollRate", "controller.pitchRate")
    assert rates == pytest.approx((0, 0), abs=10)


def test_body_velocities_turn_with_the_drone(bench: Bench) -> None:
    bench.takeoff(yaw=math.pi / 2)
    bench.fly(3.0)
    bench.fly(2.0, "Bffff", 8, 0.3, 0.0, 0.0, 0.0)
    vx, aside = bench.log("stateEstimate.vx", "kalman.statePY")
    assert vx == pytest.approx(0.3, abs=0.03)
    assert aside == pytest.approx(-0.3, abs=0.03)


def test_accelerometer_shows_gravity_at_rest_and_in_hover(bench: Bench) -> None:
    bench.fly(0.1)
    assert bench.log("acc.z", "stateEstimate.az") == pytest.approx((1.0, 0.0), abs=0.01)
    bench.takeoff()
    bench.fly(4.0)
    assert bench.log("acc.z", "stateEstimate.az") == pytest.approx((1.0, 0.0), abs=0.05)


def test_an_accelerometer_measures_the_drag_of_the_air(aloft: Bench) -> None:
    aloft.fly(2.0, "Bffff", 8, 0.3, 0.0, 0.0, 0.0)
    vx, ahead = aloft.log("kalman.statePX", "acc.x")
    assert ahead == pytest.approx(-DRAG_XY / MASS / GRAVITY * vx, abs=0.002)


@given(st.floats(), st.sampled_from(sorted(FORMAT)))
def test_a_value_is_held_alone_as_it_is_among_others(value: float, code: int) -> None:
    (among,) = cast([value], code)
    assert cast_one(value, code) == among or (math.isnan(among) and math.isnan(value))
