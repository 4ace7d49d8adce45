"""What the drones believe, and how far from the truth it is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from star_core import Obstacle, Transform
from star_sim import sensors
from star_sim.airframe import DRAG_XY, MASS
from star_sim.drone import VELOCITY, standing
from star_sim.estimator import lean
from tests.plugins.transports.star_sim.conftest import Flight, benchmark, hovering


def test_noiseless_telemetry_is_the_truth_in_odometry_frames() -> None:
    flight = hovering(at=[(1.0, -2.0, 0.0)], yaw=2.5)
    for velocity in ((0.4, 0.1, 0.05), (-0.3, 0.3, 0)):
        flight.fly(1.0, velocity, yaw=1.0)
        truth = flight.simulator.truth()
        map_from_odom = Transform(np.array([2.5]), np.array([[1.0, -2.0, 0.0]]))
        heard = flight.telemetry
        assert map_from_odom.apply(heard.position) == pytest.approx(truth.position, abs=1e-12)
        assert map_from_odom.turn(heard.velocity) == pytest.approx(truth.velocity, abs=1e-12)
        half = 2.5 / 2
        x, y, z, w = heard.attitude[0]
        turned = [
            math.cos(half) * x - math.sin(half) * y,
            math.cos(half) * y + math.sin(half) * x,
            math.cos(half) * z + math.sin(half) * w,
            math.cos(half) * w - math.sin(half) * z,
        ]
        same = abs(np.dot(turned, truth.attitude[0]))  # q and -q are one attitude
        assert same == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("rate", [10, 20, 30, 50, 100])
def test_odometry_comes_at_a_hundred_hertz_whatever_the_tick(rate: int) -> None:
    flight = hovering(2, rate=rate)
    table = [heard.odometry for heard in flight.fly(1.0)]
    time = np.concatenate([odometry.time for odometry in table])
    agent = np.concatenate([odometry.agent for odometry in table])
    for row in range(2):
        assert np.diff(time[agent == row]) == pytest.approx(0.01, abs=1e-9)
        assert 99 <= (agent == row).sum() <= 101


def test_adding_up_the_odometry_gives_the_believed_position() -> None:
    flight = hovering(noise=True)
    begun = flight.telemetry.position[0, :2]
    yaw = 2 * math.atan2(*flight.telemetry.attitude[0, 2:])
    travelled = np.zeros(2)
    for heard in flight.fly(8.0, (0.3, 0.1, 0), yaw=1.5):
        table = heard.odometry
        for (vx, vy, _), rate in zip(table.velocity, table.yaw_rate, strict=True):
            yaw += rate * 0.01
            travelled += 0.01 * np.array(
                [math.cos(yaw) * vx - math.sin(yaw) * vy, math.sin(yaw) * vx + math.cos(yaw) * vy]
            )
    assert begun + travelled == pytest.approx(flight.telemetry.position[0, :2], abs=2e-3)


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_accelerometer_measures_the_drag_of_the_air(yaw: float) -> None:
    flight = hovering(yaw=yaw)
    drag = DRAG_XY / MASS
    for velocity in ((0.5, 0.2, 0), (-0.8, 0.4, 0)):
        for heard in flight.fly(1.5, velocity):
            true = np.array(heard.velocity[0, :2])  # ideal: the truth, along the start's heading
            assert heard.specific_force[0] == pytest.approx(-drag * true, abs=0.03)
        assert np.linalg.norm(heard.specific_force[0]) > 0.2


def test_odometry_agrees_with_the_attitude() -> None:
    flight = hovering(noise=True)
    flight.fly(0.3, (1.0, -0.5, 0))
    x, y, z, w = flight.telemetry.attitude[0]
    roll = math.atan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    pitch = math.asin(2 * (w * y - x * z))
    assert abs(pitch) > 0.01
    assert flight.telemetry.odometry.roll[-1] == pytest.approx(roll, abs=1e-12)
    assert flight.telemetry.odometry.pitch[-1] == pytest.approx(pitch, abs=1e-12)
    assert flight.telemetry.odometry.height[-1] == flight.telemetry.position[0, 2]


def test_nose_down_is_a_positive_pitch() -> None:
    flight = hovering()
    flight.fly(0.3, (1.0, 0, 0))
    assert flight.telemetry.odometry.pitch[-1] > 0.05


def test_a_drone_at_rest_does_not_drift() -> None:
    flight = Flight(3, noise=True)
    flight.fly(20.0)
    assert np.abs(flight.telemetry.position).max() == 0.0
    assert np.abs(flight.telemetry.velocity).max() == 0.0


def test_a_drone_at_rest_on_a_table_does_not_drift() -> None:
    table = Obstacle("table", (((-1, -1), (1, -1), (1, 1), (-1, 1)),), (0.0, 0.7))
    flight = Flight(noise=True, at=[(0.0, 0.0, 0.7)], obstacles=(table,))
    flight.fly(20.0)
    assert np.abs(flight.telemetry.position).max() < 0.01


def test_noisy_drones_start_beside_their_believed_position() -> None:
    flight = Flight(200, noise=True, at=[(float(i), 0.0, 0.0) for i in range(200)])
    beside = flight.position - [(i, 0, 0) for i in range(200)]
    assert beside[:, :2].std() == pytest.approx(sensors.START_OFFSET, rel=0.15)
    assert np.abs(flight.telemetry.position).max() == 0.0


def test_texture_has_its_deviation_and_correlation_length() -> None:
    fields = np.stack([sensors.draw_texture(seed) for seed in range(8)])
    assert fields.std() == pytest.approx(sensors.TEXTURE, rel=0.1)
    shift = round(sensors.TEXTURE_LENGTH / sensors.TEXTURE_PITCH)
    alike = (fields * np.roll(fields, shift, axis=1)).mean() / fields.var()
    length = shift * sensors.TEXTURE_PITCH
    expected = math.exp(-(length**2) / (2 * sensors.TEXTURE_LENGTH**2))
    assert alike == pytest.approx(expected, abs=0.08)


def test_the_texture_repeats_itself_without_a_seam() -> None:
    field = sensors.draw_texture(0)
    seam = np.abs(field[0] - field[-1]).max()
    assert seam < 2 * np.abs(np.diff(field, axis=0)).max()


def test_three_laps_of_a_box_drift_as_a_real_crazyflie_does() -> None:
    error = benchmark()["drift"](40)
    assert 0.1 < error.mean() < 0.6  # m²; the firmware's own estimator: 0.305 ± 0.138


@pytest.mark.parametrize("yaw", [0.0, 0.5 * math.pi, 2.0])
def test_the_thrust_leans_by_the_error_of_the_tilt(yaw: float) -> None:
    """Ahead and to the left of the body, in the map; the estimated yaw is the true one."""
    drones = standing(np.zeros((1, 3)), np.array([yaw]), 1.0)
    drone = drones.view(np.recarray)[0]
    drone["mode"], drone["push"], drone["tilt_error"] = VELOCITY, (0.0, 0.0, 0.3), (0.02, -0.05)
    drone["believed_yaw"], drone["slip"] = yaw, (1.0, 0.0)
    lean(drone)
    ahead, left = 0.3 * 0.05, 0.3 * 0.02
    cos, sin = math.cos(yaw), math.sin(yaw)
    east, north = cos * ahead - sin * left, sin * ahead + cos * left
    assert drone["push"] == pytest.approx([east, north, 0.3], abs=1e-12)
