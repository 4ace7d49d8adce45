"""The area to search, as a mission gives it."""

from __future__ import annotations

from typing import Any

from star_search.area import corners, faults


def test_the_whole_fence_is_searched_if_nothing_is_said(hall: Any) -> None:
    assert corners(hall(), None) == ((-2, -2), (2, -2), (2, 2), (-2, 2))


def test_a_box_has_four_corners(hall: Any) -> None:
    box = {"low": [-1.0, 0.0], "high": [1.0, 1.5]}
    assert corners(hall(), box) == ((-1, 0), (1, 0), (1, 1.5), (-1, 1.5))
    assert list(faults(hall(), box)) == []


def test_a_polygon_is_taken_as_it_is(hall: Any) -> None:
    triangle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    assert corners(hall(), triangle) == ((0, 0), (1, 0), (0, 1))
    assert list(faults(hall(), triangle)) == []


def test_a_box_that_is_the_wrong_way_round_is_told(hall: Any) -> None:
    ((path, message),) = faults(hall(), {"low": [1.0, 0.0], "high": [-1.0, 1.0]})
    assert (path, message) == ((), "low [1.0, 0.0] is not below high [-1.0, 1.0] in x and y")


def test_a_corner_outside_the_fence_is_told_with_its_place(hall: Any) -> None:
    ((path, message),) = faults(hall(), [[0.0, 0.0], [2.5, 0.0], [0.0, 1.0]])
    assert path == (1,)
    assert message == "[2.5, 0] is outside the fence, from [-2, -2] to [2, 2]"
    ((path, _),) = faults(hall(), {"low": [-1, -1], "high": [3, 1]})
    assert path == ("high",)


def test_sides_that_cross_are_told(hall: Any) -> None:
    ((path, message),) = faults(hall(), [[0, 0], [1, 1], [1, 0], [0, 1]])
    assert path == (2,)
    assert message == (
        "the side from corner 3 meets the side from corner 1; "
        "give the corners in order around the area"
    )


def test_a_side_that_folds_back_is_told(hall: Any) -> None:
    ((path, message),) = faults(hall(), [[0, 0], [1, 0], [0.5, 0]])
    assert message.endswith("give the corners in order around the area")
    assert path == (1,)


def test_a_corner_twice_is_told(hall: Any) -> None:
    ((path, message),) = faults(hall(), [[0, 0], [1, 0], [1, 0], [0, 1]])
    assert (path, message) == ((1,), "corner 2 is the same as the next one")


def test_a_corner_that_touches_another_side_is_told(hall: Any) -> None:
    assert list(faults(hall(), [[0, 0], [1, 0], [0.5, 0.0001], [0.5, 1]])) == []
    assert len(list(faults(hall(), [[0, 0], [1, 0], [1, 1], [0.5, 0], [0, 1]]))) == 1
