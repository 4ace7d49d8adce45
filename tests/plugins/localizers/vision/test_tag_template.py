"""What a tag looks like."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from star_apriltag.vision.guided_matching import Region, Template, template
from star_apriltag.vision.tag_poses import MapTag
from star_core import Array, Pose, Tag
from tests.plugins.localizers.vision.conftest import LENS, hovering, in_map, on_floor, paint

BODY = hovering(pitch=0.03, yaw=0.1)
TAG = on_floor(7, 0.8, 0.1, yaw=0.4)


def drawn(tag: Tag, region: Region, body: Pose = BODY) -> Template:
    pose = (body @ LENS.mounting).inverse() @ in_map(tag)
    return template(tag.id, tag.size, pose, LENS, region)


def outline(tag: Tag) -> Array:
    """Returns the (4, 2) corners of a tag's rim in the image."""
    pose = (BODY @ LENS.mounting).inverse() @ in_map(tag)
    return LENS.project(pose.apply(MapTag(tag).outline))


def around(tag: Tag) -> Region:
    pixels = outline(tag)
    (left, top), (right, bottom) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
    return Region(*(math.floor(edge) for edge in (left - 3, top - 3, right + 5, bottom + 5)))


@pytest.mark.parametrize("yaw", [0.4, 1.4, -2.0])
@pytest.mark.parametrize("x", [0.6, 0.9, 1.6])
def test_it_is_what_a_camera_sees(x: float, yaw: float) -> None:
    tag = on_floor(7, x, 0.1, yaw)
    region = around(tag)
    expected = drawn(tag, region)
    taken = paint(BODY, [tag])[region.top : region.bottom, region.left : region.right]
    inner = expected.paper > 0.99
    assert np.corrcoef(taken[inner], expected.gray[inner])[0, 1] > 0.97


def test_paper_fills_what_is_within_its_outline() -> None:
    paper = drawn(TAG, around(TAG)).paper
    whole = cv2.contourArea(outline(TAG).astype(np.float32))
    assert float(paper.sum()) == pytest.approx(whole, rel=0.01)


def test_the_code_is_six_tenths_of_the_paper_along_each_side() -> None:
    drawing = drawn(TAG, around(TAG))
    assert float(drawing.code.sum() / drawing.paper.sum()) == pytest.approx(0.36, rel=0.03)


def test_a_part_of_a_region_shows_a_part_of_the_tag() -> None:
    whole = around(TAG)
    left, top, right, bottom = whole
    part = Region(left + 10, top + 8, right - 9, bottom - 7)
    expected = drawn(TAG, whole).gray[8:-7, 10:-9]
    drawing = drawn(TAG, part).gray
    np.testing.assert_allclose(drawing[3:-3, 3:-3], expected[3:-3, 3:-3], atol=1e-3)


def test_where_the_lens_shows_nothing_there_is_no_paper() -> None:
    corner = Region(1, 1, 4, 4)  # where its model does not reach
    assert not drawn(on_floor(7, 0.8, 0.1, size=5.0), corner).paper.any()
