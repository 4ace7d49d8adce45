"""Meshes of obstacles, and edges of boxes."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Obstacle
from star_core.toolkit import box_edges, obstacle_meshes


def test_an_obstacle_has_its_sides_and_its_top() -> None:
    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0))
    ((vertices, faces),) = obstacle_meshes(Obstacle("corner", (corners,), (0.0, 2.0)))
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(8 * 2 + 3)  # sides and top


def test_the_edges_of_a_box_join_its_corners() -> None:
    edges = box_edges((-1.0, 0.0, 0.0), (1.0, 3.0, 4.0))
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert sorted(lengths) == pytest.approx([2.0] * 4 + [3.0] * 4 + [4.0] * 4)
    assert len({tuple(corner) for corner in edges.reshape(-1, 3)}) == 8
