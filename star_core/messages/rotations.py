"""Rotations, poses and transforms between frames, and angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Self

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, Table, column, frozen, table

TINY: Final = 1e-9  # rad: a rotation that small is its first-order term


class Pose(NamedTuple):
    """Pose of a frame in another.

    Attributes:
        rotation: (3, 3) from the frame to the other.
        position: (3,) of its origin in the other, m.
    """

    rotation: Array
    position: Array

    def apply(self, points: Array) -> Array:
        """Return (..., 3) points of the frame, m, in the other frame."""
        moved: Array = points @ self.rotation.T + self.position
        return moved

    def __matmul__(self, inner: Pose) -> Pose:
        """Return the pose in the other frame of a frame with a pose in this one."""
        return Pose(self.rotation @ inner.rotation, self.rotation @ inner.position + self.position)

    def inverse(self) -> Pose:
        """Return the pose of the other frame in this one."""
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


@table()
class Transform(Table):
    """A transform for each agent: a rotation about z, then a translation.

    Attributes:
        yaw: rad.
        translation: m.
    """

    yaw: Array = column()
    translation: Array = column(3)

    def turn(self, vectors: Array) -> Array:
        """Rotate (N, 3) vectors, one per agent, without the translation.

        >>> quarter = Transform(np.array([np.pi / 2]), np.ones((1, 3)))
        >>> quarter.turn(np.array([[1.0, 0.0, 0.5]])).round(9)
        array([[0. , 1. , 0.5]])
        """
        return _turned(vectors, *_cos_sin(self.yaw))

    def turn_back(self, vectors: Array) -> Array:
        """Rotate (N, 3) vectors by the inverse, without the translation."""
        cos, sin = _cos_sin(self.yaw)
        return _turned(vectors, cos, -sin)

    def apply(self, points: Array) -> Array:
        """Transform (N, 3) points, one per agent."""
        return self.turn(points) + self.translation

    def inverse(self) -> Transform:
        """Return the inverse transform."""
        return Transform(-self.yaw, -self.turn_back(self.translation))

    def of(self, rows: Rows) -> Transform:
        """Return the transforms of some agents, in the order of `rows`."""
        return Transform(self.yaw[rows], self.translation[rows])

    def where(self, mask: Mask, other: Transform) -> Transform:
        """Return these transforms where an (N,) mask is True, and the `other` ones elsewhere."""
        translation = np.where(mask[:, None], self.translation, other.translation)
        return Transform(frozen(np.where(mask, self.yaw, other.yaw)), frozen(translation))

    @property
    def known(self) -> Mask:
        """(N,) agents whose transform is finite."""
        finite: Mask = np.isfinite(self.yaw) & np.isfinite(self.translation).all(axis=1)
        return finite


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
    quaternion = np.asarray(quaternion)
    x, y, z, w = (quaternion[..., axis] for axis in range(4))
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def quaternion_from_euler(roll: Any, pitch: Any, yaw: Any) -> Array:
    """Return (..., 4) unit quaternions x, y, z, w of (...,) roll, pitch and yaw, rad.

    Right-handed about the fixed axes x, y and z, in this order.

    >>> quaternion_from_euler(0.0, 0.0, np.pi).round(6) + 0.0
    array([0., 0., 1., 0.])
    """
    half = np.array([roll, pitch, yaw]) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    straight, both, pitched, yawed = cp * cy, sp * sy, sp * cy, cp * sy
    quaternion = np.empty((*half.shape[1:], 4))
    quaternion[..., 0] = sr * straight - cr * both
    quaternion[..., 1] = cr * pitched + sr * yawed
    quaternion[..., 2] = cr * yawed - sr * pitched
    quaternion[..., 3] = cr * straight + sr * both
    return quaternion


def _turned(vectors: Array, cos: Array, sin: Array) -> Array:
    """Rotate (N, 3) vectors about z by angles with (N,) cosines and sines."""
    turned = vectors.copy()
    x, y = vectors[:, 0], vectors[:, 1]
    turned[:, 0] = cos * x - sin * y
    turned[:, 1] = sin * x + cos * y
    return turned


_last: tuple[Array, Array, Array] | None = None  # angles, of a table, their cosines and sines


def _cos_sin(yaw: Array) -> tuple[Array, Array]:
    """Return the (N,) cosines and sines of (N,) angles of a table, which is read-only.

    Several stages of a tick need those of the same table.
    """
    global _last  # noqa: PLW0603 -- a result that is used again
    if _last is None or _last[0] is not yaw:
        _last = yaw, np.cos(yaw), np.sin(yaw)
    return _last[1], _last[2]


_IDENTITY = np.eye(3)
