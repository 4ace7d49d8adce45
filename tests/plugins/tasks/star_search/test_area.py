"""The area of a search."""

from __future__ import annotations

from typing import Any

import pytest

from star_search.area import area_corners, area_problems


def test_the_default_is_the_whole_fence(hall: Any) -> None:
    assert area_corners(hall(), None) == ((-2, -2), (2, -2), (2, 2), (-2, 2))


def test_a_box_has_four_corners(hall: Any) -> None:
    box = {"low": [-1.0, 0.0], "high": [1.0, 1.5]}
    assert area_corners(hall(), box) == ((-1, 0), (1, 0), (1, 1.5), (-1, 1.5))
    assert list(area_problems(hall(), box)) == []


def test_a_polygon_keeps_its_corners(hall: Any) -> None:
    triangle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    assert area_corners(hall(), triangle) == ((0, 0), (1, 0), (0, 1))
    assert list(area_problems(hall(), triangle)) == []


def test_a_box_with_low_above_high_is_refused(hall: Any) -> None:
    (problem,) = area_problems(hall(), {"low": [1.0, 0.0], "high": [-1.0, 1.0]})
    assert (problem.path, problem.code) == (("area",), "out-of-range")


def test_a_corner_outside_the_fence_is_refused(hall: Any) -> None:
    (problem,) = area_problems(hall(), [[0.0, 0.0], [2.5, 0.0], [0.0, 1.0]])
    assert (problem.path, problem.code) == (("area", 1), "outside-geofence")
    assert problem.message == "[2.5, 0] is outside the fence, from [-2, -2] to [2, 2]"
    (problem,) = area_problems(hall(), {"low": [-1, -1], "high": [3, 1]})
    assert problem.path == ("area", "high")


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0], [1, 1], [1, 0], [0, 1]],  # sides that cross
        [[0, 0], [1, 0], [0.5, 0]],  # a side that folds back
        [[0, 0], [1, 0], [1, 0], [0, 1]],  # a corner twice
    ],
)
def test_an_outline_that_is_no_polygon_is_refused(hall: Any, corners: Any) -> None:
    (problem,) = area_problems(hall(), corners)
    assert (problem.path, problem.code) == (("area",), "invalid-outline")
    assert problem.message.endswith("give the corners in order around the area")


def test_a_corner_close_to_another_side_is_allowed(hall: Any) -> None:
    assert list(area_problems(hall(), [[0, 0], [1, 0], [0.5, 0.0001], [0.5, 1]])) == []
