"""Poses: where one frame lies in another."""

from __future__ import annotations

import math
from typing import Final, NamedTuple, Self

import numpy as np

from star_core import Array

TINY: Final = 1e-9  # rad: a turn that small is its first term


class Pose(NamedTuple):
    """Where a frame lies in another.

    Attributes:
        rotation: (3, 3) from the frame to the other.
        position: (3,) its origin in the other, m.
    """

    rotation: Array
    position: Array

    def apply(self, points: Array) -> Array:
        """Return (..., 3) points of the frame as the other has them, m."""
        there: Array = points @ self.rotation.T + self.position
        return there

    def __matmul__(self, inner: Pose) -> Pose:
        """Return where a frame that lies in this one lies in the other."""
        return Pose(self.rotation @ inner.rotation, self.rotation @ inner.position + self.position)

    def inverse(self) -> Pose:
        """Return where the other frame lies in this one."""
        return Pose(self.rotation.T, -self.position @ self.rotation)

    def moved(self, step: Array) -> Self:
        """Return the pose after a turn and a shift in the frame itself.

        Args:
            step: (6,) rotation vector, rad, then shift, m.
        """
        return self._replace(
            rotation=self.rotation @ turn(step[:3]),
            position=self.position + self.rotation @ step[3:],
        )

    @property
    def yaw(self) -> float:
        """Direction of the frame's x axis in the other's x-y plane, rad."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))


def turn(vector: Array) -> Array:
    """Return the (3, 3) rotation about a (3,) vector by its length, rad: Rodrigues' formula.

    >>> turn(np.array([0.0, 0.0, np.pi / 2])).round(9) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    angle = math.sqrt(vector @ vector)
    k = cross(vector)
    if angle < TINY:
        first: Array = _NO_TURN + k
        return first
    half = math.sin(angle / 2) / angle
    rotation: Array = _NO_TURN + math.sin(angle) / angle * k + 2 * half * half * (k @ k)
    return rotation


def cross(vectors: Array) -> Array:
    """Return the (..., 3, 3) matrices that take the cross product with (..., 3) vectors.

    >>> cross(np.array([1.0, 0.0, 0.0])) @ np.array([0.0, 1.0, 0.0])
    array([0., 0., 1.])
    """
    matrix = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix


def matrix(rotation: tuple[float, float, float, float]) -> Array:
    """Return the (3, 3) rotation of a unit quaternion x, y, z, w.

    >>> matrix((0.0, 0.0, 1.0, 0.0))
    array([[-1.,  0.,  0.],
           [ 0., -1.,  0.],
           [ 0.,  0.,  1.]])
    """
    *vector, w = rotation
    k = cross(np.array(vector))
    turned: Array = np.eye(3) + 2 * w * k + 2 * (k @ k)
    return turned


_NO_TURN = np.eye(3)
