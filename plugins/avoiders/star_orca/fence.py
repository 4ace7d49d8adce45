"""The velocities that lead out of the geofence: what an agent is told not to fly.

The core brakes who would leave the fence in any case. An avoider that did not know of it would send
agents there to make room, and count on that room.
"""

from __future__ import annotations

from star_core import Array, compiled
from star_orca.neighbours import X, Y

SIDES = 4
BACK = 0.5  # of the greatest speed: the most at which who is outside is brought back


@compiled
def inside_fence(
    agent: Array,
    fence: tuple[float, float, float, float],
    rate: float,
    speed: float,
    planes: Array,
    count: int,
) -> int:
    """Add what the sides of the fence leave free to `planes`, and return how many there are then.

    Towards a side an agent may fly what brings it there in ``1 / rate``, and beyond it no less than
    what brings it back in as long. Sides that it cannot reach so soon add none.

    Args:
        agent: Its row of the table of `star_orca.neighbours.sort_into_cells`.
        fence: Least x and y, then greatest x and y, m; may be infinite.
        rate: One over the time to look ahead, 1/s.
        speed: Greatest speed, m/s.
        planes: (K, 3) half-planes as those of `star_orca.half_planes`.
        count: How many there are.
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
