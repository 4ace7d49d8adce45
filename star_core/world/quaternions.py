"""Rotations as quaternions of plain numbers, for files that are read without numpy."""

from __future__ import annotations

import math
from typing import TypeAlias

Point: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
"""x, y, z, w, of unit length."""


def turned(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the rotation about x by `roll`, then about y by `pitch`, then about z by `yaw`, rad.

    >>> [round(value, 3) for value in turned(0.0, 0.0, math.pi / 2)]
    [0.0, 0.0, 0.707, 0.707]
    """
    sx, cx = math.sin(roll / 2), math.cos(roll / 2)
    sy, cy = math.sin(pitch / 2), math.cos(pitch / 2)
    sz, cz = math.sin(yaw / 2), math.cos(yaw / 2)
    return (
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
        cx * cy * cz + sx * sy * sz,
    )


def moved(rotation: Quaternion, vector: Point) -> Point:
    """Rotate a vector.

    >>> [round(value, 3) for value in moved(turned(0.0, 0.0, math.pi / 2), (1.0, 0.0, 2.0))]
    [0.0, 1.0, 2.0]
    """
    x, y, z, w = rotation
    a, b, c = vector
    p, q, r = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p)


def product(second: Quaternion, first: Quaternion) -> Quaternion:
    """Return the rotation by `first` and then by `second`."""
    ax, ay, az, aw = second
    bx, by, bz, bw = first
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
