"""How fast an agent may climb or sink with somebody above or below it."""

from __future__ import annotations

import math

from star_core import Array, Rows, compiled
from star_orca.neighbours import AVOIDS, CLIMB, RADIUS, ROW, X, Y, Z

# Share of the radii within which one agent counts as above or below another. Less than all of it,
# so that two that have parted to their radii in order to pass each other are free to do so.
WITHIN = 0.75


@compiled
def climb(
    agents: Array, me: int, neighbours: Rows, count: int, wish: float, vertical: float, rate: float
) -> float:
    """Return the vertical velocity nearest to the wish that leads into nobody's column.

    Towards a neighbour straight above or below, two that both avoid may each use half of
    ``rate`` times what is left of the distance beyond `vertical`; beside one that does not avoid,
    the agent may use the whole less what the neighbour uses. Nearer than `vertical` there is
    nothing left. Nobody is told to climb or sink who does not want to: altitude is kept.

    Args:
        agents: (M, 13) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the agent that asks.
        neighbours: (K,) rows in it of its neighbours.
        count: How many of these to look at.
        wish: Wanted vertical velocity, m/s.
        vertical: Distance in height to keep, m.
        rate: Part of the distance left that may be used in a second, 1/s.
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
