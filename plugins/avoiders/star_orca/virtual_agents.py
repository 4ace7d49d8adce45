"""Obstacles as agents that stand still, one at the nearest point of every edge that is seen."""

from __future__ import annotations

import math

from star_core import Array, compiled
from star_orca.edges import nearest_on
from star_orca.outlines import UX, UY
from star_orca.way_out import NOTHING, way_out


@compiled
def virtual_agent(
    edges: Array,
    row: int,
    agent: tuple[float, float, float, float],
    clearance: float,
    rate: float,
    planes: Array,
    count: int,
) -> int:
    """Add what an edge's virtual agent leaves free to `planes`, and return how many there are then.

    It has no size, does not give way, and is kept at the clearance. That a large obstacle forbids
    no more than such points do is the idea of the original STAR; it placed them at fixed steps, so
    that there were gaps between them. This one goes along with the agent and leaves none. Within
    the clearance the agent is to come out of it as quickly as it may come near outside.

    Args:
        edges: (E, 13) table of `star_orca.outlines.Outlines`.
        row: The edge.
        agent: x, y, m, and velocity along x and y, m/s.
        clearance: Distance to keep, m.
        rate: One over the time to look ahead, 1/s.
        planes: (K, 3) half-planes as those of `star_orca.half_planes`.
        count: How many there are.
    """
    x, y, vx, vy = agent
    dx, dy = nearest_on(edges, row, x, y)
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > clearance:
        a, b, outwards = way_out(dx, dy, vx, vy, clearance, rate, 1.0)
        c = a * vx + b * vy + outwards
    else:
        a, b = edges[row, UY], -edges[row, UX]
        if distance > NOTHING:
            a, b = -dx / distance, -dy / distance
        c = rate * (clearance - distance)
    planes[count, 0], planes[count, 1], planes[count, 2] = a, b, c
    return count + 1
