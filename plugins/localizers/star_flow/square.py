"""Where a square of known size lies before a camera, from its four corners."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from star_core import Array

HALVES: Final = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
"""Corners of a square of edge 1: bottom left, bottom right, top right, top left."""

ROUNDS: Final = 10  # of Gauss and Newton, at most
SETTLED: Final = 1e-6  # m and rad: a smaller step is the last one
MOST_MISFIT: Final = 3.0  # deviations of a corner, root mean square, with which a square fits
LYING: Final = (
    6.0  # squared deviations by which corners must speak for a square that stands upright
)
WILD: Final = 100.0  # m and rad: a greater step leads nowhere
LEAST_SIDE: Final = 1e-9  # of corners that are no point
LEAST_VOLUME: Final = 1e-9  # of three corners' rays: with less they lie in one plane


class Lying(NamedTuple):
    """How a square lies in the camera's frame.

    Attributes:
        position: (3,) its centre, m.
        rotation: (3, 3) from its frame to the camera's.
        covariance: (3, 3) of the position, m².
        surprise: Sum of the squares of what its corners are off, in deviations.
    """

    position: Array
    rotation: Array
    covariance: Array
    surprise: float


def lying(rays: Array, size: float, up: Array, deviation: float) -> Lying | None:
    """Return how a square lies whose corners are seen, or None if no square looks so.

    It is the pose with the least squares of what its corners are off, found by Gauss's and Newton's
    method from two beginnings: where the corners lie level, as those of a sheet on the floor do,
    and where they make a parallelogram, which their rays alone say. A small square looks nearly the
    same from two sides: what lies level is preferred.

    Args:
        rays: (4, 2) x / z and y / z of its corners: bottom left, bottom right, top right, top left.
        size: Its edge, m.
        up: (3,) unit vector against gravity in the camera's frame.
        deviation: Of each coordinate of the rays.
    """
    ahead = np.hstack([rays, np.ones((4, 1))])
    with np.errstate(all="ignore"):  # what is no square may lead anywhere
        beginnings = (_level(ahead, up), _parallelogram(ahead))
        found = [
            one
            for depths in beginnings
            if depths is not None
            and (first := _square(ahead * depths[:, None], size))
            and (one := _refined(first, rays, size, deviation))
        ]
    return min(found, key=lambda one: one.surprise - LYING * one.rotation[:, 2] @ up, default=None)


def _level(ahead: Array, up: Array) -> Array | None:
    """The depths, up to a factor, with which the corners lie in one level plane."""
    below = -(ahead @ up)
    return 1 / below if (below > 0).all() else None


def _parallelogram(ahead: Array) -> Array | None:
    """The depths, up to a factor, with which the corners are those of a parallelogram.

    Its diagonals halve each other: ``d0 r0 + d2 r2 = d1 r1 + d3 r3``.
    """
    sides = np.stack([ahead[0], -ahead[1], ahead[2]], axis=1)
    if not abs(np.linalg.det(sides)) > LEAST_VOLUME:
        return None
    depths = np.append(np.linalg.solve(sides, ahead[3]), 1.0)
    return depths if (depths > 0).all() else None


def _square(corners: Array, size: float) -> tuple[Array, Array] | None:
    """The centre and the axes of the square that four points, up to a factor, are most like.

    None if the points do not tell two sides.
    """
    right = corners[1] + corners[2] - corners[0] - corners[3]
    top = corners[2] + corners[3] - corners[0] - corners[1]
    long, high = math.sqrt(right @ right), math.sqrt(top @ top)
    if not (LEAST_SIDE < long < math.inf and LEAST_SIDE < high < math.inf):
        return None
    centre = corners.mean(axis=0) * (4 * size / (long + high))
    u, _, v = np.linalg.svd(np.stack([right / long, top / high], axis=1), full_matrices=False)
    x, y = (u @ v).T
    return centre, np.stack([x, y, np.cross(x, y)], axis=1)


def _refined(
    first: tuple[Array, Array], rays: Array, size: float, deviation: float
) -> Lying | None:
    """The pose near a first one that fits best, or None if it does not fit."""
    centre, axes = first
    for _ in range(ROUNDS):
        out = size * HALVES @ axes.T  # (4, 3)
        x, y, z = (out + centre).T
        if not (z > 0).all():
            return None
        seen = np.stack([x / z, y / z], axis=1)
        by_place = np.zeros((4, 2, 3))
        by_place[:, 0, 0] = by_place[:, 1, 1] = 1 / z
        by_place[:, :, 2] = -seen / z[:, None]
        by_turn = np.cross(out[:, None], by_place)  # row g moves by g . (w x o) = w . (o x g)
        rows = np.concatenate([by_place, by_turn], axis=2).reshape(8, 6)
        off = (rays - seen).ravel()
        try:
            inverse = np.linalg.inv(rows.T @ rows)
        except np.linalg.LinAlgError:  # seen from its edge
            return None
        step = inverse @ rows.T @ off
        if not np.abs(step).max() < WILD:
            return None
        centre = centre + step[:3]
        axes = _turn(step[3:]) @ axes
        if np.abs(step).max() < SETTLED:
            break
    surprise = float(off @ off) / deviation**2
    if surprise > 8 * MOST_MISFIT**2 or axes[:, 2] @ centre >= 0:  # its back is blank
        return None
    return Lying(centre, axes, inverse[:3, :3] * deviation**2, surprise)


def _turn(by: Array) -> Array:
    """The rotation by a vector, rad (Rodrigues)."""
    angle = math.sqrt(by @ by)
    if angle == 0:
        return np.eye(3)
    x, y, z = by / angle
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Array = np.eye(3) + math.sin(angle) * across + (1 - math.cos(angle)) * across @ across
    return turned
