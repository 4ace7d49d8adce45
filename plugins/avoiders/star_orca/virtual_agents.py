"""Obstacles as stationary virtual agents, one at the nearest point of every visible edge."""

from __future__ import annotations

import math

from star_core import Array, subroutine
from star_orca.edges import nearest_on
from star_orca.outlines import UX, UY
from star_orca.velocity_obstacle import NOTHING, way_out


@subroutine
def virtual_agent(
    edges: Array,
    row: int,
    agent: tuple[float, float, float, float],
    clearance: float,
    rate: float,
    planes: Array,
    count: int,
) -> int:
    """Add the half-plane of an edge's virtual agent to `planes`, and return their new number.

    The virtual agent has no size, does not give way, and is kept at the clearance. Replacing a
    large obstacle by such points is the idea of the original STAR, which placed them at fixed
    steps, with gaps between them. Here the point moves along with the agent, so there are no gaps.
    Within the clearance the agent must move out as quickly as it may approach from outside.

    Args:
        edges: (E, 13) table of `star_orca.outlines.Outlines`.
        row: Row of the edge.
        agent: x, y, m, and velocity along x and y, m/s.
        clearance: Distance to keep, m.
        rate: One over the time horizon, 1/s.
        planes: (K, 3) half-planes as in `star_orca.half_planes`.
        count: Number of half-planes in it.
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
