"""The errors of the profile `realistic`: each magnitude shows in what the drones report."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from star_core import Obstacle, Order, Transform
from star_sim.airframe import CYCLE, GRAVITY
from star_sim.camera_sim.options import OPTIONS
from star_sim.drone import standing
from star_sim.error_profile import IDEAL, REALISTIC, ErrorProfile
from star_sim.estimator import IMU_CLIMB_GAIN, IMU_HEIGHT_GAIN
from star_sim.sensors import Wander, draw_errors, draw_texture
from tests.plugins.transports.star_sim.conftest import Flight, hovering

EXACT = replace(IDEAL, flow_noise=0.0, gyro_noise=0.0, imu=True, surfaces=True, aerodynamics=True)
BOX = Obstacle("box", (((1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0)),), (0.0, 0.4))


def tilt_errors(flight: Any) -> np.ndarray:
    """Return roll and pitch of each agent as reported less the true ones, (N, 2) rad."""
    true = Rotation.from_quat(flight.simulator.truth().attitude).as_euler("ZYX")[:, :0:-1]
    reported = Rotation.from_quat(flight.telemetry.attitude).as_euler("ZYX")[:, :0:-1]
    return np.asarray(reported - true)


def test_constant_errors_have_the_deviations_of_the_profile() -> None:
    drones = standing(np.zeros((400, 3)), np.zeros(400), 1.0)
    draw_errors(drones, REALISTIC, 0)
    assert drones["accelerometer_bias"].std() == pytest.approx(0.015 * GRAVITY, rel=0.1)
    assert drones["ranger_bias"].std() == pytest.approx(0.01, rel=0.15)
    assert set(drones["flow_noise"]) == {2.0}
    draw_errors(drones, IDEAL, 0)
    assert not drones["accelerometer_bias"].any()
    assert not drones["ranger_bias"].any()
    assert set(drones["flow_noise"]) == {1.0}


def test_flow_deck_errors_have_the_fitted_drift_deviations() -> None:
    drones = standing(np.zeros((1000, 3)), np.zeros(1000), 1.0)
    draw_errors(drones, IDEAL, 0)
    assert drones["scale"].std() == pytest.approx(0.05, rel=0.1)
    assert np.degrees(drones["gyro_bias"].std()) == pytest.approx(0.2, rel=0.1)
    assert np.degrees(drones["level_error"].std(axis=0)) == pytest.approx([0.25, 0.25], rel=0.1)
    turn = np.arctan2(drones["misalignment"][:, 1], drones["misalignment"][:, 0])
    assert np.degrees(turn.std()) == pytest.approx(1.0, rel=0.1)
    assert drones["velocity_bias"].std() == pytest.approx(0.004, rel=0.1)
    assert np.mean([draw_texture(seed).std() for seed in range(8)]) == pytest.approx(0.045, rel=0.1)


def test_slow_errors_have_the_deviations_of_the_profile() -> None:
    quiet = replace(REALISTIC, gyro_noise=0.0, accelerometer_noise=0.0)
    wander = Wander(quiet, 0, 60)
    errors = np.concatenate([wander.block(1000) for _ in range(10)])  # 100 s
    expected = [0.02, *[math.radians(0.1)] * 3, *[0.003 * GRAVITY] * 3]
    assert errors.std(axis=(0, 1)) == pytest.approx(expected, rel=0.2)
    for column, time in ((0, 30.0), (2, 30.0), (5, 10.0)):
        lag = round(time / CYCLE)
        earlier, later = errors[:-lag, :, column], errors[lag:, :, column]
        assert (earlier * later).mean() / errors[:, :, column].var() == pytest.approx(0.37, abs=0.2)


def test_noise_of_the_imu_is_white() -> None:
    still = replace(REALISTIC, gyro_wander=0.0, accelerometer_wander=0.0, flow_scale_wander=0.0)
    errors = Wander(still, 0, 4).block(5000)
    assert not errors[:, :, 0].any()
    assert errors[:, :, 1:4].std() == pytest.approx(math.radians(0.3), rel=0.05)
    assert errors[:, :, 4:].std() == pytest.approx(0.003 * GRAVITY, rel=0.05)
    assert np.abs((errors[1:] * errors[:-1]).mean()) < 0.05 * errors.var()


def test_agent_errors_do_not_depend_on_the_number_of_agents() -> None:
    few, many = (Wander(REALISTIC, 3, n).block(10) for n in (2, 5))
    assert np.array_equal(few, many[:, :2])


def biased(errors: dict[str, Any]) -> Flight:
    """A drone with some errors that hovers, all its other sensors being exact."""
    flight = Flight(noise=True, profile=EXACT)
    for name, value in errors.items():
        flight.simulator.drones[name] = value
    flight.rise()
    return flight


def test_an_exact_imu_keeps_the_tilt_exact() -> None:
    flight = biased({})
    flight.fly(2.0, (0.5, 0.2, 0.0), yaw=1.0)
    assert np.abs(tilt_errors(flight)).max() < math.radians(0.3)


@pytest.mark.parametrize(("bias", "row", "sign"), [((0.2, 0, 0), 1, -1), ((0, 0.2, 0), 0, 1)])
def test_accelerometer_bias_tilts_the_estimate(
    bias: tuple[float, ...], row: int, sign: int
) -> None:
    flight = biased({"accelerometer_bias": bias})
    flight.fly(4.0, (0.0, 0.0, 0.0))
    assert tilt_errors(flight)[0, row] == pytest.approx(sign * 0.2 / GRAVITY, abs=0.006)
    assert np.abs(flight.telemetry.velocity).max() < 0.1


def test_wrong_tilt_estimates_do_not_change_the_velocity() -> None:
    flight = biased({"accelerometer_bias": (0.2, 0, 0)})
    flight.fly(6.0, (0.3, 0.0, 0.0))
    true = Rotation.from_quat(flight.simulator.truth().attitude).as_euler("ZYX")[0, 1]
    assert true == pytest.approx(0.0, abs=0.03)  # only drag is balanced
    assert flight.telemetry.velocity[0, 0] == pytest.approx(0.3, abs=0.1)


def test_accelerometer_bias_offsets_the_vertical_velocity() -> None:
    flight = biased({"accelerometer_bias": (0, 0, 0.3)})
    before = flight.position[0, 2]
    flight.fly(5.0, (0.0, 0.0, 0.0))
    wrong = 0.3 * IMU_HEIGHT_GAIN / IMU_CLIMB_GAIN  # where the ranger's corrections balance it
    assert flight.position[0, 2] - before == pytest.approx(-5.0 * wrong, rel=0.2)


def test_a_biased_ranger_shifts_the_height() -> None:
    flight = biased({"ranger_bias": 0.03})
    assert flight.telemetry.position[0, 2] - flight.position[0, 2] == pytest.approx(0.03, abs=5e-3)


def test_a_flow_deck_reports_the_height_over_what_is_below() -> None:
    flight = hovering(noise=True, profile=EXACT, obstacles=(BOX,), height=1.0)
    assert flight.telemetry.position[0, 2] == pytest.approx(flight.position[0, 2], abs=0.02)
    flight.fly(3.5, (0.5, 0.0, 0.0))
    flight.fly(2.0, (0.0, 0.0, 0.0))
    assert 1.0 < flight.position[0, 0] < 2.0
    reported, true = flight.telemetry.position[0, 2], flight.position[0, 2]
    assert reported == pytest.approx(true - 0.4, abs=0.03)
    assert true > 1.05  # the estimator saw the ground rise, and climbed


def test_the_ideal_flow_deck_ignores_what_is_below() -> None:
    flight = hovering(noise=True, obstacles=(BOX,), height=1.0)
    flight.fly(3.5, (0.5, 0.0, 0.0))
    assert 1.0 < flight.position[0, 0] < 2.0
    assert flight.telemetry.position[0, 2] == pytest.approx(flight.position[0, 2], abs=0.03)


def test_reports_are_late_and_lost() -> None:
    lossy = replace(EXACT, report_delay=0.02, report_loss=0.3, setpoint_delay=0.01)
    flight = hovering(4, noise=True, profile=lossy, at=[(float(i), 0.0, 0.0) for i in range(4)])
    table = flight.fly(10.0, (0.3, 0.0, 0.0))
    ages = np.array([heard.age for heard in table])
    assert ages.min() == pytest.approx(0.02, abs=1e-6)
    assert (ages > 0.025).mean() == pytest.approx(0.3, abs=0.07)
    heard = sum(len(report.odometry.agent) for report in table)
    assert heard / 4000 == pytest.approx(0.7, abs=0.03)
    times = np.concatenate([report.odometry.time for report in table if len(report.odometry.time)])
    assert times.max() <= table[-1].time - 0.02 + 1e-6


def test_a_late_report_is_of_the_time_that_its_age_names() -> None:
    flights = [
        Flight(noise=True, profile=replace(EXACT, report_delay=delay, setpoint_delay=0.01))
        for delay in (0.0, 0.03)
    ]
    for flight in flights:
        flight.rise()
    now, late = (flight.fly(1.0, (0.3, 0.0, 0.0))[-1] for flight in flights)
    assert late.age[0] == pytest.approx(0.03, abs=1e-6)
    behind = (now.position - late.position)[0, 0]
    assert behind == pytest.approx(0.03 * now.velocity[0, 0], abs=2e-3)


def test_setpoints_and_commands_take_effect_late_and_in_order() -> None:
    slow = replace(EXACT, setpoint_delay=0.06)
    flight, prompt = Flight(noise=True, profile=slow), Flight(noise=True, profile=EXACT)
    for drone in (flight, prompt):
        drone.rise()
        drone.fly(0.5, (0.5, 0.0, 0.0))
    delay = (prompt.position - flight.position)[0, 0] / prompt.telemetry.velocity[0, 0]
    assert delay == pytest.approx(0.06, abs=0.04)
    flight.fly(0.05, (0.5, 0.0, 0.0))
    flight.order(Order.LAND, duration=2.0)  # the setpoint before it must not stop the landing
    flight.fly(4.0)
    assert flight.position[0, 2] < 0.02


@pytest.mark.parametrize(("profile", "low", "high"), [(IDEAL, 0.02, 0.4), (REALISTIC, 0.04, 0.8)])
def test_drones_drift_in_both_profiles(profile: ErrorProfile, low: float, high: float) -> None:
    flight = hovering(8, noise=True, profile=profile, at=[(float(i), 0.0, 0.0) for i in range(8)])
    for _ in range(2):
        flight.fly(7.0, (0.3, 0, 0))
        flight.fly(7.0, (-0.3, 0, 0), yaw=math.pi)
    drones = flight.simulator.drones
    back = Transform(drones["origin_yaw"], drones["origin"]).inverse()
    drift = (flight.telemetry.position - back.apply(flight.position))[:, :2]
    assert low < np.median(np.linalg.norm(drift, axis=1)) < high


def test_camera_options_have_a_default_or_use_the_profile() -> None:
    for name, option in OPTIONS["properties"].items():
        assert ("default" in option) != ("by default" in option["description"]), name
