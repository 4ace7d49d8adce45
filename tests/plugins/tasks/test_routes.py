"""Lines to fly along, and the shapes that have a name."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_verbs.follow.routes import Polyline, closed_path, intervals, length

coordinates = st.floats(-10, 10).map(lambda value: round(value, 3))
points = st.tuples(coordinates, coordinates, coordinates)
lines = st.lists(points, min_size=2, max_size=8).filter(lambda line: len(set(line)) > 1)
shares = st.floats(0, 1)


@given(lines, shares, shares)
def test_path_points_are_no_farther_apart_than_along_the_path(
    line: list[tuple[float, float, float]], share: float, other: float
) -> None:
    path = Polyline(line)
    distance = np.array([share, other]) * path.length
    a, b = path.at(distance)[0]
    # A closed line begins anew at its end, which is the same point.
    assert np.linalg.norm(a - b) <= abs(distance[0] - distance[1]) + 1e-6


@given(lines, shares)
def test_every_point_lies_on_the_line(line: list[tuple[float, float, float]], share: float) -> None:
    (point,), _ = Polyline(line).at(np.array([share * length(line)]))
    gaps = [
        math.dist(a, point) + math.dist(point, b) - math.dist(a, b)
        for a, b in itertools.pairwise(line)
    ]
    assert min(gaps) == pytest.approx(0.0, abs=1e-6)


@given(lines, shares)
def test_the_tangent_has_unit_length(line: list[tuple[float, float, float]], share: float) -> None:
    path = Polyline(line)
    _, (tangent,) = path.at(np.array([share * path.length]))
    assert np.linalg.norm(tangent) == pytest.approx(1.0)


@given(lines)
def test_a_path_is_as_long_as_its_line(line: list[tuple[float, float, float]]) -> None:
    assert Polyline(line).length == pytest.approx(length(line))


def test_segments_may_be_so_short_that_squares_underflow() -> None:
    point, tangent = Polyline([(0.0, 0.0, 0.0), (1e-308, 0.0, 0.0), (1.0, 0.0, 0.0)]).at(
        np.array([0.0, 0.5])
    )
    assert point == pytest.approx(np.array([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)]))
    assert tangent == pytest.approx(np.array([(1.0, 0.0, 0.0)] * 2))


def test_an_open_path_ends_at_its_ends() -> None:
    point, _ = Polyline([(0, 0, 1), (2, 0, 1)]).at(np.array([-1.0, 5.0]))
    assert point.tolist() == [[0, 0, 1], [2, 0, 1]]


def test_a_closed_path_goes_round_and_round() -> None:
    path = Polyline(closed_path("box", 1.0, (0, 0, 1)))
    point, tangent = path.at(np.array([0.5, 4.5, 9.0]))
    assert point == pytest.approx(np.array([[0, -0.5, 1], [0, -0.5, 1], [0.5, -0.5, 1]]))
    assert tangent == pytest.approx(np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0]]))


def test_headings_go_the_shorter_way_round() -> None:
    yaw = Polyline([(0, 0, 1), (2, 0, 1)], [170, -170]).yaw(np.array([0.5]))
    assert yaw is not None
    assert np.degrees(yaw) == pytest.approx([175])


def test_a_point_given_twice_is_passed_once_with_its_heading() -> None:
    path = Polyline([(0, 0, 1), (0, 0, 1), (2, 0, 1)], [0, 90, 40])
    yaw = path.yaw(np.array([1.0]))
    assert yaw is not None
    assert (path.length, np.degrees(yaw)[0]) == (2.0, pytest.approx(20))


@pytest.mark.parametrize(
    ("name", "expected"), [("box", 8.0), ("circle", 2 * math.pi), ("figure8", 6.097)]
)
def test_a_lap_is_as_long_as_its_curve(name: str, expected: float) -> None:
    # The lemniscate of Gerono with a = 1 has an arc length of 6.0972 (by numerical quadrature).
    assert length(closed_path(name, 2.0, (0, 0, 1))) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(("name", "wide"), [("box", 3.0), ("circle", 3.0), ("figure8", 1.5)])
def test_the_size_is_how_long_a_shape_is(name: str, wide: float) -> None:
    point = np.array(closed_path(name, 3.0, (1.0, 2.0, 0.8)))
    assert np.ptp(point, axis=0) == pytest.approx([3.0, wide, 0.0])
    assert (point.max(axis=0) + point.min(axis=0)) / 2 == pytest.approx([1.0, 2.0, 0.8])


@given(st.sampled_from(["box", "circle", "figure8"]), st.floats(0.1, 20), points)
def test_shapes_are_closed(name: str, size: float, centre: tuple[float, float, float]) -> None:
    point = closed_path(name, size, centre)
    assert point[0] == point[-1]


def test_an_even_number_on_the_figure_8_leaves_an_interval_free() -> None:
    assert [intervals("figure8", n) for n in (1, 2, 3, 4)] == [1, 3, 3, 5]
