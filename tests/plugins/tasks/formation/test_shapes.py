"""Positions of formations."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core.toolkit import fill_defaults
from star_verbs.formation.shapes import Shape, shape
from star_verbs.formation.spec import OPTIONS
from star_verbs.positions import Point

CENTRE = [1.0, -0.5, 0.8]
sizes = st.floats(0.1, 5.0)
named = st.one_of(
    st.fixed_dictionaries({"shape": st.just("line"), "spacing": sizes}),
    st.fixed_dictionaries({"shape": st.just("grid"), "spacing": sizes}),
    st.fixed_dictionaries({"shape": st.just("circle"), "spacing": sizes}),
    st.fixed_dictionaries({"shape": st.just("circle"), "radius": sizes}),
)
offsets = st.tuples(*[st.floats(-5, 5)] * 3)
points = st.lists(offsets, min_size=1, max_size=6).map(lambda p: {"shape": "points", "points": p})


def made(agents: int, **options: Any) -> Shape:
    return shape(agents, fill_defaults({"centre": CENTRE, **options}, OPTIONS))


def near(position: tuple[Point, ...], expected: list[list[float]]) -> bool:
    return all(p == pytest.approx(e) for p, e in zip(position, expected, strict=True))


def test_a_line_lies_along_x_about_its_centre() -> None:
    position = made(3, shape="line", spacing=0.5).position
    assert near(position, [[0.5, -0.5, 0.8], [1.0, -0.5, 0.8], [1.5, -0.5, 0.8]])


def test_neighbours_are_60_cm_apart_by_default() -> None:
    assert made(2, shape="line").min_distance == 0.6


def test_a_grid_fills_rows_from_the_top_left() -> None:
    position = made(4, shape="grid", spacing=1.0).position
    assert near(position, [[0.5, 0.0, 0.8], [1.5, 0.0, 0.8], [0.5, -1.0, 0.8], [1.5, -1.0, 0.8]])


def test_a_grid_of_five_has_six_positions() -> None:
    assert len(made(5, shape="grid").position) == 6


def test_a_grid_has_the_rows_and_columns_that_are_given() -> None:
    position = made(4, shape="grid", rows=4, columns=2, spacing=1.0).position
    assert len(position) == 8
    assert {round(x, 6) for x, _, _ in position} == {0.5, 1.5}


def test_a_circle_begins_at_its_greatest_x_and_goes_round() -> None:
    position = made(4, shape="circle", radius=2.0).position
    assert near(position, [[3.0, -0.5, 0.8], [1.0, 1.5, 0.8], [-1.0, -0.5, 0.8], [1.0, -2.5, 0.8]])


def test_a_circle_of_a_spacing_has_neighbours_so_far_apart() -> None:
    position = made(5, shape="circle", spacing=0.7).position
    assert math.dist(position[0], position[1]) == pytest.approx(0.7)


@pytest.mark.parametrize("name", ["line", "grid", "circle"])
def test_one_agent_gets_the_centre(name: str) -> None:
    figure = made(1, shape=name)
    assert near(figure.position, [CENTRE])
    assert figure.min_distance == math.inf


def test_points_are_turned_about_the_centre() -> None:
    position = made(1, shape="points", points=[[1.0, 0.0, 0.2]], yaw_deg=90).position
    assert near(position, [[1.0, 0.5, 1.0]])


def test_points_without_a_centre_lie_in_the_map() -> None:
    assert near(shape(1, {"shape": "points", "points": [[1, 2, 3]]}).position, [[1.0, 2.0, 3.0]])


def test_a_formation_moves_by_what_its_centre_moves() -> None:
    figure = made(2, shape="line", move={"to": [1.0, 0.5, 1.0]})
    assert figure.move == pytest.approx((0.0, 1.0, 0.2))
    assert figure.move_distance == pytest.approx(math.hypot(1.0, 0.2))


@given(st.one_of(named, points), st.integers(1, 12), st.floats(-360, 360))
def test_the_least_distance_is_that_of_the_closest_two_positions(
    options: dict[str, Any], agents: int, turn: float
) -> None:
    figure = made(agents, **options, yaw_deg=turn)
    pairs = combinations(figure.position, 2)
    least = min((math.dist(position, other) for position, other in pairs), default=math.inf)
    assert figure.min_distance == pytest.approx(least, abs=1e-9)


@given(named, st.integers(1, 12), st.floats(-360, 360))
def test_the_mean_of_the_positions_is_the_centre(
    options: dict[str, Any], agents: int, turn: float
) -> None:
    position = made(agents, **options, yaw_deg=turn).position
    if options["shape"] == "circle" and agents == 1 and "radius" in options:
        return  # one position on a circle
    mean = [math.fsum(axis) / len(position) for axis in zip(*position, strict=True)]
    assert mean == pytest.approx(CENTRE, abs=1e-9)
