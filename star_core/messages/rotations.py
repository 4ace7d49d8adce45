"""Rotations and poses in three dimensions, and angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Self

import numpy as np

from star_core.messages.arrays import Array

TINY: Final = 1e-9  # rad: a rotation that small is its first-order term


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
        """Return the pose after a rotation and a shift in the frame itself.

        Args:
            step: (6,) rotation vector, rad, then shift, m.
        """
        return self._replace(
            rotation=self.rotation @ rotation_from_vector(step[:3]),
            position=self.position + self.rotation @ step[3:],
        )

    @property
    def yaw(self) -> float:
        """Direction of the frame's x axis in the other's x-y plane, rad."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))


def wrap_angle(angle: Any) -> Any:
    """Return the same angle, or angles, from -pi to less than pi, rad.

    It is plain arithmetic: numba compiles it, and it takes numbers as well as arrays.

    >>> wrap_angle(np.array([1.5, -0.5]) * np.pi).round(3)
    array([-1.571, -1.571])
    """
    return (angle + math.pi) % math.tau - math.pi


def skew(vectors: Array) -> Array:
    """Return the (..., 3, 3) matrices that take the cross product with (..., 3) vectors.

    >>> skew(np.array([1.0, 0.0, 0.0])) @ np.array([0.0, 1.0, 0.0])
    array([0., 0., 1.])
    """
    matrix = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix


def rotation_from_vector(vector: Array) -> Array:
    """Return the (3, 3) rotation about a (3,) vector by its length, rad: Rodrigues' formula.

    >>> rotation_from_vector(np.array([0.0, 0.0, np.pi / 2])).round(9) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    angle = math.sqrt(vector @ vector)
    k = skew(vector)
    if angle < TINY:
        first: Array = _IDENTITY + k
        return first
    half = math.sin(angle / 2) / angle
    rotation: Array = _IDENTITY + math.sin(angle) / angle * k + 2 * half * half * (k @ k)
    return rotation


def rotation_from_quaternion(quaternion: Sequence[float] | Array) -> Array:
    """Return the (3, 3) rotation of a (4,) unit quaternion x, y, z, w.

    >>> rotation_from_quaternion((0.0, 0.0, 1.0, 0.0))
    array([[-1.,  0.,  0.],
           [ 0., -1.,  0.],
           [ 0.,  0.,  1.]])
    """
    *vector, w = quaternion
    k = skew(np.array(vector))
    rotation: Array = _IDENTITY + 2 * w * k + 2 * (k @ k)
    return rotation


def yaw_from_quaternion(quaternion: Sequence[float] | Array) -> Any:
    """Return the yaw of (..., 4) unit quaternions x, y, z, w, from -pi to pi, rad: (...,).

    >>> round(float(yaw_from_quaternion((0.0, 0.0, 1.0, 0.0))), 3)
    3.142
    """
    x, y, z, w = np.moveaxis(np.asarray(quaternion), -1, 0)
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def quaternion_from_euler(roll: Any, pitch: Any, yaw: Any) -> Array:
    """Return (..., 4) unit quaternions x, y, z, w of (...,) roll, pitch and yaw, rad.

    Right-handed about the fixed axes x, y and z, in this order.

    >>> quaternion_from_euler(0.0, 0.0, np.pi).round(6) + 0.0
    array([0., 0., 1., 0.])
    """
    half = np.stack([roll, pitch, yaw]) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    straight, both, pitched, yawed = cp * cy, sp * sy, sp * cy, cp * sy
    return np.stack(
        [
            sr * straight - cr * both,
            cr * pitched + sr * yawed,
            cr * yawed - sr * pitched,
            cr * straight + sr * both,
        ],
        axis=-1,
    )


_IDENTITY = np.eye(3)
