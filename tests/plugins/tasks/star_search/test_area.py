"""The area of a search."""

from __future__ import annotations

from typing import Any

import pytest

from star_search.area import area_corners, area_problems
from tests.plugins.tasks.star_search.conftest import hall

TRIANGLE = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
BOX = {"low": [-1.0, 0.0], "high": [1.0, 1.5]}


@pytest.mark.parametrize(
    ("area", "corners"),
    [
        (None, ((-2, -2), (2, -2), (2, 2), (-2, 2))),
        (BOX, ((-1, 0), (1, 0), (1, 1.5), (-1, 1.5))),
        (TRIANGLE, ((0, 0), (1, 0), (0, 1))),
    ],
    ids=["the whole fence", "a box", "a polygon"],
)
def test_an_area_has_corners(area: Any, corners: Any) -> None:
    assert area_corners(hall(), area) == corners
    assert list(area_problems(hall(), area)) == []


def test_a_corner_outside_the_fence_is_refused() -> None:
    (problem,) = area_problems(hall(), [[0.0, 0.0], [2.5, 0.0], [0.0, 1.0]])
    assert (problem.path, problem.code) == (("area", 1), "outside-geofence")
    assert problem.message == "[2.5, 0] is outside the fence, from [-2, -2] to [2, 2]"


def test_an_outline_with_a_side_that_folds_back_is_refused() -> None:
    (problem,) = area_problems(hall(), [[0, 0], [1, 0], [0.5, 0]])
    assert (problem.path, problem.code) == (("area",), "invalid-outline")
    assert problem.message.endswith("give the corners in order around the area")


def test_a_corner_close_to_another_side_is_allowed() -> None:
    assert list(area_problems(hall(), [[0, 0], [1, 0], [0.5, 0.0001], [0.5, 1]])) == []
