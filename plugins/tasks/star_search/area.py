"""The area to search, as a mission gives it, and what is wrong with it. Nothing imports numpy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from star_core import Scene

Corner: TypeAlias = tuple[float, float]
Area: TypeAlias = Sequence[Sequence[float]] | Mapping[str, Sequence[float]]

CORNERS = 3  # of a polygon at least


def corners(scene: Scene, area: Area | None) -> tuple[Corner, ...]:
    """Return the corners of the area, m: of a polygon, of a box, or of the fence if None."""
    if area is None:
        fence = scene.world.fence
        return _box(fence.low, fence.high)
    if isinstance(area, Mapping):
        return _box(area["low"], area["high"])
    return tuple((float(x), float(y)) for x, y in area)


def inside(ring: Sequence[Corner], x: float, y: float) -> bool:
    """Return whether a point is inside a polygon, by the crossings of a ray towards +x.

    >>> inside([(0, 0), (2, 0), (2, 2), (0, 2)], 1.0, 1.5)
    True
    """
    odd = False
    for (ax, ay), (bx, by) in zip(ring, [*ring[1:], ring[0]], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            odd = not odd
    return odd


def faults(scene: Scene, area: Area | None) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield what is wrong with an area that its schema cannot see, and where in it."""
    if isinstance(area, Mapping):
        (x, y), (u, v) = area["low"], area["high"]
        if not (x < u and y < v):
            yield (), f"low {area['low']!r} is not below high {area['high']!r} in x and y"
            return
    low, high = scene.world.fence.low, scene.world.fence.high
    ring = corners(scene, area)
    names: Sequence[Any] = range(len(ring))
    if isinstance(area, Mapping):
        names, ring = ("low", "high"), (ring[0], ring[2])
    for name, (x, y) in zip(names, ring, strict=True):
        if not (low[0] <= x <= high[0] and low[1] <= y <= high[1]):
            yield (
                (name,),
                f"[{x:g}, {y:g}] is outside the fence, from [{low[0]:g}, {low[1]:g}] "
                f"to [{high[0]:g}, {high[1]:g}]",
            )
    if len(ring) >= CORNERS:
        yield from _crossings(ring)


def _box(low: Sequence[float], high: Sequence[float]) -> tuple[Corner, ...]:
    (x, y), (u, v) = low[:2], high[:2]
    return ((x, y), (u, y), (u, v), (x, v))


def _crossings(ring: Sequence[Corner]) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Sides that meet where they should not, told once each, at the later one's first corner."""
    n = len(ring)
    sides = [(ring[i], ring[(i + 1) % n]) for i in range(n)]
    for i, side in enumerate(sides):
        if side[0] == side[1]:
            yield (i,), f"corner {i + 1} is the same as the next one"
            return
    for i, j in combinations(range(n), 2):
        beside = j - i in {1, n - 1}
        if _back(sides[i], sides[j], j - i == 1) if beside else _meet(*sides[i], *sides[j]):
            yield (
                (j,),
                f"the side from corner {j + 1} meets the side from corner {i + 1}; "
                "give the corners in order around the area",
            )
            return


def _back(one: tuple[Corner, Corner], other: tuple[Corner, Corner], after: bool) -> bool:  # noqa: FBT001
    """Whether two neighbouring sides fold back onto each other."""
    first, second = (one, other) if after else (other, one)
    (ax, ay), (bx, by) = first
    cx, cy = second[1]
    along = (bx - ax) * (cx - bx) + (by - ay) * (cy - by)
    return _turn(first[0], first[1], second[1]) == 0 and along < 0


def _meet(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    """Whether the stretches ab and cd have a point in common."""
    one, two = _turn(a, b, c), _turn(a, b, d)
    three, four = _turn(c, d, a), _turn(c, d, b)
    if one * two < 0 and three * four < 0:
        return True
    return any(
        turn == 0 and _amid(p, q, r)
        for turn, p, q, r in ((one, a, b, c), (two, a, b, d), (three, c, d, a), (four, c, d, b))
    )


def _turn(a: Corner, b: Corner, c: Corner) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _amid(a: Corner, b: Corner, c: Corner) -> bool:
    """Whether c, on the line ab, is between them."""
    return min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(a[1], b[1])
