"""Outlines go round what stands together, at every height."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Fence, Obstacle, World
from star_core.world.outlines import wall
from star_orca.outlines import (
    A_JUTS,
    AX,
    AY,
    B_JUTS,
    LENGTH,
    MARGIN,
    UX,
    UY,
    Outlines,
    layer_at,
    outlines,
)

Polygon = tuple[tuple[float, float], ...]
SQUARE: Polygon = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


def of(*things: tuple[tuple[Polygon, ...], tuple[float, float]]) -> Outlines:
    fence = Fence((-10.0, -10.0, 0.0), (10.0, 10.0, 3.0))
    obstacles = tuple(Obstacle(f"thing {i}", *thing) for i, thing in enumerate(things))
    return outlines(World("room", fence, obstacles))


def at(outlines: Outlines, z: float) -> np.ndarray:
    """The edges at one height."""
    layer = layer_at(z, outlines.height)
    return outlines.edges[outlines.first[layer] : outlines.first[layer + 1]]


def test_an_empty_world_has_no_edges_at_any_height() -> None:
    outlines = of()
    assert [len(at(outlines, z)) for z in (-1.0, 0.0, 5.0)] == [0, 0, 0]


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1]])
def test_the_solid_is_left_of_every_edge_however_it_was_drawn(corners: Polygon) -> None:
    edges = at(of(((corners,), (0.0, 1.0))), 0.5)
    assert len(edges) == 4
    left = [0.5, 0.5] - edges[:, [AX, AY]]
    assert edges[:, UX] * left[:, 1] - edges[:, UY] * left[:, 0] == pytest.approx(0.5)


def test_outlines_extend_by_the_margin_below_and_above() -> None:
    outlines = of(((SQUARE,), (0.5, 1.0)))
    heights = (0.5 - MARGIN - 0.01, 0.5 - MARGIN + 0.01, 1.0 + MARGIN - 0.01, 1.0 + MARGIN + 0.01)
    assert [len(at(outlines, z)) for z in heights] == [0, 4, 4, 0]


def test_pieces_that_touch_are_one_solid_without_an_edge_between() -> None:
    other = tuple((x + 1.0, y) for x, y in SQUARE)
    edges = at(of(((SQUARE, other), (0.0, 1.0))), 0.5)
    assert sorted(edges[:, LENGTH]) == pytest.approx([1.0, 1.0, 2.0, 2.0])


def test_overlapping_obstacles_merge_at_their_shared_heights() -> None:
    other = tuple((x + 0.5, y + 0.5) for x, y in SQUARE)
    outlines = of(((SQUARE,), (0.0, 1.0)), ((other,), (0.0, 2.0)))
    assert [len(at(outlines, z)) for z in (0.5, 1.5, 2.5)] == [8, 4, 0]


def test_a_room_is_hollow() -> None:
    loop = wall([(0, 0), (2, 0), (2, 2), (0, 2), (0, 0)], 0.2)
    edges = at(of((loop, (0.0, 1.0))), 0.5)
    assert sorted(edges[:, LENGTH]) == pytest.approx([1.8] * 4 + [2.2] * 4)
    inner = edges[edges[:, LENGTH] < 2]
    centre = [1.0, 1.0] - inner[:, [AX, AY]]
    assert inner[:, UX] * centre[:, 1] - inner[:, UY] * centre[:, 0] == pytest.approx(-0.9)
    assert not inner[:, [A_JUTS, B_JUTS]].any()
