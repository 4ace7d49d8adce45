"""What of the floor a camera makes out."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import Camera, Fence, Tag, World
from star_search.area import FieldOfView, field_of_view, swath
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.geometric import OnboardDetector

SIZE = 0.168
DOWN = replace(Camera(), pitch=math.pi / 2)
cameras = st.builds(lambda pitch: Camera(pitch=math.radians(pitch)), st.floats(30, 90))
heights = st.floats(0.4, 1.6)


@pytest.mark.parametrize("pitch", [35.0, 45.0, 70.0, 90.0])
def test_the_simulated_camera_finds_every_tag_in_view(pitch: float) -> None:
    camera = Camera(pitch=math.radians(pitch))
    level = (0.0, 0.0, 0.0, 1.0)
    body = Shot(np.array([0.0, 0.0, 0.8]), np.array(level), np.zeros(3), np.zeros(3))
    world = World("floor", Fence((-9, -9, 0), (9, 9, 3)))
    points = field_of_view(camera, 0.8, SIZE, 0.1).points
    assert len(points) > 10
    for i, j in product(range(3), repeat=2):  # every third cell: there tags do not overlap
        tags = [
            Tag(n, SIZE, (x, y, 0.0), (0.0, 0.0, math.sin(0.3), math.cos(0.3)), "target")
            for n, (x, y) in enumerate(points)
            if (round(x / 0.1) % 3, round(y / 0.1) % 3) == (i, j)
        ]
        ids = OnboardDetector(camera, tags, world).detect(body)[0].tolist()
        assert sorted(ids) == [tag.id for tag in tags]


def test_a_camera_that_looks_ahead_shows_what_is_ahead() -> None:
    view = field_of_view(Camera(), 0.8, SIZE, 0.1)
    assert 0.3 < view.near < view.far < 1.2
    assert view.reach >= view.far


def test_a_camera_that_looks_down_shows_what_is_below() -> None:
    assert (0.0, 0.0) in field_of_view(DOWN, 0.8, SIZE, 0.1).points


def test_a_camera_that_looks_up_shows_no_floor() -> None:
    assert field_of_view(Camera(pitch=math.radians(-60.0)), 0.8, SIZE, 0.1).points == ()


def test_tags_are_too_small_from_too_high() -> None:
    assert field_of_view(DOWN, 4.0, SIZE, 0.1).points == ()


@given(cameras, heights, st.floats(1.1, 2.0))
def test_a_larger_tag_is_made_out_farther_away(camera: Camera, height: float, more: float) -> None:
    small, large = (
        field_of_view(camera, height, 0.1, 0.1),
        field_of_view(camera, height, 0.1 * more, 0.1),
    )
    assert large.reach >= small.reach - 0.15  # it may not lie wholly in the image any more


@given(cameras, heights, st.floats(0.1, 1.0), st.floats(1.0, 3.0))
def test_an_agent_that_flies_faster_sees_no_wider_strip(
    camera: Camera, height: float, speed: float, times: float
) -> None:
    view = field_of_view(camera, height, SIZE, 0.05)
    assert swath(view, times * speed, 10.0) <= swath(view, speed, 10.0)


@given(cameras, heights)
def test_a_strip_is_no_wider_than_the_view(camera: Camera, height: float) -> None:
    view = field_of_view(camera, height, SIZE, 0.05)
    width = max((y for _, y in view.points), default=0) - min(
        (y for _, y in view.points), default=0
    )
    assert swath(view, 0.3, 10.0) <= width + 0.05 + 1e-9


def test_nothing_in_view_is_no_strip() -> None:
    assert swath(FieldOfView((0, 0, 1), (), 0.05), 0.3, 10.0) == 0.0


def test_a_shrunk_view_lies_a_cell_within() -> None:
    whole = field_of_view(Camera(), 0.8, SIZE, 0.1)
    cells = {(round(x / 0.1), round(y / 0.1)) for x, y in whole.points}
    inner = whole.eroded().points
    assert 0 < len(inner) < len(whole.points)
    assert all(
        (round(x / 0.1) + i, round(y / 0.1) + j) in cells
        for x, y in inner
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
    )


def test_a_view_without_inner_cells_is_not_shrunk_to_nothing() -> None:
    thin = FieldOfView((0.0, 0.0, 1.0), ((0.0, 0.0), (0.1, 0.0)), 0.1)
    assert thin.eroded() == thin
