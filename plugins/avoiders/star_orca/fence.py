"""Half-planes that keep velocities from leading out of the geofence.

The core brakes any agent that would cross the fence. An avoider unaware of the fence would evade
across it, and rely on space that the core does not grant.
"""

from __future__ import annotations

from star_core import Array, compiled
from star_orca.neighbours import X, Y

SIDES = 4
BACK = 0.5  # share of the speed limit: fastest required return of an agent outside the fence


@compiled
def inside_fence(
    agent: Array,
    fence: tuple[float, float, float, float],
    rate: float,
    speed: float,
    planes: Array,
    count: int,
) -> int:
    """Add the half-planes of the fence's sides to `planes`, and return their new number.

    Towards a side, an agent may fly the speed that reaches it in ``1 / rate``; beyond a side, it
    must fly at least the speed that returns it in that time. Sides out of reach in that time add
    no half-plane.

    Args:
        agent: Its row of the table of `star_orca.neighbours.sort_into_cells`.
        fence: Least x and y, then greatest x and y, m; may be infinite.
        rate: One over the time horizon, 1/s.
        speed: Speed limit, m/s.
        planes: (K, 3) half-planes as in `star_orca.half_planes`.
        count: Number of half-planes in it.
    """
    reach = speed / rate
    x, y = agent[X], agent[Y]
    if min(x - fence[0], fence[2] - x, y - fence[1], fence[3] - y) >= reach:
        return count
    for side in range(SIDES):
        along, inwards = (x, y)[side % 2], 1.0 if side < SIDES // 2 else -1.0
        room = inwards * (along - fence[side])
        if room < reach:
            planes[count, 0] = inwards if side % 2 == 0 else 0.0
            planes[count, 1] = 0.0 if side % 2 == 0 else inwards
            planes[count, 2] = min(-rate * room, BACK * speed)
            count += 1
    return count
