"""The edges of obstacles that face an agent, nearest first."""

from __future__ import annotations

from star_core import Array, Rows, subroutine
from star_orca.outlines import AX, AY, LENGTH, UX, UY


@subroutine
def layer_at(z: float, height: Array) -> int:
    """Return the layer of `star_orca.outlines.Outlines` that contains height `z`, m."""
    layer = 0
    while layer < len(height) and z >= height[layer]:
        layer += 1
    return layer


@subroutine
def nearest_edges(
    edges: Array, span: tuple[int, int], x: float, y: float, reach: float, room: tuple[Rows, Array]
) -> int:
    """Find the nearest edges that face a point, nearest first, and return how many there are.

    Args:
        edges: (E, 13) table of `star_orca.outlines.Outlines`.
        span: First edge to search, and one past the last.
        x: Of the point, m.
        y: Of the point, m.
        reach: Search radius, m.
        room: (K,) buffer for the rows of the edges found, and (K,) buffer for their squared
            distances, m². At most K edges are returned.
    """
    found, distance = room
    most, count = len(found), 0
    limit = reach * reach
    for row in range(span[0], span[1]):
        dx, dy = x - edges[row, AX], y - edges[row, AY]
        off = edges[row, UY] * dx - edges[row, UX] * dy  # how far right of the edge: outside
        if off < 0.0 or off * off >= limit:
            continue
        along = edges[row, UX] * dx + edges[row, UY] * dy
        beyond = along - min(max(along, 0.0), edges[row, LENGTH])
        squared = off * off + beyond * beyond
        if squared >= limit:
            continue
        place = count if count < most else most - 1
        while place > 0 and squared < distance[place - 1]:
            distance[place], found[place] = distance[place - 1], found[place - 1]
            place -= 1
        distance[place], found[place] = squared, row
        if count < most:
            count += 1
        if count == most:
            limit = distance[most - 1]
    return count


@subroutine
def nearest_on(edges: Array, row: int, x: float, y: float) -> tuple[float, float]:
    """Return the vector from a point to the nearest point of an edge, m."""
    dx, dy = x - edges[row, AX], y - edges[row, AY]
    along = edges[row, UX] * dx + edges[row, UY] * dy
    along = min(max(along, 0.0), edges[row, LENGTH])
    return along * edges[row, UX] - dx, along * edges[row, UY] - dy
