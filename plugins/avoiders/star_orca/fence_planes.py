"""Half-planes that keep velocities from leading across the fence."""

from __future__ import annotations

from star_core import Array
from star_core.toolkit import YIELD_TIME, subroutine

SIDES = 4  # of the fence: least x, least y, greatest x, greatest y
MAX_RETURN = 0.5  # share of the speed limit: fastest required return of an agent outside the fence


@subroutine
def fence_planes(
    x: float, y: float, speed: float, margin: float, fence: Array, horizon: float, planes: Array
) -> int:
    """Set the half-planes of the fence for an agent, and return their number.

    Towards a side of the fence, an agent may fly the speed that reaches it within the horizon;
    beyond a side, it must fly at least the speed that returns it in that time. Sides out of reach
    in that time add no half-plane.

    They are hard: not violated for the sake of other agents. The core brakes any agent that would
    cross the fence. An avoider unaware of the fence would evade across it, and rely on space that
    the core does not grant.

    Args:
        x: Of its position, m.
        y: Of its position, m.
        speed: Its speed limit, m/s.
        margin: By which distances are enlarged for an uncertain position, m; it yields, see
            `yielding_margin`.
        fence: (4,) least x and y of the geofence, then greatest, m; may be infinite.
        horizon: Time in which no agent shall leave the fence, s.
        planes: (H, 3) half-planes as in `star_orca.half_planes`; the first are set.
    """
    rate, firm, count = 1.0 / horizon, max(1.0 - horizon / YIELD_TIME, 0.0), 0
    for side in range(SIDES):
        inwards = 1.0 if side < 2 else -1.0  # noqa: PLR2004 -- towards greater x and y
        room = inwards * ((x if side % 2 == 0 else y) - fence[side])
        if margin > 0.0 and room > 0.0:
            room -= min(margin, firm * room)
        if room < speed / rate:
            planes[count, 0] = inwards if side % 2 == 0 else 0.0
            planes[count, 1] = 0.0 if side % 2 == 0 else inwards
            planes[count, 2] = min(-rate * room, MAX_RETURN * speed)
            count += 1
    return count
