"""Pieces of trajectories: polynomials and their derivatives. Nothing here imports numpy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from star_core.messages.arrays import Array


def polynomial(coefficients: Any, x: Any) -> tuple[Any, Any, Any]:
    """Return a polynomial's value and its first and second derivative at `x`, by Horner's rule.

    It is plain arithmetic: numba compiles it, and it takes numbers as well as arrays.

    Args:
        coefficients: (K,) or (K, ...) the constant first.
        x: A number, or an array that broadcasts with one coefficient.

    Example:
        >>> polynomial((1.0, 2.0, 3.0), 2.0)
        (17.0, 14.0, 6.0)
    """
    value = first = half = 0.0
    for power in range(len(coefficients) - 1, -1, -1):
        half = half * x + first
        first = first * x + value
        value = value * x + coefficients[power]
    return value, first, 2 * half


def transformed(coefficients: Array, yaw: float, shift: Any = 0.0) -> Array:
    """Return pieces of a trajectory in another frame: turned about z, then shifted.

    Args:
        coefficients: (..., 4, K) of x, y, z, m, and yaw, rad, the constant first.
        yaw: Angle about the origin, rad; the headings are turned with it.
        shift: (3,) m.

    Returns:
        (..., 4, K) coefficients over the same variable.
    """
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = coefficients[..., 0, :], coefficients[..., 1, :]
    result = coefficients.copy()
    result[..., 0, :] = cos * x - sin * y
    result[..., 1, :] = sin * x + cos * y
    result[..., :3, 0] += shift
    result[..., 3, 0] += yaw
    return result
