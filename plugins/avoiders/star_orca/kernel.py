"""ORCA for a whole swarm in one call: neighbours, half-planes, velocities.

Numba keeps the machine code on disk and looks at the age of this file alone to see whether it is
still good. After editing another file that is compiled into it, touch this one; a test notices if
you forget.
"""

from __future__ import annotations

import numpy as np

from star_core import Array, Mask
from star_orca.compiled import compiled
from star_orca.half_planes import half_planes
from star_orca.keep_right import keep_right
from star_orca.linear_program import solve
from star_orca.neighbours import AVOIDS, ROW, nearest, sort_into_cells


@compiled
def orca(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    position: Array,
    velocity: Array,
    wish: Array,
    radius: Array,
    speed: Array,
    avoids: Mask,
    horizon: float,
    neighbour_distance: float,
    most: int,
    vertical: float,
    period: float,
    turn: float,
) -> Array:
    """Return the velocity nearest to its wish that keeps each agent apart from its neighbours.

    This is optimal reciprocal collision avoidance: van den Berg, Guy, Lin and Manocha, "Reciprocal
    n-Body Collision Avoidance" (2011), in the horizontal plane. With `turn` 0 and every agent
    avoiding it answers as the authors' RVO2 does. Wishes are cut to the greatest speed first.

    Agents that do not avoid, and those whose position is not finite, are answered their wish as it
    came; the first are in the way of the others all the same, the second are not.

    Pass every argument, arrays in C order, and floats as floats: numba compiles anew for every
    other combination of types.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s; z is not looked at. One that is not finite counts as at rest.
        wish: (N, 3) wanted velocity, m/s; z passes through.
        radius: (N,) two agents keep the sum of their radii apart in the plane, m.
        speed: (N,) greatest horizontal speed, m/s.
        avoids: (N,) False where the agent does not give way, so that the others do it alone.
        horizon: Time for which no two shall collide, s.
        neighbour_distance: How far away in the plane neighbours are looked for, m.
        most: No more than so many neighbours are looked at, the nearest.
        vertical: Agents further apart in height than this are no neighbours, m.
        period: Time from one call to the next, in which two that overlap shall come apart, s.
        turn: How far a wish is turned right when a neighbour is ahead, rad: see `keep_right`.

    Returns:
        (N, 3) m/s.
    """
    agents, cell, start, columns = sort_into_cells(
        position, velocity, radius, avoids, neighbour_distance
    )
    limits = (neighbour_distance, vertical)
    neighbours, distance = np.empty(most, np.int64), np.empty(most)
    planes, scratch = np.empty((most, 3)), np.empty((most, 3))
    answer = wish.copy()
    for me in range(len(agents)):
        if agents[me, AVOIDS] == 0.0:
            continue
        count = nearest(agents, me, cell[me], start, columns, limits, neighbours, distance)
        half_planes(agents, me, neighbours, count, horizon, period, planes)
        i = int(agents[me, ROW])
        x, y = wish[i, 0], wish[i, 1]
        if turn != 0.0:
            x, y = keep_right(agents, me, neighbours, count, x, y, turn)
        answer[i, 0], answer[i, 1] = solve(planes, count, speed[i], x, y, scratch)
    return answer
