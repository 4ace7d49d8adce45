"""Limits vertical velocities towards agents above or below."""

from __future__ import annotations

import math

from star_core import Array, Rows, subroutine
from star_orca.neighbours import AVOIDS, CLIMB, RADIUS, ROW, X, Y, Z

# Share of the sum of the radii within which one agent counts as above or below another. Less than
# 1, so that two that have separated to their radii in order to pass each other are free to do so.
WITHIN = 0.75


@subroutine
def climb(
    agents: Array, me: int, neighbours: Rows, count: int, wish: float, vertical: float, rate: float
) -> float:
    """Return the vertical velocity nearest to the preferred one that keeps the vertical distance.

    Towards a neighbour straight above or below, each of two agents that avoid may use half of
    ``rate`` times the distance beyond `vertical`; towards a neighbour that does not avoid, the
    agent may use all of it less the neighbour's own approach. Nearer than `vertical` none is left.
    Agents are never made to climb or sink: altitude is kept.

    Args:
        agents: (M, 13) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the avoiding agent.
        neighbours: (K,) rows in it of its neighbours.
        count: Number of these to use.
        wish: Preferred vertical velocity, m/s.
        vertical: Vertical distance to keep, m.
        rate: Share of the remaining distance that may be used in a second, 1/s.
    """
    up, down = math.inf, math.inf
    for k in range(count):
        other = neighbours[k]
        dx, dy = agents[other, X] - agents[me, X], agents[other, Y] - agents[me, Y]
        column = WITHIN * (agents[me, RADIUS] + agents[other, RADIUS])
        if dx * dx + dy * dy >= column * column:
            continue
        dz = agents[other, Z] - agents[me, Z]
        above = dz > 0.0 or (dz == 0.0 and agents[me, ROW] < agents[other, ROW])
        left = rate * max(abs(dz) - vertical, 0.0)
        if agents[other, AVOIDS] > 0.0:
            left *= 0.5
        else:
            left -= max(-agents[other, CLIMB] if above else agents[other, CLIMB], 0.0)
        if above:
            up = min(up, max(left, 0.0))
        else:
            down = min(down, max(left, 0.0))
    return min(max(wish, -down), up)
