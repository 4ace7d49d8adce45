"""The velocity nearest to the wish that half-planes and a greatest speed leave, in two dimensions.

Incremental linear programming after de Berg, Cheong, van Kreveld and Overmars, "Computational
Geometry" (3rd edition, 2008), chapter 4, in the way RVO2 goes about it. A half-plane is a row
``(a, b, c)`` that says ``a x + b y >= c``; the speed says ``x² + y² <= speed²``.
"""

from __future__ import annotations

import math

from star_core import Array, compiled

# Sine of the angle below which two lines count as parallel. Far above what rounding makes of equal
# lines (1e-16), and what is overlooked stays below a nanometre per second at flying speeds.
PARALLEL = 1e-10

# Length of the difference of two unit vectors below which they count as one: far enough above
# rounding that the difference, scaled to length 1, is still good to 1e-8.
ALIKE = 1e-8


@compiled
def solve(
    planes: Array, count: int, hard: int, speed: float, x: float, y: float, scratch: Array
) -> tuple[float, float]:
    """Return the free velocity nearest to the wish ``(x, y)``, or the least bad if none is free.

    A wish above the greatest speed is cut to it first. Least bad is what breaks the worst
    half-plane least: "densely packed conditions" in van den Berg et al. (2011); hard half-planes
    are not broken for the sake of the others, unless they leave nothing free by themselves.

    Args:
        planes: (K, 3) half-planes, ``(a, b)`` of length 1.
        count: How many of these to use.
        hard: How many of these, the first, are hard.
        speed: Greatest speed, m/s.
        x: Wanted velocity along x, m/s.
        y: Wanted velocity along y, m/s.
        scratch: (K, 3) room to work in.
    """
    failed, x, y = nearest_free(planes, count, speed, x, y)
    if failed < count:
        held = hard if failed >= hard else 0
        x, y = least_bad(planes, count, held, failed, speed, x, y, scratch)
    return x, y


@compiled
def nearest_free(
    planes: Array, count: int, speed: float, x: float, y: float
) -> tuple[int, float, float]:
    """Return `count` and the free velocity nearest to ``(x, y)`` cut to the greatest speed.

    If no velocity is free, return the first half-plane that leaves none, and the answer before it.
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


@compiled
def farthest_free(
    planes: Array, count: int, speed: float, x: float, y: float
) -> tuple[int, float, float]:
    """Return `count` and the free velocity farthest along the unit vector ``(x, y)``.

    If no velocity is free, return the first half-plane that leaves none, and the answer before it.
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


@compiled
def free_stretch(planes: Array, line: int, speed: float) -> tuple[float, float]:
    """Return from where to where the edge of a half-plane is left free by those before it, m/s.

    It is measured along ``(b, -a)`` from the point of the edge nearest to the origin; where
    nothing is free the first number is greater than the second.
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


@compiled
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
    """Return the velocity that breaks the worst half-plane least.

    Half-planes are added one by one. Where one is broken by more than any before it, the answer
    moves to where that one is broken least among the velocities that break no earlier one by more;
    "broken by no more than this one" is a half-plane again, the difference of the two.

    Args:
        planes: (K, 3) half-planes, ``(a, b)`` of length 1.
        count: How many of these to use.
        hard: How many of these, the first, are not broken at all.
        first: The first that cannot be kept together with those before it.
        speed: Greatest speed, m/s.
        x: Answer to those before, along x, m/s.
        y: The same along y, m/s.
        scratch: (K, 3) room to work in.
    """
    broken = 0.0
    scratch[:hard] = planes[:hard]
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
