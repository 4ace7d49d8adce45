"""Two-dimensional linear program: the permitted velocity nearest to the preferred one.

Incremental linear programming after de Berg, Cheong, van Kreveld and Overmars, "Computational
Geometry" (3rd edition, 2008), chapter 4, as in RVO2. The constraints are half-planes, rows
``(a, b, c)`` that require ``a x + b y >= c``, and the speed limit ``x² + y² <= speed²``.
"""

from __future__ import annotations

import math

from star_core import Array
from star_core.toolkit import subroutine

# Sine of the angle below which two lines count as parallel. Far above the rounding error of equal
# lines (1e-16); the error it causes stays below a nanometre per second at flying speeds.
PARALLEL = 1e-10

# Length of the difference of two unit vectors below which they count as equal: far enough above
# rounding error that the difference, scaled to length 1, is still accurate to 1e-8.
ALIKE = 1e-8


@subroutine
def solve(
    planes: Array, count: int, hard: int, speed: float, x: float, y: float, scratch: Array
) -> tuple[float, float]:
    """Return the permitted velocity nearest to ``(x, y)``, or the least bad if none is permitted.

    A preferred velocity above the speed limit is scaled to it first. The least bad velocity
    minimizes the largest violation of a half-plane: "densely packed conditions" in van den Berg et
    al. (2011). Hard half-planes are not violated for the sake of the others, unless they exclude
    every velocity by themselves.

    Args:
        planes: (K, 3) half-planes, ``(a, b)`` of length 1.
        count: Number of these to use.
        hard: Number of these, the first, that are hard.
        speed: Speed limit, m/s.
        x: Preferred velocity along x, m/s.
        y: Preferred velocity along y, m/s.
        scratch: (K, 3) work buffer.
    """
    failed, x, y = nearest_free(planes, count, speed, x, y)
    if failed < count:
        kept_hard = hard if failed >= hard else 0
        x, y = least_bad(planes, count, kept_hard, failed, speed, x, y, scratch)
    return x, y


@subroutine
def nearest_free(
    planes: Array, count: int, speed: float, x: float, y: float
) -> tuple[int, float, float]:
    """Return `count` and the permitted velocity nearest to ``(x, y)``, within the speed limit.

    If none is permitted, return the first half-plane that excludes all, and the previous result.
    """
    squared = x * x + y * y
    if squared > speed * speed:
        scale = speed / math.sqrt(squared)
        x, y = x * scale, y * scale
    wish_x, wish_y = x, y
    for line in range(count):
        a, b, c = planes[line, 0], planes[line, 1], planes[line, 2]
        if a * x + b * y >= c:
            continue
        low, high = free_stretch(planes, line, speed)
        if low > high:
            return line, x, y
        along = min(max(b * wish_x - a * wish_y, low), high)
        x, y = a * c + b * along, b * c - a * along
    return count, x, y


@subroutine
def farthest_free(
    planes: Array, count: int, speed: float, x: float, y: float
) -> tuple[int, float, float]:
    """Return `count` and the permitted velocity farthest along the unit vector ``(x, y)``.

    If none is permitted, return the first half-plane that excludes all, and the previous result.
    Half-planes here may have ``(a, b)`` of any length; those that matter are scaled to length 1.
    """
    towards_x, towards_y = x, y
    x, y = x * speed, y * speed
    for line in range(count):
        if planes[line, 0] * x + planes[line, 1] * y >= planes[line, 2]:
            continue
        scale = 1.0 / math.sqrt(planes[line, 0] ** 2 + planes[line, 1] ** 2)
        a, b, c = planes[line, 0] * scale, planes[line, 1] * scale, planes[line, 2] * scale
        planes[line, 0], planes[line, 1], planes[line, 2] = a, b, c
        low, high = free_stretch(planes, line, speed)
        if low > high:
            return line, x, y
        along = high if b * towards_x - a * towards_y > 0.0 else low
        x, y = a * c + b * along, b * c - a * along
    return count, x, y


@subroutine
def free_stretch(planes: Array, line: int, speed: float) -> tuple[float, float]:
    """Return the interval of a half-plane's edge that the half-planes before it permit, m/s.

    It is measured along ``(b, -a)`` from the point of the edge nearest to the origin; if the
    interval is empty, the first number is greater than the second.
    """
    a, b, c = planes[line, 0], planes[line, 1], planes[line, 2]
    room = speed * speed - c * c
    if room < 0.0:
        return 1.0, -1.0
    high = math.sqrt(room)
    low = -high
    for other in range(line):
        slope = planes[other, 0] * b - planes[other, 1] * a
        rest = planes[other, 2] - c * (planes[other, 0] * a + planes[other, 1] * b)
        if abs(slope) <= PARALLEL:
            if rest > PARALLEL:
                return 1.0, -1.0
        elif slope > 0.0:
            low = max(low, rest / slope)
        else:
            high = min(high, rest / slope)
        if low > high:
            break
    return low, high


@subroutine
def least_bad(
    planes: Array,
    count: int,
    hard: int,
    first: int,
    speed: float,
    x: float,
    y: float,
    scratch: Array,
) -> tuple[float, float]:
    """Return the velocity that minimizes the largest violation of a half-plane.

    Half-planes are added one by one. If one is violated by more than any before it, the result
    moves to where that one is violated least among the velocities that violate no earlier one by
    more; "violated by no more than this one" is a half-plane again, the difference of the two.

    Args:
        planes: (K, 3) half-planes, ``(a, b)`` of length 1.
        count: Number of these to use.
        hard: Number of these, the first, that must not be violated.
        first: First half-plane that cannot be satisfied together with those before it.
        speed: Speed limit, m/s.
        x: Result for those before it, along x, m/s.
        y: The same along y, m/s.
        scratch: (K, 3) work buffer.
    """
    broken = 0.0
    for other in range(hard):
        scratch[other, 0], scratch[other, 1] = planes[other, 0], planes[other, 1]
        scratch[other, 2] = planes[other, 2]
    for line in range(first, count):
        a, b, c = planes[line, 0], planes[line, 1], planes[line, 2]
        if c - a * x - b * y <= broken:
            continue
        used = hard
        for other in range(hard, line):
            da, db = planes[other, 0] - a, planes[other, 1] - b
            if da * da + db * db <= ALIKE * ALIKE:
                continue  # the same way: moving along it mends both alike
            scratch[used, 0], scratch[used, 1] = da, db
            scratch[used, 2] = planes[other, 2] - c
            used += 1
        failed, to_x, to_y = farthest_free(scratch, used, speed, a, b)
        if failed == used:  # else rounding is at work, and the answer so far is as good
            x, y = to_x, to_y
        broken = c - a * x - b * y
    return x, y
