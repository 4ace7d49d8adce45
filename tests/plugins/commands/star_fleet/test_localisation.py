"""Positions and poses for the estimator on board, with the weights that parameters give them."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core.testing import scene
from star_fleet.conditions import Condition, with_receivers
from star_fleet.packet import Port, compress
from tests.plugins.commands.star_fleet.conftest import Bench, Start


def believed(bench: Any, row: int = 0) -> Any:
    return bench.fleet.simulator.drones[row]["believed_position"].copy()


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def test_a_position_draws_the_estimate_by_its_weight(start: Start) -> None:
    moved = {}
    for deviation in (0.01, 1.0):
        bench = start(noise=True)
        bench.fly(5.0)
        bench.write("locSrv.extPosStdDev", "f", deviation)
        before = believed(bench)
        assert bench.ask(Port.LOCALISATION, 0, struct.pack("<fff", 1.0, 0.0, 0.0)) == []
        moved[deviation] = float((believed(bench) - before)[0])
    assert moved[0.01] == pytest.approx(1.0, abs=0.02)
    assert moved[1.0] == pytest.approx(0.011, abs=0.003)


def test_a_pose_turns_the_estimate_too(start: Start) -> None:
    bench = start(noise=True)
    bench.fly(5.0)
    payload = struct.pack("<B7f", 8, 0.5, 0.2, 0.0, *quaternion(0.3))
    assert bench.ask(Port.LOCALISATION, 1, payload) == []
    assert believed(bench)[:2] == pytest.approx([0.5, 0.2], abs=0.02)
    assert bench.fleet.simulator.drones[0]["believed_yaw"] == pytest.approx(0.3, abs=0.02)


def test_a_packed_position_is_for_the_one_that_it_names(start: Start) -> None:
    bench = start(2, noise=True)
    bench.fly(5.0)
    before = believed(bench, 1)
    payload = struct.pack("<BhhhBhhh", 1, 700, 0, 0, 2, -900, 0, 0)
    bench.ask(Port.LOCALISATION, 2, payload, 0)
    assert believed(bench, 0)[0] == pytest.approx(0.7, abs=0.02)
    assert believed(bench, 1) == pytest.approx(before)
    bench.ask(Port.LOCALISATION, 2, payload, 1)
    assert believed(bench, 1)[0] == pytest.approx(-0.9, abs=0.02)


def test_a_packed_pose_is_for_the_one_that_it_names(start: Start) -> None:
    bench = start(noise=True)
    bench.fly(5.0)
    packed = int(compress(np.array([quaternion(-0.4)]))[0])
    payload = struct.pack("<B", 9) + struct.pack("<BhhhI", 9, 5000, 0, 0, packed)
    payload += struct.pack("<BhhhI", 1, 0, 250, 0, packed)
    bench.ask(Port.LOCALISATION, 1, payload)
    assert believed(bench)[:2] == pytest.approx([0.0, 0.25], abs=0.03)
    assert bench.fleet.simulator.drones[0]["believed_yaw"] == pytest.approx(-0.4, abs=0.03)


@pytest.mark.parametrize(
    "values",
    [
        (math.nan, 0, 0, 0, 0, 0, 1),
        (0, 0, 0, 0, 0, 0, 0),
        (1e9, 0, 0, 0, 0, 0, 1),
        (0, 0, 0, math.inf, 0, 0, 1),
    ],
)
def test_what_is_no_pose_is_dropped(start: Start, values: tuple[float, ...]) -> None:
    bench = start(noise=True)
    before = believed(bench)
    bench.ask(Port.LOCALISATION, 1, struct.pack("<B7f", 8, *values))
    bench.ask(Port.LOCALISATION, 0, struct.pack("<3f", *values[:2], math.nan))
    assert believed(bench) == pytest.approx(before)


def test_no_deviation_is_taken_for_a_small_one(start: Start) -> None:
    bench = start(noise=True)
    bench.write("locSrv.extPosStdDev", "f", 0.0)
    for _ in range(2):
        bench.ask(Port.LOCALISATION, 0, struct.pack("<fff", 1.0, 0.0, 0.0))
    assert np.isfinite(believed(bench)).all()


def test_the_estimator_starts_anew_at_the_position_that_is_sent(aloft: Bench) -> None:
    aloft.go(0.6, -0.4, 0.8, 0.5)
    aloft.fly(4.0)
    aloft.land()
    aloft.fly(4.0)
    aloft.write("kalman.initialX", "f", 2.0)
    aloft.write("kalman.initialYaw", "f", 1.0)
    aloft.write("kalman.resetEstimation", "B", 1)
    aloft.fly(0.1)
    x, y, yaw = aloft.log("stateEstimate.x", "stateEstimate.y", "stateEstimate.yaw")
    assert (x, y, yaw) == pytest.approx((2.0, 0.0, math.degrees(1.0)), abs=0.01)
    (answer,) = aloft.ask(Port.PARAMETERS, 3, b"\0kalman\0resetEstimation\0\x08\x00")
    assert answer[-1] == 0


def test_a_flight_after_a_new_start_is_in_the_new_frame(bench: Bench) -> None:
    bench.write("kalman.initialYaw", "f", math.pi / 2)
    bench.write("kalman.resetEstimation", "B", 1)
    bench.takeoff(yaw=math.pi / 2)
    bench.fly(3.0)
    bench.go(0.0, 0.5, 0.8, math.pi / 2)
    bench.fly(4.0)
    assert bench.position == pytest.approx([0.5, 0.0, 0.8], abs=0.03)


@pytest.mark.parametrize("system", ["lighthouse", "loco"])
@pytest.mark.parametrize(("enabled", "expected"), [(1, (2.0, 1.0)), (0, (0.0, 0.0))])
def test_a_parameter_switches_receivers_off(
    start: Start, system: str, enabled: int, expected: tuple[float, float]
) -> None:
    bench = start(conditions={0: frozenset({Condition(system)})})
    drone = bench.fleet.simulator.drones[0]
    drone["position"][:2] = 2.0, 1.0
    bench.write(f"{system}.enableEst", "B", enabled)
    bench.write("kalman.resetEstimation", "B", 1)
    assert tuple(believed(bench)[:2]) == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("system", ["lighthouse", "loco", "poses"])
def test_drones_of_missions_with_receivers_know_the_map(system: str) -> None:
    room = replace(scene(2), onboard_system=system)
    silent = frozenset({Condition.NO_STATIONS})
    conditions = with_receivers({1: silent}, room)
    assert conditions == {0: frozenset({Condition(system)}), 1: silent}
    assert with_receivers({1: silent}, scene(2)) == {1: silent}
