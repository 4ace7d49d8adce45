"""Distances to the sides of obstacles."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from star_core import Obstacle
from star_core.safety.walls import nearest_wall, walls

CORNER = ((-1.0, -1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 1.0))
PILLAR = ((1.5, 0.5), (2.0, 0.5), (2.0, 1.0), (1.5, 1.0))
BOTH = (Obstacle("corner", (CORNER,), (0.0, 2.0)), Obstacle("pillar", (PILLAR,), (0.5, 2.0)))


@given(st.floats(-2.9, 3.9), st.floats(-2.9, 2.9))
def test_distances_are_those_of_shapely_and_negative_inside(x: float, y: float) -> None:
    distance, piece, away_x, away_y = nearest_wall(np.array([[x, y, 1.0]]), 0, walls(BOTH))
    shapes, point = [shapely.Polygon(CORNER), shapely.Polygon(PILLAR)], shapely.Point(x, y)
    signed = [
        -shape.exterior.distance(point) if shape.contains(point) else shape.distance(point)
        for shape in shapes
    ]
    if min(signed) < 2.0:
        assert distance == pytest.approx(min(signed), abs=1e-9)
        assert signed[piece] == pytest.approx(min(signed), abs=1e-9)
        assert np.hypot(away_x, away_y) == pytest.approx(1.0)


def test_directions_lead_away_from_the_nearest_obstacle() -> None:
    position = np.array([[1.1, -0.5, 1.0], [1.4, 0.7, 1.0], [-0.9, -0.5, 1.0]])  # the last, inside
    away = [nearest_wall(position, row, walls(BOTH))[2:] for row in range(3)]
    assert np.array(away) == pytest.approx(np.array([[1.0, 0.0], [-1.0, 0.0], [-1.0, 0.0]]))


def test_obstacles_above_or_below_an_agent_do_not_count() -> None:
    position = np.array([[1.7, 0.7, 0.2], [1.7, 0.7, 2.2], [1.7, 0.7, 2.05]])
    wall = walls(BOTH[1:])
    distance = [nearest_wall(position, row, wall)[0] for row in range(3)]
    assert np.isinf(distance[:2]).all()
    assert distance[2] == pytest.approx(-0.2)
