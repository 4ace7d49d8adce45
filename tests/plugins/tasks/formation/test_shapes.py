"""Places of formations."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_verbs.formation.shapes import Point, Shape, shape

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
    return shape(agents, {"centre": CENTRE, **options})


def near(place: tuple[Point, ...], expected: list[list[float]]) -> bool:
    return all(p == pytest.approx(e) for p, e in zip(place, expected, strict=True))


def test_a_line_lies_along_x_about_its_centre() -> None:
    place = made(3, shape="line", spacing=0.5).place
    assert near(place, [[0.5, -0.5, 0.8], [1.0, -0.5, 0.8], [1.5, -0.5, 0.8]])


def test_neighbours_are_60_cm_apart_if_nothing_is_said() -> None:
    assert made(2, shape="line").apart == 0.6


def test_a_grid_fills_rows_from_the_top_left() -> None:
    place = made(4, shape="grid", spacing=1.0).place
    assert near(place, [[0.5, 0.0, 0.8], [1.5, 0.0, 0.8], [0.5, -1.0, 0.8], [1.5, -1.0, 0.8]])


def test_a_grid_of_five_has_six_places() -> None:
    assert len(made(5, shape="grid").place) == 6


def test_a_grid_has_the_rows_and_columns_that_are_given() -> None:
    place = made(4, shape="grid", rows=4, columns=2, spacing=1.0).place
    assert len(place) == 8
    assert {round(x, 6) for x, _, _ in place} == {0.5, 1.5}


def test_a_circle_begins_at_its_greatest_x_and_goes_round() -> None:
    place = made(4, shape="circle", radius=2.0).place
    assert near(place, [[3.0, -0.5, 0.8], [1.0, 1.5, 0.8], [-1.0, -0.5, 0.8], [1.0, -2.5, 0.8]])


def test_a_circle_of_a_spacing_has_neighbours_so_far_apart() -> None:
    place = made(5, shape="circle", spacing=0.7).place
    assert math.dist(place[0], place[1]) == pytest.approx(0.7)


@pytest.mark.parametrize("name", ["line", "grid", "circle"])
def test_one_agent_gets_the_centre(name: str) -> None:
    figure = made(1, shape=name)
    assert near(figure.place, [CENTRE])
    assert figure.apart == math.inf


def test_points_are_turned_about_the_centre() -> None:
    place = made(1, shape="points", points=[[1.0, 0.0, 0.2]], yaw_deg=90).place
    assert near(place, [[1.0, 0.5, 1.0]])


def test_points_without_a_centre_lie_in_the_map() -> None:
    assert near(shape(1, {"shape": "points", "points": [[1, 2, 3]]}).place, [[1.0, 2.0, 3.0]])


def test_a_formation_moves_by_what_its_centre_moves() -> None:
    figure = made(2, shape="line", move={"to": [1.0, 0.5, 1.0]})
    assert figure.move == pytest.approx((0.0, 1.0, 0.2))
    assert figure.way == pytest.approx(math.hypot(1.0, 0.2))


@given(st.one_of(named, points), st.integers(1, 12), st.floats(-360, 360))
def test_no_two_places_are_nearer_than_is_said(
    options: dict[str, Any], agents: int, turn: float
) -> None:
    figure = made(agents, **options, yaw_deg=turn)
    pairs = combinations(figure.place, 2)
    least = min((math.dist(one, other) for one, other in pairs), default=math.inf)
    assert figure.apart == pytest.approx(least, abs=1e-9)


@given(named, st.integers(1, 12), st.floats(-360, 360))
def test_the_mean_of_the_places_is_the_centre(
    options: dict[str, Any], agents: int, turn: float
) -> None:
    place = made(agents, **options, yaw_deg=turn).place
    if options["shape"] == "circle" and agents == 1 and "radius" in options:
        return  # one place on a circle
    mean = [math.fsum(axis) / len(place) for axis in zip(*place, strict=True)]
    assert mean == pytest.approx(CENTRE, abs=1e-9)
