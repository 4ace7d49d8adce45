"""Heights over surfaces, from heights that an on-board filter measures over what is below."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from star_core import Array, Obstacle, Odometry, Scene, Telemetry
from star_core.messages.telemetry import Supervisor
from star_core.testing import inputs
from star_core.toolkit import SurfaceHeights

HEIGHT, SPEED, CYCLE = 1.2, 0.5, 0.01  # m, m/s, s
HERE = np.array([[0.0, 0.0, HEIGHT]])
COVARIANCE = np.diag([0.05, 0.05, 0.02])[None] ** 2


def with_table(top: float = 0.6, x: tuple[float, float] = (1.0, 2.0)) -> Scene:
    """A room with a table across the way of one agent."""
    low, high = x
    outline = ((low, -1.0), (high, -1.0), (high, 1.0), (low, 1.0))
    scene = inputs.scene(1)
    table = Obstacle("table", (outline,), (0.0, top))
    return replace(scene, world=replace(scene.world, obstacles=(table,)))


class Flown(NamedTuple):
    """What a flight along x estimates: one row per tick."""

    x: Array  # m
    height: Array  # m
    offset: Array  # m
    variance: Array  # m²
    messages: list[str]


def flown(scene: Scene, surface: dict[float, float], *, only_mapped: bool = False) -> Flown:
    """Fly level along x over surfaces, by where each begins, with the firmware's filter gains."""
    follower = SurfaceHeights(scene, only_mapped=only_mapped)
    z, vz, position = HEIGHT, 0.0, np.array([[0.0, 0.0, HEIGHT]])
    rows: list[tuple[float, ...]] = []
    messages: list[str] = []
    for tick in range(130):
        heights, climbs, times = [], [], []
        for cycle in range(5 * tick, 5 * tick + 5):
            along = SPEED * cycle * CYCLE
            below = next((top for begin, top in reversed(surface.items()) if along >= begin), 0.0)
            z += CYCLE * vz
            if 2 * cycle % 5 < 2:
                surprise = HEIGHT - below - z
                z, vz = z + 0.432 * surprise, vz + 4.75 * surprise
            heights.append(z)
            climbs.append(vz)
            times.append(cycle * CYCLE)
        n = len(times)
        position[0, 0] = along
        report = telemetry(times[-1], z, vz)
        samples = Odometry(
            agent=np.zeros(n, np.int64),
            time=np.array(times),
            velocity=np.column_stack([np.full(n, SPEED), np.zeros(n), climbs]),
            yaw_rate=np.zeros(n),
            roll=np.zeros(n),
            pitch=np.zeros(n),
            height=np.array(heights),
        )
        correction = follower.correct(replace(report, odometry=samples), position, COVARIANCE)
        corrected = float(correction.telemetry.position[0, 2])
        rows.append((along, corrected, float(correction.offset[0]), float(correction.variance[0])))
        messages += correction.messages
    x, height, offset, variance = np.array(rows).T
    return Flown(x, height, offset, variance, messages)


def telemetry(
    time: float, height: float, climb: float, state: int = Supervisor.FLYING
) -> Telemetry:
    return Telemetry(
        time=time,
        position=np.array([[0.0, 0.0, height]]),
        velocity=np.array([[SPEED, 0.0, climb]]),
        attitude=np.array([[0.0, 0.0, 0.0, 1.0]]),
        battery=np.array([4.0]),
        state=np.array([int(state)]),
        age=np.zeros(1),
    )


@pytest.mark.parametrize("top", [0.1, 0.3, 0.6, 0.9])
def test_heights_stay_right_onto_a_table_and_off_it(top: float) -> None:
    flight = flown(with_table(top), {1.0: top, 2.0: 0.0})
    assert np.abs(flight.height - HEIGHT).max() < 0.04
    on = (flight.x > 1.3) & (flight.x < 2.0)
    assert flight.offset[on] == pytest.approx(top)
    assert (flight.offset[-1], flight.messages) == (0.0, [])


def test_a_thin_wall_ends_where_it_began() -> None:
    flight = flown(with_table(0.6, (1.0, 1.1)), {1.0: 0.6, 1.1: 0.0})
    assert np.abs(flight.height - HEIGHT).max() < 0.06
    assert flight.offset[-1] == 0.0


def test_a_surface_that_is_not_in_the_map_is_reported() -> None:
    flight = flown(with_table(x=(4.0, 5.0)), {1.0: 0.6})
    (message,) = flight.messages
    assert message.startswith("cf1 flies over a surface 0.6")
    assert "that is not in the map" in message
    assert np.abs(flight.height - HEIGHT).max() < 0.04
    assert flight.variance[0] == 0.0
    assert np.sqrt(flight.variance[-1]) > 0.03  # m: it is wary of where it is


def test_estimators_that_know_the_map_are_over_its_surfaces_only() -> None:
    flight = flown(with_table(x=(4.0, 5.0)), {1.0: 0.6}, only_mapped=True)
    assert (flight.offset[-1], flight.messages) == (0.0, [])


def test_the_edge_may_be_where_the_position_is_uncertain() -> None:
    beside = with_table(x=(1.2, 2.2))  # in the map; it stands 20 cm nearer
    assert flown(beside, {1.0: 0.6}).messages == []


def test_a_tabletop_of_a_wrong_height_is_another_surface() -> None:
    (message,) = flown(with_table(0.3), {1.0: 0.6}).messages
    assert "0.6" in message


def test_heights_over_the_floor_stay_as_reported() -> None:
    follower = SurfaceHeights(with_table())
    report = telemetry(0.0, HEIGHT, 0.0)
    assert follower.correct(report, np.zeros((1, 3)), COVARIANCE).telemetry is report
    assert flown(with_table(), {}).variance.max() == 0.0


@pytest.mark.parametrize("height", [40.0, -3.0, HEIGHT + 0.7])
def test_what_no_surface_explains_is_not_measured(height: float) -> None:
    follower = SurfaceHeights(with_table())
    for time, reported in ((0.0, HEIGHT), (0.05, HEIGHT), (0.1, height), (0.15, HEIGHT)):
        report = telemetry(time, reported, 0.0)
        zero = np.zeros(1)
        odometry = Odometry(
            agent=np.zeros(1, np.int64),
            time=np.array([time]),
            velocity=np.array([[SPEED, 0.0, 0.0]]),
            yaw_rate=zero,
            roll=zero,
            pitch=zero,
            height=np.array([reported]),
        )
        surfaces = follower.correct(replace(report, odometry=odometry), HERE, COVARIANCE)
        assert surfaces.telemetry.position[0, 2] == reported
        assert (surfaces.heights, surfaces.messages) == (None, ())


def test_exact_odometry_is_never_corrected() -> None:
    flight = flown(replace(with_table(), exact_odometry=True), {1.0: 0.6})
    assert flight.offset.max() == 0.0
