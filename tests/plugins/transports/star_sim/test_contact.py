"""What happens when drones meet each other and obstacles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from star_core import Obstacle, Order
from star_core.toolkit import compiled
from star_sim import airframe, contact
from star_sim.drone import standing
from tests.plugins.transports.star_sim.conftest import Flight, hovering

separate = compiled(contact.separate.py_func)  # type: ignore[attr-defined]  # for Python to call
WALL = Obstacle("wall", (((0.5, -1), (0.7, -1), (0.7, 1), (0.5, 1)),), (0.0, 2.0))


def test_head_on_drones_do_not_pass_through_each_other() -> None:
    flight = hovering(2, at=[(-0.5, 0, 0), (0.5, 0, 0)])
    gaps = []
    for _ in range(60):
        flight.fly(0.05, [(0.5, 0, 0), (-0.5, 0, 0)])
        gaps.append(flight.position[1, 0] - flight.position[0, 0])
    assert min(gaps) == pytest.approx(2 * airframe.FRAME_RADIUS, abs=0.01)
    assert min(gaps) < 0.12  # a record that looks once per tick sees that propellers met
    speeds = np.abs(flight.telemetry.velocity[:, 0])
    assert speeds.max() < 0.25


def test_drones_at_the_same_point_come_apart_without_nan() -> None:
    flight = Flight(3, at=[(0.0, 0.0, 0.0)] * 3)
    flight.fly(0.5)
    flight.rise()
    assert np.isfinite(flight.position).all()
    gaps = np.linalg.norm(flight.position[:, None] - flight.position[None], axis=2)
    assert gaps[np.triu_indices(3, 1)].min() > 0.05


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_of_many_pairs_just_those_that_overlap_are_moved_apart(seed: int) -> None:
    rng = np.random.default_rng(seed)
    way = rng.normal(0, 1, (40, 3))
    way *= (rng.uniform(0.01, 0.2, 40) / np.linalg.norm(way, axis=1))[:, None]
    middle = np.stack([np.arange(40) % 7, np.arange(40) // 7, np.full(40, 1)], axis=1)
    shuffled = rng.permutation(80)
    place = np.concatenate([middle - way / 2, middle + way / 2])[shuffled]
    drones = standing(place, np.zeros(80), 1.0)
    drones["velocity"] = rng.normal(0, 1, (80, 3))
    before = drones["velocity"].copy()

    separate(drones, np.argsort(place @ contact.SWEEP), np.zeros(80))

    back = np.argsort(shuffled)
    after = drones["position"][back[40:]] - drones["position"][back[:40]]
    distance = np.linalg.norm(way, axis=1)
    expected = np.maximum(distance, 2 * airframe.FRAME_RADIUS)
    assert after == pytest.approx(way * (expected / distance)[:, None], abs=1e-12)
    assert drones["velocity"].sum(axis=0) == pytest.approx(before.sum(axis=0))
    assert (drones["velocity"] ** 2).sum() <= (before**2).sum() * (1 + 1e-12)


def test_drones_far_from_sorted_are_found_all_the_same() -> None:
    place = np.array([[3.0, 0, 1], [0, 0, 1], [2, 0, 1], [0.08, 0, 1]])
    drones = standing(place, np.zeros(4), 1.0)
    order = np.arange(4)
    separate(drones, order, np.zeros(4))
    assert list(order) == [1, 3, 2, 0]
    assert drones["position"][3, 0] - drones["position"][1, 0] == pytest.approx(0.1)


@given(seed=st.integers(0, 1000))
@settings(max_examples=5)
def test_crowds_thrown_among_obstacles_stay_finite_and_outside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = [(x - 0.1, y - 0.2) for x in (-1.5, -0.5, 0.5, 1.5) for y in (-1.5, -0.5, 0.5, 1.5)]
    pillars = tuple(
        Obstacle("pillar", (((x, y), (x + 0.4, y), (x, y + 0.4)),), (0.0, 2.0)) for x, y in corners
    )
    flight = Flight(
        30, noise=True, at=[(*p, 0.0) for p in rng.uniform(-2, 2, (30, 2))], obstacles=pillars
    )
    flight.rise()
    for _ in range(40):
        flight.simulator.drones["rates"] += rng.normal(0, 2, (30, 3))
        flight.fly(0.1, rng.normal(0, 1.5, (30, 3)), yaw=rng.uniform(-4, 4))
        truth = flight.simulator.truth()
        assert truth is not None
        assert np.isfinite(truth.position).all()
        assert np.isfinite(flight.telemetry.position).all()
        assert np.linalg.norm(truth.attitude, axis=1) == pytest.approx(1.0, abs=1e-9)
        assert not any(p.contains(tuple(at)) for p in pillars for at in truth.position)


def test_a_wall_blocks() -> None:
    flight = hovering(obstacles=(WALL,))
    flight.fly(4.0, (0.5, 0, 0))
    assert flight.position[0, 0] == pytest.approx(0.5 - airframe.FRAME_RADIUS, abs=0.01)


def test_a_drone_flies_over_a_low_wall() -> None:
    low = Obstacle("low", WALL.polygons, (0.0, 0.5))
    flight = hovering(obstacles=(low,), height=0.8)
    flight.fly(4.0, (0.5, 0, 0))
    assert flight.position[0, 0] > 1.5


def test_a_drone_under_a_beam_is_stopped_on_its_way_up() -> None:
    beam = Obstacle("beam", (((-1, -1), (1, -1), (1, 1), (-1, 1)),), (1.0, 1.5))
    flight = hovering(obstacles=(beam,), height=0.5)
    flight.fly(4.0, (0, 0, 0.4))
    assert flight.position[0, 2] == pytest.approx(1.0 - airframe.HEIGHT, abs=0.005)


def test_a_drone_stands_on_an_obstacle_and_takes_off_from_it() -> None:
    table = Obstacle("table", (((-1, -1), (1, -1), (1, 1), (-1, 1)),), (0.0, 0.7))
    flight = Flight(at=[(0.0, 0.0, 0.7)], obstacles=(table,))
    flight.simulator.drones["rates"] = 1.0
    flight.fly(2.0)
    assert flight.position[0, 2] == pytest.approx(0.7, abs=0.002)
    assert np.abs(flight.telemetry.odometry.roll[-1]) < 0.01
    flight.order(Order.TAKEOFF, (0, 0, 0.5))
    flight.fly(4.0)
    assert flight.position[0, 2] == pytest.approx(1.2, abs=0.02)


def test_a_concave_obstacle_leaves_its_hollow_free() -> None:
    corners = ((-1, -1), (1, -1), (1, 1), (0.5, 1), (0.5, -0.5), (-0.5, -0.5), (-0.5, 1), (-1, 1))
    flight = hovering(obstacles=(Obstacle("u", (corners,), (0.0, 2.0)),))
    assert flight.position[0] == pytest.approx([0, 0, 0.8], abs=0.01)
    flight.fly(4.0, (0, -0.4, 0))
    assert flight.position[0, 1] == pytest.approx(-0.5 + airframe.FRAME_RADIUS, abs=0.01)
