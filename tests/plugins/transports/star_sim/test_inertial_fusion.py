"""Estimators without a Flow deck: their covariances, and what ranges and positions correct."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Array, Corrections
from star_sim.airframe import CYCLE, GRAVITY
from star_sim.drone import DRONE, OFF, TRAJECTORY, Drones
from star_sim.inertial_fusion import InertialFusion, Ranges

CORNERS = np.array([[x, y, z] for x in (-2.2, 2.2) for y in (-2.2, 2.2) for z in (0.2, 2.4)])
MIDDLE = np.array([0.0, 0.0, 1.3])
OFF_MIDDLE = np.array([0.1, -0.1, 1.4])
STD = 0.25  # m, of a range


def at(position: Array, mode: int = TRAJECTORY) -> Drones:
    """Return the state of one drone that flies, and believes to be at a position."""
    drones = np.zeros(1, DRONE)
    drones["believed_position"], drones["mode"] = position, mode
    return drones


def ranges(true: Array) -> Ranges:
    """Return exact ranges of the drone to anchors in the corners."""
    distance = np.linalg.norm(true - CORNERS, axis=1)[None]
    return Ranges(np.array([0]), CORNERS, distance, STD)


def fix(position: Array, std: float = 0.01, yaw_std: float = np.inf) -> Corrections:
    """Return a received position, and heading 0."""
    return Corrections(
        agent=np.array([0]),
        position=position[None],
        attitude=np.array([[0.0, 0.0, 0.0, 1.0]]),
        position_deviation=np.array([std]),
        attitude_deviation=np.array([yaw_std]),
    )


def test_covariances_grow_as_by_the_firmwares_noise() -> None:
    """Compared with a filter that predicts in each cycle: position, velocity, error of the tilt."""
    carry = np.array([[1, CYCLE, 0], [0, 1, CYCLE * GRAVITY], [0, 0, 1]])
    noise = np.diag([0.0, (0.5 * CYCLE) ** 2, (0.1 * CYCLE) ** 2])
    covariance = np.zeros((3, 3))
    for _ in range(300):
        covariance = carry @ covariance @ carry.T + noise
    drones, fusion = at(np.zeros(3)), InertialFusion(1)
    fusion.forget(drones, 0, 5.0)
    position = fusion.position_variance(drones, 8.0)[0]
    velocity = fusion.velocity_variance(drones, 8.0)[0]
    assert position[:2] == pytest.approx(covariance[0, 0], rel=0.02)
    assert velocity[:2] == pytest.approx(covariance[1, 1], rel=0.02)
    assert position[2] == pytest.approx((1.0 * CYCLE) ** 2 / CYCLE * 3.0**3 / 3)  # it does not tilt


def test_ranges_locate_as_well_as_their_geometry_allows() -> None:
    drones, fusion = at(MIDDLE), InertialFusion(1)
    fusion.start_unknown()
    fusion.take(drones, ranges(OFF_MIDDLE), 0.0)
    ways = MIDDLE - CORNERS
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    expected = STD**2 * np.diag(np.linalg.inv(ways.T @ ways))
    variance = fusion.position_variance(drones, 0.0)[0]
    assert variance == pytest.approx(expected, rel=0.1)
    assert variance[2] > 3 * variance[0]
    assert drones["believed_position"][0] == pytest.approx(OFF_MIDDLE, abs=0.02)


def test_anchors_in_a_plane_do_not_correct_across_it() -> None:
    flat = ranges(MIDDLE)._replace(anchors=CORNERS * [1, 1, 0] + [0, 0, MIDDLE[2]])
    drones, fusion = at(MIDDLE), InertialFusion(1)
    fusion.start_unknown()
    fusion.take(drones, flat, 0.0)
    assert fusion.position_variance(drones, 0.0)[0, 2] == pytest.approx(1.0)


def test_unheard_anchors_correct_nothing() -> None:
    silent = ranges(MIDDLE)._replace(distance=np.full((1, len(CORNERS)), np.nan))
    drones, fusion = at(MIDDLE), InertialFusion(1)
    fusion.start_unknown()
    before = fusion.position_variance(drones, 0.0)
    fusion.take(drones, silent, 0.0)
    assert (fusion.position_variance(drones, 0.0) == before).all()
    assert (drones["believed_position"] == MIDDLE).all()


@pytest.mark.parametrize(("mode", "corrected"), [(TRAJECTORY, True), (OFF, False)])
@pytest.mark.parametrize("yaw", [0.0, 1.0])
def test_positions_correct_velocity_and_tilt(yaw: float, mode: int, *, corrected: bool) -> None:
    """An agent whose wrong tilt hides that it accelerates along x is found ahead of its estimate.

    A pitch that is estimated too great by an angle e makes the estimate accelerate by g e ahead.
    """
    drones, fusion = at(np.zeros(3), mode), InertialFusion(1)
    fusion.forget(drones, 0, 0.0)
    drones["believed_yaw"] = yaw
    for step in range(1, 21):
        fusion.take(drones, fix(np.array([0.5 * (0.05 * step) ** 2, 0.0, 0.0])), 0.05 * step)
    assert drones["believed_velocity"][0, 0] > 0.5
    east = np.array([np.sin(yaw), np.cos(yaw)])  # roll and pitch that accelerate along x
    tilt = drones["tilt_error"][0]
    assert (tilt @ east > 0.005) == corrected
    assert abs(tilt @ [east[1], -east[0]]) < 1e-6


def test_a_measured_heading_corrects_the_heading() -> None:
    drones, fusion = at(np.zeros(3)), InertialFusion(1)
    fusion.forget(drones, 0, 0.0)
    drones["believed_yaw"] = 0.2
    fusion.take(drones, fix(np.zeros(3), yaw_std=0.001), 10.0)
    assert drones["believed_yaw"][0] == pytest.approx(0.0, abs=0.01)


def test_a_wrong_heading_turns_what_was_gained_since() -> None:
    """After a velocity change along x the heading's uncertainty is one along y."""
    drones, fusion = at(np.zeros(3)), InertialFusion(1)
    fusion.start_unknown()
    fusion.take(drones, fix(np.zeros(3)), 0.0)
    still = fusion.velocity_variance(drones, 1.0)[0]
    drones["believed_velocity"][0, 0] = 10.0
    gained = fusion.velocity_variance(drones, 1.0)[0]
    assert gained[1] - still[1] == pytest.approx((10.0 * 0.01) ** 2, rel=0.01)
    assert gained[0] == pytest.approx(still[0])
